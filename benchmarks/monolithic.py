"""The same discrete contact problem solved in one piece: nothing of ``orchestrator.method`` is used.

Every subdomain keeps its own copy of the interface nodes; subdomains are
assembled by the elements of the studies, without soles. Unknown are the displacements u and, per node pair of every interface, the force λ
that the second side exerts on the first, with jump d = u₂ − u₁ = D u and n from side 1 to side 2:

    K u + Dᵀλ = f,      contact:  0 ≥ λ_n ⟂ g + d_n ≥ 0,   |λ_t| ≤ μ|λ_n|, slip d_t − d_t(previous step) along λ_t
                        perfect:  d = 0,          jump:  d = d₀,          elastic:  λ = k A d, with tension_only 0 for k_n d_n < 0

The laws are written as λ = P(λ + c (d − shift)), which holds for one and hence every c > 0 (Alart & Curnier
1991), and both equations are solved together, step after step, by a semismooth Newton with sparse LU. Pairs that
meet in a cross point share forces in more than one way, so that the Jacobian is singular: a vanishing
regularisation of the direction, not of the equations, picks one. Displacements and resultants are unique.

With ten-node tets the pairs of a face in contact are those of the corners, and every node in the middle of an edge of it
has the mean displacement of its ends: u = R u, in the place of K, f and D stand RᵀKR, Rᵀf and D R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from benchmarks.kit.elasticity import stiffness
from orchestrator.scene.mesh.geometry import area_vectors, mirrored
from orchestrator import Scene

OPEN, STICK, SLIP, BONDED = 0, 1, 2, 3
KNOWN = ("perfect", "jump", "contact", "elastic")
TOLERANCE = 1e-11
MAX_NEWTON = 60
SOFT = 1e-7  # compliance of a pair over 1/c, in the Newton direction alone
PROXIMAL = 1e-9  # stiffness added to K's diagonal likewise: bodies that nothing holds
BACKTRACKS = 5
ALIKE, TURNS = 1e-10, 1000  # of the forces that go with given displacements, what need not be known, and how often they are improved
NORMAL = 1e-6  # share of a normal that prescribed components must leave for the contact to press on
SCALES = (1.0, 10.0, 0.1, 100.0)  # c over the local stiffness; the next one when Newton cycles


@dataclass
class Pairs:
    """All node pairs, interface after interface.

    Parameters
    ----------
    D : (3P, N) jump operator on all displacement components; zero rows where prescribed
    free : (P, 3) bool, components that are not prescribed
    normal : (P, 3); gap, friction, stiffness : (P,); jump : (P, 3) imposed
    bonded, contact, elastic : (P,) bool; none holds where everything is prescribed
    springs : (P, 3) of elastic pairs k A along the normal where they are stretched, where they are not, and across it
    at : per load step, gap and jump where they differ
    bounds : per interface, its pairs
    """

    D: sp.csr_array
    free: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    friction: np.ndarray
    stiffness: np.ndarray
    jump: np.ndarray
    bonded: np.ndarray
    contact: np.ndarray
    elastic: np.ndarray
    springs: np.ndarray
    at: list[tuple[np.ndarray, np.ndarray]]
    bounds: list[slice]


@dataclass
class Step:
    """Solution of one load step.

    Parameters
    ----------
    parts : per subdomain (n_E, 3) displacement
    force, jump : (P, 3) λ and d; status : (P,)
    residual : largest relative violation of equilibrium and laws
    started : the same before the first Newton step
    newton : steps taken, of all attempts
    """

    parts: list[np.ndarray]
    force: np.ndarray
    jump: np.ndarray
    status: np.ndarray
    residual: float
    started: float
    newton: int

    @property
    def converged(self) -> bool:
        return self.residual <= TOLERANCE


class Monolithic:
    """A scene in one piece.

    Parameters
    ----------
    scene : the problem

    tolerance, most : residual that Newton's method is satisfied with; its steps at most
    """

    def __init__(self, scene: Scene):
        self.scene, self.tolerance, self.most = scene, TOLERANCE, MAX_NEWTON
        self.offsets = np.cumsum([0] + [3 * len(s.nodes) for s in scene.subdomains])
        self.K = sp.csr_array(sp.block_diag([_stiffness(scene, s) for s in scene.subdomains]))
        self.free = ~np.concatenate([s.fixed.ravel() for s in scene.subdomains])
        self.supported = ~self.free
        self.pairs = self._pairs()
        self.inner = sp.csc_array(self.K[self.free][:, self.free])
        self.proximal = sp.diags_array(PROXIMAL * self.inner.diagonal())
        self.D = sp.csr_array(self.pairs.D[:, self.free])

    def solve(self, start: list[tuple[list[np.ndarray], np.ndarray]] | None = None) -> list[Step]:
        """All load steps in turn.

        Parameters
        ----------
        start : per step, displacements of the subdomains and pair forces (P, 3) to start from; by default
            what the step before left, and everything stuck at first
        """
        steps, previous, last = [], np.zeros_like(self.pairs.normal), None
        for t in range(self.scene.steps):
            last = self._step(t, previous, last if start is None else start[t])
            previous = last[1].jump
            steps.append(last[1])
            last = (last[1].parts, last[1].force)
        return steps

    def start(self, t: int, parts: list[np.ndarray], before: list[np.ndarray] | None = None) -> tuple[list[np.ndarray], np.ndarray]:
        """Displacements (n_E, 3) of the subdomains as a start, with pair forces (P, 3) that balance them and obey the laws beside them.

        Where several interfaces meet in a node many forces balance: laws and balance are met in turn until both hold.

        Parameters
        ----------
        before : displacements at the load step before, if there is one
        """
        self.pairs.gap, self.pairs.jump = self.pairs.at[t]
        u, previous = (np.concatenate([p.ravel() for p in each]) for each in (parts, before or [np.zeros_like(p) for p in parts]))
        left, jump, previous = (self._loads(t) - self.K @ u)[self.free], *((self.pairs.D @ x).reshape(-1, 3) for x in (u, previous))
        force = np.zeros_like(jump)
        for _ in range(TURNS):
            missing = sla.lsqr(self.D.T, left - self.D.T @ force.ravel(), atol=ALIKE, btol=ALIKE)[0]
            balanced = force + missing.reshape(-1, 3)
            force = self._law(balanced, jump, previous, 1.0)[0]
            if np.abs(force - balanced).max(initial=0.0) <= ALIKE * np.abs(force).max(initial=0.0):
                break
        return parts, force

    def reactions(self, t: int, parts: list[np.ndarray], force: np.ndarray) -> np.ndarray:
        """(n, 3) forces that supports exert on the nodes of the mesh, which carry pair forces (P, 3) as well."""
        u = np.concatenate([p.ravel() for p in parts])
        residual = np.where(self.supported, self.K @ u - self._loads(t) + self.pairs.D.T @ force.ravel(), 0.0)
        nodal = np.zeros_like(self.scene.mesh.nodes)
        for s, a, b in zip(self.scene.subdomains, self.offsets[:-1], self.offsets[1:]):
            np.add.at(nodal, s.nodes, residual[a:b].reshape(-1, 3))
        return nodal

    def _step(self, t: int, previous: np.ndarray, start) -> tuple[float, Step]:
        """One load step; several attempts with different c when Newton does not get there."""
        self.pairs.gap, self.pairs.jump = self.pairs.at[t]
        prescribed = np.concatenate([s.prescribed[t].ravel() for s in self.scene.subdomains])
        loads, given, count, first, best = self._loads(t), start, 0, None, None
        for scale in SCALES:
            u, force = (np.zeros(self.offsets[-1]), np.zeros_like(previous)) if given is None else \
                (np.concatenate([p.ravel() for p in given[0]]), given[1])
            found = self._newton(np.where(self.free, u, prescribed), force, loads, previous, scale, given is None)
            count += found[-1]
            first = found[3] if first is None else first
            if best is None or found[2] < best[2]:
                best = found
            if best[2] <= self.tolerance:
                break
            given = self._parts(best[0]), best[1]
        u, force, residual = best[:3]
        jump = (self.pairs.D @ u).reshape(-1, 3)
        status = self._law(force, jump, previous, 1.0)[1]
        return residual, Step(self._parts(u), force, jump, status, residual, first, count)

    def _newton(self, u, force, loads, previous, scale, cold):
        """(u, λ, residual, residual at the start, steps) of one attempt."""
        free, D = self.free, self.D
        reference = max(np.abs(loads[free]).max(), np.abs((self.K @ np.where(free, 0.0, u))[free]).max(initial=0.0),
                        np.abs(force).max())

        def state(u, force):
            jump = (self.pairs.D @ u).reshape(-1, 3)
            answer, status, slope = self._law(force, jump, previous, scale)
            balance = (loads - self.K @ u)[free] - D.T @ force.ravel()
            return balance, force - answer, slope, status

        def size(s, force):
            scaled = max(reference, np.abs(force).max(initial=0.0)) or 1.0
            return max(np.abs(s[0]).max(), np.abs(s[1]).max(initial=0.0)) / scaled

        now = state(u, force)
        start = value = size(now, force)
        best, merit, count = (u, force, value), np.inf, 0
        eye = np.eye(3)
        while value > self.tolerance and count < self.most:
            slope = np.where(self.pairs.contact[:, None, None], eye, now[2]) if cold and count == 0 else now[2]
            # (I − A + SOFT) δλ = −Φ + c A D δu, pair by pair; then the displacements alone are left
            inverse = np.linalg.inv((1 + SOFT) * eye - slope)
            gain = inverse @ slope * (scale * self.pairs.stiffness)[:, None, None]
            answer = np.einsum("pij,pj->pi", inverse, now[1])
            matrix = self.inner + self.proximal + D.T @ _blocks(gain) @ D
            step = sla.splu(sp.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
                            options={"SymmetricMode": True}).solve(now[0] + D.T @ answer.ravel())
            change = np.einsum("pij,pj->pi", gain, (D @ step).reshape(-1, 3)) - answer
            for halving in range(BACKTRACKS):
                part = 0.5**halving
                trial = u.copy()
                trial[free] += part * step
                trial_force = force + part * change
                new = state(trial, trial_force)
                new_merit = np.linalg.norm(new[1]) + np.linalg.norm(new[0])
                if new_merit <= (1 - 0.1 * part) * merit or count == 0:
                    break
            u, force, now, merit = trial, trial_force, new, new_merit
            value, count = size(now, force), count + 1
            if value < best[2]:
                best = (u, force, value)
        return *best, start, count

    def _law(self, force: np.ndarray, jump: np.ndarray, previous: np.ndarray, scale: float):
        """P(λ + c (d − shift)), the status, and the derivative of P."""
        p = self.pairs
        c, n = scale * p.stiffness, p.normal
        along = np.einsum("pi,pi->p", force, n) + c * (p.gap + np.einsum("pi,pi->p", jump, n))
        slid = jump - previous
        trial = force + c[:, None] * slid
        trial -= np.einsum("pi,pi->p", trial, n)[:, None] * n
        size = np.linalg.norm(trial, axis=1)
        pressure = np.maximum(-along, 0.0)
        limit = p.friction * pressure
        closed, slips = along < 0, (size > limit) | (p.friction == 0)
        e = trial / np.where(size > 0, size, 1.0)[:, None]
        answer = -pressure[:, None] * n + np.where(slips[:, None], limit[:, None] * e, trial)
        N = n[:, :, None] * n[:, None, :]
        ratio = np.where(size > 0, limit / np.where(size > 0, size, 1.0), 0.0)[:, None, None]
        sliding = N - p.friction[:, None, None] * e[:, :, None] * n[:, None, :] \
            + ratio * (np.eye(3) - N - e[:, :, None] * e[:, None, :])
        slope = np.where(slips[:, None, None], sliding, np.eye(3))
        status = np.where(closed & p.contact, np.where(slips, SLIP, STICK), OPEN)
        closed &= p.contact
        answer, slope = answer * closed[:, None], slope * closed[:, None, None]
        self._springs(force + c[:, None] * jump, c, answer, slope)
        # bonded: whatever force makes the jump what it must be
        tied = force + c[:, None] * (jump - p.jump)
        answer = np.where(p.bonded[:, None], tied, answer) * p.free
        slope = np.where(p.bonded[:, None, None], np.eye(3), slope) * (p.free[:, :, None] & p.free[:, None, :])
        return answer, np.where(p.bonded, BONDED, status), slope

    def _springs(self, trial: np.ndarray, c: np.ndarray, answer: np.ndarray, slope: np.ndarray) -> None:
        """Enters P(λ + c d) = k/(k + c) (λ + c d) and its derivative of the elastic pairs."""
        p = self.pairs
        at = np.flatnonzero(p.elastic)
        n, x, c = p.normal[at], trial[at], c[at]
        along = np.einsum("pi,pi->p", x, n)
        taut, slack, across = p.springs[at].T
        normal = np.where(along < 0, slack, taut)
        N = n[:, :, None] * n[:, None, :]
        free = p.free[at][:, :, None] & p.free[at][:, None, :]
        slope[at] = ((normal / (normal + c))[:, None, None] * N + (across / (across + c))[:, None, None] * (np.eye(3) - N)) * free
        answer[at] = np.einsum("pij,pj->pi", slope[at], x)

    def _pairs(self) -> Pairs:
        scene, diagonal = self.scene, self.K.diagonal()
        rows, columns, values, bounds = [], [], [], []
        found = {k: [] for k in ("free", "normal", "gap", "friction", "stiffness", "jump", "bonded", "contact", "elastic", "springs")}
        gaps: list[list[np.ndarray]] = []
        jumps: list[list[np.ndarray]] = []
        count = 0
        for i in scene.interfaces:
            if i.mortar is not None:
                self._operators(i, count, rows, columns, values, found, diagonal)
                self._at_steps(i, i.mortar.points, 1.0, i.mortar.live, gaps, jumps)
                bounds.append(slice(count, count + len(i.mortar)))
                count += len(i.mortar)
                continue
            n = len(i.global_nodes)
            free = i.free
            dofs = [self.offsets[e] + 3 * nodes[:, None] + np.arange(3) for e, nodes in zip(i.subdomains, i.nodes)]
            row = 3 * count + np.arange(3 * n).reshape(-1, 3)
            for side, sign in ((0, -1.0), (1, 1.0)):
                rows.append(row[free])
                columns.append(dofs[side][free])
                values.append(np.full(free.sum(), sign))
            mobile, (normal, length) = free.any(axis=1), free_normals(scene, i)
            presses = normal.any(axis=1)
            found["free"].append(free)
            found["normal"].append(normal)
            found["gap"].append(i.law.distance * np.ones(n) / length)
            found["friction"].append(_friction(i.law) / length)
            found["stiffness"].append(np.minimum(diagonal[dofs[0]].mean(1), diagonal[dofs[1]].mean(1)))
            found["jump"].append(_jumps(i.law, n) * free)
            _say_law(i, mobile, presses, length, _areas(scene.points(i), i.triangles[:, :3]), found)
            self._at_steps(i, slice(None), length, free, gaps, jumps)
            bounds.append(slice(count, count + n))
            count += n
        D = sp.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                         shape=(3 * count, self.offsets[-1]))
        at = [(np.concatenate([g[t] for g in gaps]), np.concatenate([j[t] for j in jumps])) for t in range(scene.steps)]
        return Pairs(D, bounds=bounds, at=at, **{k: np.concatenate(v) for k, v in found.items()})

    def _at_steps(self, i: Any, points, length, free: np.ndarray, gaps: list, jumps: list) -> None:
        """Gap and jump of an interface's pairs at every load step."""
        n, laws = len(i.global_nodes), i.law_at_steps or [i.law] * self.scene.steps
        gaps.append([(law.distance * np.ones(n))[points] / length for law in laws])
        jumps.append([_jumps(law, n)[points] * free for law in laws])

    def _operators(self, i: Any, count: int, rows: list, columns: list, values: list, found: dict, diagonal) -> None:
        """The same where nodes do not match: points in the place of pairs, d = G₂ u₂ − G₁ u₁."""
        m, law = i.mortar, i.law
        stiffness = []
        for matrix, e, nodes, sign in ((m.first, i.subdomains[0], i.nodes[0], -1.0), (m.second, i.subdomains[1], i.nodes[1], 1.0)):
            dofs, entries = (self.offsets[e] + 3 * nodes[:, None] + np.arange(3)).ravel(), matrix.tocoo()
            rows.append(3 * count + entries.row)
            columns.append(dofs[entries.col])
            values.append(sign * entries.data)
            weights = abs(matrix)
            mean = (weights @ diagonal[dofs]) / np.maximum(weights.sum(axis=1), 1e-300)
            stiffness.append(mean.reshape(-1, 3).mean(axis=1))
        n, contact = len(m), law.name == "contact"
        found["free"].append(m.live)
        found["normal"].append(m.normal)
        found["gap"].append(law.distance[m.points] if contact else np.zeros(n))
        found["friction"].append(np.full(n, _friction(law)))
        found["stiffness"].append(np.minimum(*stiffness))
        found["jump"].append(_jumps(law, len(i.global_nodes))[m.points])
        _say_law(i, np.ones(n, bool), np.ones(n, bool), np.ones(n), m.area, found)

    def _loads(self, t: int) -> np.ndarray:
        return np.concatenate([s.loads[t].ravel() for s in self.scene.subdomains])

    def _parts(self, u: np.ndarray) -> list[np.ndarray]:
        return [u[a:b].reshape(-1, 3) for a, b in zip(self.offsets[:-1], self.offsets[1:])]


