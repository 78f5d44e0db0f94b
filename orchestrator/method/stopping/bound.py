"""Guaranteed bound on the energy error of perfect interfaces (discrete Prager–Synge).

Two fields are made from one linear stage, per load step, from interface data alone:

- u_D, kinematically admissible: after one coarse rigid repositioning c = argmin ‖B N(u + R c)‖_k of
  the subdomains, the sides of every interface are replaced by their stiffness-weighted mean;
- û, statically admissible: the interface forces f are balanced, f̃ = f + δf with
  δf = −ω A f + ½ k B w₂ (ω + ω' = 1), and every subdomain is in equilibrium with its own f̃.

Both errors then are the legs of a right-angled triangle,

    ‖u_D − u_exact‖²_K + ‖û − u_exact‖²_K = ‖u_D − û‖²_K = a² + b² − 2 δᵀNᵀδf

with a = ‖u_D − u₂‖_K (δ on the boundary, zero inside), b = ‖K⁺Nᵀδf‖_K. Both a and the
cross term are sparse products; b takes a few steps of conjugate gradients on the subdomains'
Schur complements S, preconditioned by the black box itself: N M⁻¹Nᵀ = (S + NᵀkN)⁻¹.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.linear.loading import Loading
from orchestrator.method.linear.macro import both_sides, known_widths

RIGID = 6
RELATIVE_TAIL = 0.02  # the conjugate gradients stop when neither a step nor what is to come adds more of the bound's square
MAX_STEPS = 100
CANCELLED = 1e-13  # of a sum of large terms, what rounding leaves
SLOWEST = 0.95  # rate of the conjugate gradients assumed at worst
ROUNDING = 1e-11  # relative energy error that double precision leaves in back-substitutions and their differences
UNEVEN = 100.0  # spread, over an interface, of the ratio of both sides' stiffnesses; one matter stays below
UNBALANCED = 1e-9  # resultants above this fraction of the forces need the coarse balance


@dataclass
class Bound:
    """Bound on one linear stage's error, all load steps together.

    Parameters
    ----------
    relative : bound on max_t ‖u_D − u_exact‖_K / max_t ‖u_exact‖_K; nan when only ``a`` was asked for
    a : the displacement part alone, relative
    energy : (T,) ‖u_D‖²_K
    repositioned : (modes,) × T rigid motions c of the floating subdomains
    correction : (B, T) δ, what brings u + R c to u_D on the boundary dofs
    sweeps : back-substitutions spent
    errors : (T,) like ``relative`` (like ``a`` where only that was asked for), of each step by itself; infinite
        where other steps depend on it
    """

    relative: float
    a: float
    energy: np.ndarray
    repositioned: np.ndarray
    correction: np.ndarray
    sweeps: int = 0
    errors: np.ndarray | float = np.inf

    @classmethod
    def joined(cls, batches: Sequence[Bound]) -> Bound:
        """What is known of all load steps from batches of them, in order; no bound holds for all."""
        return cls(np.nan, np.nan, np.concatenate([b.energy for b in batches]),
                   *(np.hstack([getattr(b, name) for b in batches]) for name in ("repositioned", "correction")))


class ErrorBound:
    """The bound for one decomposition.

    Parameters
    ----------
    stage : linear stage
    loading : loads
    stiffness : (B, B) the subdomains' stiffness on their boundary dofs
    modes : per subdomain (boundary dofs, r) rigid motions that vanish on its prescribed dofs
    external : (B, T) external nodal forces on the boundary dofs

    Notes
    -----
    Among ranks, sums per subdomain and per interface are formed where these are. The coarse rigid repositioning,
    six unknowns per floating subdomain, is solved on every rank: right for some thousands of them.
    """

    def __init__(self, stage: LinearStage, loading: Loading, stiffness: sp.csr_array,
                 modes: list[np.ndarray], external: np.ndarray):
        self.stage, self.space, self.loading = stage, stage.space, loading
        self.team = team = self.space.team
        self.stiffness, self.external = stiffness, external
        self.k = stage.direction.k
        self.robin = stage.direction.robin

        self.weight = stiffness.diagonal()[:, None]
        self.class_weight = self.space.class_sums(self.weight)

        self.modes, self.mode_traces = self._placed(modes)
        one, two = (np.concatenate([slot[side] for slot in self.space.slots] or [np.empty(0, int)]) for side in (0, 1))
        self.mode_jumps = sp.csr_array(self.mode_traces[one] - self.mode_traces[two])
        self.one, self.two = one, two
        # what is summed over the interfaces is summed by the rank of their first side
        self.mine = one < self.space.size
        # soles are made for the stiffer side of an interface; what both can exchange is set by the softer one
        trace_weight = self.space.extended(self.weight[self.space.gather])[0].ravel()
        both = np.maximum(trace_weight[one] + trace_weight[two], np.finfo(float).tiny)
        softness = sp.diags_array(np.sqrt(2 * np.minimum(trace_weight[one], trace_weight[two]) / both))
        whole = stage.direction.whole
        middle = (whole[one][:, one] + whole[two][:, two]) / 2
        self.jump_weight = sp.csr_array(softness @ middle @ softness)
        self.mode_forces = sp.csr_array((self.jump_weight @ self.mode_jumps)[self.mine])  # of my interfaces
        coarse = sp.csr_array(self.mode_jumps[self.mine].T @ self.mode_forces)
        self._reposition = _semidefinite_solver(sum(team.all_gather(coarse), sp.csr_array(coarse.shape)))

        # The stiffer side takes the larger share of a force imbalance: it costs less energy there. One share per
        # interface keeps the resultants balanced; where stiff and soft nodes are mixed, each node has its own.
        share = np.zeros(len(self.space.owner))
        for slots in self.space.slots:
            a, b = (trace_weight[slot] for slot in slots)
            ratio = a / np.maximum(b, np.finfo(float).tiny)
            if len(a) and ratio.max() <= UNEVEN * ratio.min():
                a, b = a.sum(), b.sum()
            for slot, part in zip(slots, (a, b)):
                share[slot] = part / np.maximum(a + b, np.finfo(float).tiny)
        self.share = share[: self.space.size, None]
        self.weights: np.ndarray | None = None
        self._balance = None

    def batch(self, steps: slice | np.ndarray, stage: LinearStage, loading: Loading) -> ErrorBound:
        """The same for some of the load steps, whose linear stage and loading are given."""
        part = copy(self)
        part.stage, part.loading, part.external = stage, loading, self.external[:, steps]
        return part

    def for_cases(self, weights: np.ndarray) -> ErrorBound:
        """The same, but valid for all steps (T) that are combinations of the present ones, weights (r, T).

        The error of a combination is at most the combination of the errors with positive weights; the
        largest energy of all steps is at least that of the present ones.
        """
        wider = copy(self)
        wider.weights = np.abs(weights)
        return wider

    def _placed(self, modes: list[np.ndarray]) -> tuple[sp.csr_array, sp.csr_array]:
        """(B, modes of all ranks) the subdomains' rigid motions, and (D + G, modes) their traces."""
        space = self.space
        counts = np.zeros(space.subdomain_count)
        counts[space.subdomains] = [m.shape[1] for m in modes]
        counts, = self.team.sum(counts)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        dense = np.zeros((len(space.global_dof), RIGID))
        for part, mode in zip(space.boundary, modes):
            dense[part, : mode.shape[1]] = mode
        traces, = space.extended(dense[space.gather])
        subdomain = np.repeat(space.subdomains, [s.stop - s.start for s in space.boundary])
        self.mode_part = np.concatenate([np.arange(starts[e], starts[e + 1]) for e in space.subdomains] or
                                        [np.empty(0, int)])

        def sparse(values: np.ndarray, owner: np.ndarray) -> sp.csr_array:
            row, field = np.nonzero(values)
            return sp.csr_array((values[row, field], (row, starts[owner[row]] + field)),
                                shape=(len(values), starts[-1]))

        return sparse(dense, subdomain), sparse(traces, space.owner)

    def __call__(self, fields: Admissible, complete: bool = True) -> Bound:
        """Evaluate the bound of a linear stage.

        Parameters
        ----------
        complete : False leaves out b, and with it all back-substitutions
        """
        w, = self.space.extended(fields.w)
        push, = self.team.sum(self.mode_forces.T @ (w[self.two] - w[self.one])[self.mine])
        c = self._reposition(push)
        u = fields.u + self.modes @ c
        delta = (self.space.class_sums(self.weight * u) / self.class_weight)[self.space.label] - u

        forces = self.space.scatter @ fields.f
        robin = self.space.scatter @ self.stage.robin_force(fields.s, fields.alpha)
        a2 = np.sum(delta * (self.stiffness @ delta), axis=0)
        energy = self.loading.energy_of(robin, fields.u, forces)
        a2, energy = self.team.sum(a2, energy + 2 * np.sum(delta * (self.external + forces), axis=0) + a2)
        size = np.sqrt(max(energy.max(initial=0.0), 0.0))
        a = self._largest(a2)
        if not complete:
            return Bound(np.nan, _relative(a, size), energy, c[self.mode_part], delta, errors=self._each(a2, size))

        change = -self.share * (fields.f + self.space.swapped(fields.f))
        self._add_local_stage_exchange(change, u)
        change, balanced = self._balanced(change)
        h = self.space.scatter @ change
        cross, = self.team.sum(np.sum(delta * h, axis=0))
        b2, sweeps = self._dual_energy(h, a2 - 2 * cross, (ROUNDING * size) ** 2)
        squares, c = a2 + b2 - 2 * cross, c[self.mode_part]
        if not balanced:
            return Bound(np.inf, _relative(a, size), energy, c, delta, sweeps)
        gap = self._largest(squares)
        errors = self._each(squares, size - gap)
        return Bound(_relative(gap, size), _relative(a, size), energy, c, delta, sweeps, errors)

    def _each(self, squares: np.ndarray, size: float) -> np.ndarray | float:
        """(T,) relative errors of the steps from the squared ones; infinite while others follow from them."""
        return np.sqrt(np.maximum(squares, 0.0)) / size if self.weights is None and size > 0 else np.inf

    def _largest(self, squares: np.ndarray) -> float:
        """The largest error of all steps from the squared errors (T,) of those at hand."""
        errors = np.sqrt(np.maximum(squares, 0.0))
        return float((errors if self.weights is None else errors @ self.weights).max(initial=0.0))

    def _add_local_stage_exchange(self, change: np.ndarray, u: np.ndarray) -> None:
        """What the local stage would exchange on top of balancing: ½ k (w' − w), opposite on both sides.

        Any such pair keeps f̃ balanced; this one brings û closer. The repositioning has made it free
        of resultants on floating subdomains, since both use the same weight.
        """
        w, = self.space.extended(u[self.space.gather])
        exchanged = 0.5 * (self.jump_weight @ (w[self.two] - w[self.one]))
        second = self.two < self.space.size
        change[self.one[self.mine]] += exchanged[self.mine]
        change[self.two[second]] -= exchanged[second]

    def _dual_energy(self, h: np.ndarray, rest: np.ndarray, negligible: float) -> tuple[np.ndarray, int]:
        """(T,) hᵀS⁺h over all subdomains, by conjugate gradients preconditioned with N M⁻¹Nᵀ.

        The iterates approach from below; the geometric tail of the steps is added, and for the
        tail's own error the accuracy that the steps are stopped at. With stiff soles a² and b² are large and
        almost cancelled by the cross term: what counts is the accuracy of the sum. Infinite if it is not reached.

        Parameters
        ----------
        rest : (T,) a² and the cross term
        negligible : sum over the steps that is not worth being told from zero
        """
        if not self.team.max(h.any())[0]:
            return np.zeros(h.shape[1]), 0
        starts = [s.start for s in self.space.boundary if s.stop > s.start]
        member = np.repeat(np.arange(len(starts)), [s.stop - s.start for s in self.space.boundary if s.stop > s.start])

        def dot(x, y):
            return np.add.reduceat(x * y, starts, axis=0) if starts else np.zeros((0, x.shape[1]))

        r, total, p, q, rz_old, steps = h.copy(), 0.0, None, None, None, []
        for sweeps in range(1, MAX_STEPS + 1):
            z = self.stage.solve(r)
            rz = np.maximum(dot(r, z), 0.0)
            if p is None:
                p, q = z, r.copy()
            else:
                beta = _safe_ratio(rz, rz_old)[member]
                p, q = z + beta * p, r + beta * q  # q = (S + k)p follows by recurrence
            sp_ = q - self.robin @ p
            alpha = _safe_ratio(rz, dot(p, sp_))
            step = alpha * rz
            gained, = self.team.sum(step.sum(axis=0))  # over all subdomains, per load step
            total = total + gained
            r = r - alpha[member] * sp_
            rz_old = rz
            steps.append(float(gained.sum()))
            tail = _tail(steps)
            worth = max(np.sum(total + rest), CANCELLED * np.sum(total), negligible)
            if max(steps[-1], tail) <= RELATIVE_TAIL * worth:
                break
        else:
            return np.full(h.shape[1], np.inf), sweeps
        share = gained / max(steps[-1], np.finfo(float).tiny)
        return total + tail * share + RELATIVE_TAIL * np.maximum(total + rest, 0.0), sweeps

    def _balanced(self, change: np.ndarray) -> tuple[np.ndarray, bool]:
        """Add self-balanced rigid force fields per interface so that no floating subdomain is pushed.

        The macro problem has done it already where its basis holds the rigid motions; the
        mono-scale strategy leaves it to this one coarse problem, of least norm.
        """
        resultant, scale = self.team.sum(self.modes.T @ (self.space.scatter @ change),
                                         np.abs(self.modes.T) @ (self.space.scatter @ np.abs(change)))
        if not resultant.size or np.abs(resultant).max() <= UNBALANCED * max(scale.max(), np.finfo(float).tiny):
            return change, True
        if self._balance is None:
            mode_traces = self.mode_traces
            bases = []  # per interface: rigid motions of either side span the force fields
            for one, two in self.space.slots:
                block = mode_traces[one] if mode_traces[one].nnz else mode_traces[two]
                block = sp.csc_array(block)
                local = block[:, np.flatnonzero(np.diff(block.indptr))].toarray()
                left, s, _ = np.linalg.svd(local, full_matrices=False) if local.size else (local, np.zeros(0), None)
                bases.append(left[:, s > 1e-10 * s.max(initial=0.0)])
            spread = both_sides(self.space, known_widths(bases, self.team), (1.0, -1.0))
            work = sp.csr_array(mode_traces[: self.space.size].T @ spread)
            work = sum(self.team.all_gather(work), sp.csr_array(work.shape))
            self._balance = spread, work, _semidefinite_solver(work @ work.T)
        spread, work, solve = self._balance
        change = change + spread @ (work.T @ solve(-resultant))
        left, = self.team.sum(self.modes.T @ (self.space.scatter @ change))
        return change, bool(np.abs(left).max() <= 1e-6 * max(np.abs(resultant).max(), np.finfo(float).tiny))


