"""Estimated errors of a quantity q·u: the mesh's, from those of solution u and dual solution z in each tet, and the iterations'.

    Q(u_exact) − Q(u_h) = a(u_exact − u_h, z_exact − z_h),      so that about      |Q(u_exact) − Q(u_h)| ≤ Σ_K |a_K(e, e')|

with the errors e and e' in a tet whose energies η_K² ``discretisation`` or ``element_problems`` estimates. They are linear in stresses, so
that 4 a_K(e, e') = η_K²(u_h + z_h) − η_K²(u_h − z_h), leaps between sides that do not match as well. No tet's error is set off against
another's. For a force χ·(K_C u) it is z − χ within the tets C that counts, see ``influence``: it jumps where they end, and is as smooth
elsewhere as the solution. The iterations leave at most ‖u − u_h‖ ‖z_h‖, or ‖z_h − χ‖, where all is bonded.

R. Becker, R. Rannacher, An optimal control approach to a posteriori error estimation in finite element methods, Acta Numerica 10, 2001,
1–102; S. Prudhomme, J. T. Oden, On goal-oriented error estimation for elliptic problems: application to the control of pointwise errors,
Comput. Methods Appl. Mech. Engrg 176, 1999, 313–331.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.stopping.discretisation import Estimator

NOTHING = 1e-9  # of what it would be if all nodes' shares had one sign: a value that rounding and iterations leave of zero


@dataclass(frozen=True)
class Quantity:
    """A displacement or a force, and the estimated error of its length, T load steps.

    name : of the probe; asked : accuracy, relative to the largest length
    value : (T,) length; most : (T,) what it would be if all nodes' shares had one sign
    cells : (T, m) what each tet adds to the mesh's error
    iterations : (T,) the iterations' error, nan where it is not known
    """

    name: str
    asked: float
    value: np.ndarray
    most: np.ndarray
    cells: np.ndarray
    iterations: np.ndarray

    @property
    def size(self) -> float:
        """What errors are relative to; 0 where there is nothing."""
        size = float(self.value.max())
        return size if size > NOTHING * self.most.max() else 0.0

    @property
    def mesh(self) -> float:
        """The mesh's error, relative; infinite where the quantity is zero."""
        return float(self.cells.sum(axis=1).max()) / self.size if self.size else np.inf

    @property
    def left(self) -> float:
        """The iterations' error, relative; nan where it is not known."""
        return float(self.iterations.max()) / self.size if self.size else np.nan

    @property
    def error(self) -> float:
        """Both, relative; the mesh's alone where the iterations' is not known."""
        return self.mesh + (self.left if np.isfinite(self.left) else 0.0)

    def told(self) -> dict[str, float | None]:
        """For the summary: its length, errors relative to it, and what is asked for."""
        known = {"error": self.error, "mesh": self.mesh, "iterations": self.left}
        return {"value": self.size, **{name: x if np.isfinite(x) else None for name, x in known.items()}, "asked": self.asked}


def errors(estimator: Estimator, solution: np.ndarray, duals: np.ndarray,
           lifted: tuple[np.ndarray, np.ndarray] | None) -> tuple[np.ndarray, np.ndarray]:
    """(T, m) |a_K(e, e')| of every tet of the mesh, and (T,) ‖z‖, or ‖z − χ‖.

    solution, duals : (T, N, 3), of the estimator's nodes
    lifted : tets (k,) int and χ (T, k, 4 or 10, 3) at their nodes; None for a displacement
    """
    cells, norms = np.empty((len(solution), len(estimator.cells))), np.empty(len(solution))
    for t, (u, z) in enumerate(zip(solution, duals)):
        ours, theirs = u[estimator.cells], z[estimator.cells]
        if lifted is not None:
            np.subtract.at(theirs, lifted[0], lifted[1][t])
        (one, _), (other, energy) = estimator.squares(ours, t), estimator.squares(theirs)
        scale = np.sqrt(one.sum() / other.sum()) if one.any() and other.any() else 1.0  # as much of either, lest digits be lost
        more, less = (estimator.squares(ours + sign * scale * theirs, t)[0] for sign in (1, -1))
        cells[t], norms[t] = np.abs(more - less) / (4 * scale), np.sqrt(energy.sum())
        if estimator.leaps:
            for (own, more), (_, less) in zip(*(estimator.leaps((u + sign * scale * z)[None]) for sign in (1, -1))):
                np.add.at(cells[t], own, np.abs(more - less)[0] / (4 * scale))
    return cells, norms