def _friction(law: Any) -> float:
    """Coulomb's coefficient of a law."""
    return law.friction if law.slips else 0.0


def _jumps(law: Any, count: int) -> np.ndarray:
    """(count, 3) the jump that a law gives, none where it is a matter of forces."""
    return np.tile(np.zeros(3) if law.given_jump is None else law.given_jump, (count, 1))


def _say_law(i: Any, mobile, presses, length, area, found: dict) -> None:
    """Enters which law holds at the pairs of an interface, and the springs of elastic ones."""
    name = i.law.name
    if name not in KNOWN:
        raise NotImplementedError(f"law {name} in one piece")
    found["bonded"].append(mobile & (name in ("perfect", "jump")))
    found["contact"].append(mobile & presses & (name == "contact"))
    found["elastic"].append(mobile & (name == "elastic"))
    springs = np.zeros((len(mobile), 3))
    if name == "elastic":  # what prescribed components leave of the normal is shorter than one
        across = (1 - length**2 * presses) * i.law.stiffness_t
        taut = length**2 * presses * i.law.stiffness_n + across
        springs[:] = area[:, None] * np.stack(
            [taut, across if i.law.tension_only else taut, np.full(len(mobile), i.law.stiffness_t)], axis=1)
    found["springs"].append(springs)