def _tail(steps: list[float]) -> float:
    """What the steps to come would add: a geometric series, at the slower of the last two rates."""
    last = steps[-3:]
    rates = [b / a for a, b in zip(last, last[1:]) if a > 0]
    rate = min(max(rates, default=0.5), SLOWEST)
    return steps[-1] * rate / (1 - rate)


def _relative(error: float, size: float) -> float:
    """error / ‖u_exact‖, with ‖u_exact‖ ≥ ‖u_D‖ − error: infinite while the error is that large.

    What rounding may add is part of it, so that no tolerance below ``ROUNDING`` is ever reported as met.
    """
    if error == 0:
        return 0.0
    return float(np.hypot(error / (size - error), ROUNDING)) if size > error else np.inf


def _safe_ratio(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    return np.where(bottom > 0, top / np.where(bottom > 0, bottom, 1.0), 0.0)


def _semidefinite_solver(matrix):
    """Solver of a small sparse matrix, regularised by rounding where it is singular."""
    matrix = sp.csc_array(matrix)
    if matrix.shape[0] == 0:
        return lambda x: np.zeros((0, x.shape[1]))
    scale = matrix.diagonal()
    shift = sp.diags_array(np.where(scale > 0, scale, 1.0) * 1e-13)
    return sla.splu(sp.csc_array(matrix + shift)).solve
