/* A model of one's own in C: a block of points joined by bars to all their neighbours, held at its foot, pulled at its top.
 * It needs no library:     cc -O2 -o lattice lattice.c -lm
 * The orchestrator starts it in a folder with springs.txt and forces.txt; it leaves joint.txt and displacements.txt. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define N 4 /* points along each edge; its foot is at z = 0, its top at z = 1 */
#define POINTS (N * N * N)
#define DOFS (3 * POINTS)

static double K[DOFS][DOFS], x[POINTS][3];

static void bars(void) {
  for (int i = 0; i < POINTS; i++) {
    x[i][0] = .5 + (double)(i % N) / (N - 1);
    x[i][1] = .5 + (double)(i / N % N) / (N - 1);
    x[i][2] = (double)(i / N / N) / (N - 1);
  }
  for (int i = 0; i < POINTS; i++)
    for (int j = 0; j < i; j++) {
      double d[3], length = 0;
      for (int c = 0; c < 3; c++) d[c] = x[j][c] - x[i][c], length += d[c] * d[c];
      length = sqrt(length);
      if (length * (N - 1) > 1.8) continue; /* no neighbours */
      double stiff = 4e3 / length;          /* E A over the length */
      for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
          double k = stiff * d[a] * d[b] / length / length;
          K[3 * i + a][3 * i + b] += k, K[3 * j + a][3 * j + b] += k;
          K[3 * i + a][3 * j + b] -= k, K[3 * j + a][3 * i + b] -= k;
        }
    }
  for (int dof = 0; dof < 3 * N * N; dof++) K[dof][dof] += 1e9; /* the foot */
}

static void cholesky(void) {
  for (int j = 0; j < DOFS; j++) {
    for (int k = 0; k < j; k++) K[j][j] -= K[j][k] * K[j][k];
    if (K[j][j] <= 0) exit(3);
    K[j][j] = sqrt(K[j][j]);
    for (int i = j + 1; i < DOFS; i++) {
      for (int k = 0; k < j; k++) K[i][j] -= K[i][k] * K[j][k];
      K[i][j] /= K[j][j];
    }
  }
}

static void solve(double *u) {
  for (int i = 0; i < DOFS; i++) {
    for (int k = 0; k < i; k++) u[i] -= K[i][k] * u[k];
    u[i] /= K[i][i];
  }
  for (int i = DOFS - 1; i >= 0; i--) {
    for (int k = i + 1; k < DOFS; k++) u[i] -= K[k][i] * u[k];
    u[i] /= K[i][i];
  }
}

int main(void) {
  FILE *springs = fopen("springs.txt", "r"), *forces = fopen("forces.txt", "r");
  FILE *joint = fopen("joint.txt", "w"), *moved = fopen("displacements.txt", "w");
  int n, id, cases, own;
  double f[3];
  if (!springs || !forces || !joint || !moved) return 2;
  bars();
  for (int i = POINTS - N * N; i < POINTS; i++) /* ids are its own: here from 1 */
    fprintf(joint, "%d %.17g %.17g %.17g\n", i + 1, x[i][0], x[i][1], x[i][2]);
  if (fscanf(springs, "%d", &n) != 1) return 2;
  for (int i = 0; i < n; i++) {
    if (fscanf(springs, "%d %lf %lf %lf", &id, f, f + 1, f + 2) != 4) return 2;
    for (int c = 0; c < 3; c++) K[3 * id - 3 + c][3 * id - 3 + c] += f[c];
  }
  if (fscanf(forces, "%d %d", &n, &cases) != 2) return 2;
  if (cases) cholesky();
  for (int at = 0; at < cases; at++) {
    static double u[DOFS];
    int ids[N * N];
    if (fscanf(forces, "%d", &own) != 1) return 2;
    for (int dof = 0; dof < DOFS; dof++) u[dof] = own && dof % 3 == 2 && dof >= DOFS / 2 ? .5 * own : 0; /* its own loads */
    for (int i = 0; i < n; i++) {
      if (fscanf(forces, "%d %lf %lf %lf", &id, f, f + 1, f + 2) != 4) return 2;
      for (int c = 0; c < 3; c++) u[3 * id - 3 + c] += f[c];
      ids[i] = id;
    }
    solve(u);
    for (int i = 0; i < n; i++)
      fprintf(moved, "%d %.17g %.17g %.17g\n", ids[i], u[3 * ids[i] - 3], u[3 * ids[i] - 2], u[3 * ids[i] - 1]);
  }
  return fclose(joint) || fclose(moved);
}