def _areas(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) a third of the area of the triangles around each node."""
    x = points[corners]
    third = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 6
    return np.bincount(corners.ravel(), weights=np.repeat(third, 3), minlength=len(points))


def _stiffness(scene: Scene, s: Any) -> sp.csr_array:
    """Of a subdomain as it is, without soles."""
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])[s.material]
    return stiffness(scene.mesh.nodes[s.nodes], s.connectivity, *moduli.T)


def normals(scene: Scene, interface: Any) -> np.ndarray:
    """(n, 3) unit normals out of the first side: of a surface that is known, as a rigid tool's or a
    cylinder's, else along the area vectors of the facets around."""
    if interface.normals is not None:
        return interface.normals
    result = np.zeros((len(interface.global_nodes), 3))
    x = scene.points(interface)
    for corners in interface.triangles[:, :3]:
        for j in range(3):
            at, b, c = corners[j], corners[j - 2], corners[j - 1]
            result[at] += np.cross(x[b] - x[at], x[c] - x[at])
    return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-300)


def free_normals(scene: Scene, interface: Any) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) within the components that are not prescribed, and the length (n,) left of each.

    What is prescribed on both sides neither opens nor slips. The law lives on the other components, where
    g + d·n ≥ 0 with the shorter normal is a larger gap, and p n a smaller force beside the same friction.
    A normal that is prescribed altogether becomes zero, with length 1.
    """
    facets = area_vectors(scene.points(interface), interface.triangles)
    normal = mirrored(normals(scene, interface), facets, interface.triangles, ~interface.free)
    normal = normal * interface.free
    length = np.linalg.norm(normal, axis=1)
    normal[length <= NORMAL] = 0.0
    length[length <= NORMAL] = 1.0
    return normal / length[:, None], length


def _blocks(matrices: np.ndarray) -> sp.csr_array:
    """Block-diagonal matrix of (P, 3, 3)."""
    n = len(matrices)
    return sp.csr_array(sp.bsr_array((matrices, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)))
