"""Guaranteed bound on the energy error of perfect interfaces (discrete Prager–Synge).

Two fields are made from one linear stage, per load step, from interface data alone:

- u_D, kinematically admissible: after one coarse rigid repositioning c = argmin ‖B N(u + R c)‖_k of
  the subdomains, the sides of every interface are replaced by their stiffness-weighted mean;
- û, statically admissible: the interface forces f are balanced, f̃ = f + δf with
  δf = −ω A f + ½ k B w₂ (ω + ω' = 1), and every subdomain is in equilibrium with its own f̃.

Both errors then are the legs of a right-angled triangle,

    ‖u_D − u_exact‖²_K + ‖û − u_exact‖²_K = ‖u_D − û‖²_K = a² + b² − 2 δᵀNᵀδf

with a = ‖u_D − u₂‖_K (δ on the boundary, zero inside), b = ‖K⁺Nᵀδf‖_K. Both a and the
cross term are sparse products; b takes a few back-substitutions, see ``dual_energy``.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import dots, times
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.linear.loading import Loading
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.stopping.balancing import Balancing
from orchestrator.method.stopping.continuity import Continuity
from orchestrator.method.stopping.dual_energy import dual_energy
from orchestrator.method.stopping.repositioning import Repositioning, RigidModes

ROUNDING = 1e-11  # relative energy error that double precision leaves in back-substitutions and their differences
UNEVEN = 100.0  # spread, over an interface, of the ratio of both sides' stiffnesses; one matter stays below
TINY = np.finfo(float).tiny


@dataclass
class Bound:
    """Bound on one linear stage's error, all load steps together.

    Parameters
    ----------
    relative : bound on max_t ‖u_D − u_exact‖_K / max_t ‖u_exact‖_K; nan when only ``a`` was asked for
    a : the displacement part alone, relative
    energy : (T,) ‖u_D‖²_K
    repositioned : (T, modes) rigid motions c of the floating subdomains
    correction : (T, B) δ, what brings u + R c to u_D on the boundary dofs
    sweeps : back-substitutions spent
    least : of a bound that is larger than what was asked about, and therefore not known (infinite), what it is at least
    """

    relative: float
    a: float
    energy: np.ndarray
    repositioned: np.ndarray
    correction: np.ndarray
    sweeps: int = 0
    least: float = 0.0

    @classmethod
    def joined(cls, batches: Sequence[Bound]) -> Bound:
        """What is known of all load steps from batches of them, in order; no bound holds for all."""
        return cls(np.nan, np.nan, np.concatenate([b.energy for b in batches]),
                   *(np.vstack([getattr(b, name) for b in batches]) for name in ("repositioned", "correction")))


@dataclass(frozen=True)
class Begun:
    """What is known of a linear stage's bound before any back-substitution.

    Parameters
    ----------
    c : (T, modes) rigid motions of all ranks' floating subdomains
    u, delta : (T, B) boundary displacements with these, and δ
    a2, energy : (T,) a² and ‖u_D‖²_K: this rank's part, until they are ``summed``
    """

    c: np.ndarray
    u: np.ndarray
    delta: np.ndarray
    a2: np.ndarray
    energy: np.ndarray

    @property
    def parts(self) -> list[np.ndarray]:
        """What is to be summed over the ranks."""
        return [self.a2, self.energy]

    def summed(self, a2: np.ndarray, energy: np.ndarray) -> Begun:
        """The same with the sums."""
        return replace(self, a2=a2, energy=energy)


class ErrorBound:
    """The bound for one decomposition.

    Parameters
    ----------
    direction : search direction; what it then is asked of, a linear stage and loads, is told by ``of``
    stiffness : (B, B) the subdomains' stiffness on their boundary dofs
    modes : per subdomain (boundary dofs, r) rigid motions that vanish on its prescribed dofs
    external : (T, B) external nodal forces on the boundary dofs

    Notes
    -----
    Among ranks, sums per subdomain and per interface are formed where these are.
    """

    def __init__(self, direction: SearchDirection, stiffness: sp.csr_array, modes: list[np.ndarray],
                 external: np.ndarray):
        self.space = direction.space
        self.team, transfer = self.space.team, self.space.transfer
        self.stiffness, self.external, self.floor = stiffness, external, 0.0
        self.weight = stiffness.diagonal()
        self.continuity = Continuity(self.space, self.weight)
        trace_weight, = self.space.extended(self.space.gathered(self.weight[None]))
        one, two = transfer.stiffnesses(trace_weight[0])
        self.share = self._shares(one, two)
        self.share[:, ~transfer.at_pairs] = [[0.0], [1.0]]
        # soles are made for the stiffer side of an interface; what both can exchange is set by the softer one
        self.softness = np.sqrt(2 * np.minimum(one, two) / np.maximum(one + two, TINY))
        first, second = transfer.at_points(direction.whole)
        softness = sp.diags_array(self.softness)
        self.modes = RigidModes(self.space, modes)
        soles = softness @ ((first + second) / 2) @ softness
        self.reposition = Repositioning(self.space, self.modes, soles)
        self.soles = None if transfer.picks else soles  # elsewhere k itself is at hand
        self.balance = Balancing(self.space, self.modes)
        self.weights: np.ndarray | None = None

    def of(self, stage: LinearStage, loading: Loading, floor: float) -> ErrorBound:
        """The same for a linear stage and the loads of all load steps.

        Parameters
        ----------
        floor : relative energy error of the subdomains' own matrices, where their digits are few
        """
        whole = self.batch(slice(None), stage, loading)
        whole.floor = floor
        return whole

    def batch(self, steps: slice | np.ndarray, stage: LinearStage, loading: Loading) -> ErrorBound:
        """The same for some of the load steps, whose linear stage and loading are given."""
        part = copy(self)
        part.stage, part.loading, part.external = stage, loading, self.external[steps]
        return part

    def for_cases(self, weights: np.ndarray) -> ErrorBound:
        """The same, but valid for all steps (T) that are combinations of the present ones, weights (r, T).

        The error of a combination is at most the combination of the errors with positive weights; the
        largest energy of all steps is at least that of the present ones.
        """
        wider = copy(self)
        wider.weights = np.abs(weights)
        return wider

    def _shares(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """(2, Q) what either side takes of a force imbalance.

        The stiffer side takes the larger share: it costs less energy there. One share per interface keeps the
        resultants balanced; where stiff and soft nodes are mixed, each node has its own.

        Parameters
        ----------
        one, two : (Q,) stiffness of both sides at the points
        """
        bounds = self.space.transfer.bounds
        filled = np.flatnonzero(np.diff(bounds))
        starts, counts = bounds[filled], np.diff(bounds)[filled]
        with np.errstate(over="ignore"):  # beside a side that is held
            ratio = one / np.maximum(two, TINY)
        if len(filled):
            even = np.maximum.reduceat(ratio, starts) <= UNEVEN * np.minimum.reduceat(ratio, starts)
            one, two = (np.where(np.repeat(even, counts), np.repeat(np.add.reduceat(side, starts), counts), side)
                        for side in (one, two))
        return np.stack([one, two]) / np.maximum(one + two, TINY)

    @cached_property
    def moved_sums(self) -> sp.csr_array:
        """(classes, modes) what rigid motions add to the class sums of weighted displacements; all ranks have to ask."""
        space = self.space
        mine = sp.csr_array(space.classes @ sp.diags_array(self.weight) @ self.modes.boundary)
        if not space.link.shared:
            return mine
        met = np.unique(np.concatenate(list(space.link.shared.values())))
        total = None
        for rank, (labels, rows) in enumerate(self.team.all_gather((space.labels[met], mine[met]))):
            if rank != self.team.rank:
                at, theirs = np.intersect1d(space.labels, labels, assume_unique=True, return_indices=True)[1:]
                place = sp.csr_array((np.ones(len(at)), (at, theirs)), shape=(len(space.labels), len(labels)))
                rows = place @ rows
            else:
                rows = mine
            total = rows if total is None else total + rows  # in one order, for the same bits on all ranks
        return sp.csr_array(total)

    def pull(self, fields: Admissible) -> np.ndarray:
        """(T, modes) what the traces of a linear stage ask of rigid motions: this rank's part, to be summed over the ranks."""
        return self.reposition.pull(fields.extended[0])

    def begin(self, fields: Admissible) -> Begun:
        """Begin to evaluate the bound of a linear stage: a message is sent only for what ``fields`` do not know of others."""
        pull = self.team.sum(self.pull(fields))[0] if fields.pull is None else fields.pull
        c = self.reposition(pull)
        u = fields.u + times(self.modes.boundary, c)
        sums = None if fields.sums is None else fields.sums + times(self.moved_sums, c)
        delta = self.continuity(u, self.stage.known, sums)
        forces = self.space.loads(fields.f)
        robin = self.space.loads(self.stage.robin_of(fields))
        a2 = dots(delta, times(self.stiffness, delta))
        energy = self.loading.energy_of(robin, fields.u, forces) + 2 * dots(delta, self.external + forces) + a2
        return Begun(c, u, delta, a2, energy)

    def __call__(self, fields: Admissible, complete: bool = True, useful: float = np.inf, begun: Begun | None = None) -> Bound:
        """Evaluate the bound of a linear stage.

        Parameters
        ----------
        complete : False leaves out b, and with it all back-substitutions
        useful : a bound above it need not be known: it is infinite then, and ``least`` what has been reached
        begun : what has been begun of it, summed over the ranks; None: nothing has
        """
        if begun is None:
            begun = self.begin(fields)
            begun = begun.summed(*self.team.sum(*begun.parts))
        c, u, delta, a2, energy = begun.c, begun.u, begun.delta, begun.a2, begun.energy
        size, moved = self.loading.size(energy), c[:, self.modes.own]
        a = self._largest(a2)
        if not complete:
            return Bound(np.nan, _relative(a, size), energy, moved, delta)

        change, balanced = self.balance(self._balancing_forces(fields, u))
        if not balanced:  # no energy belongs to such forces, and nothing is reached from below
            return Bound(np.inf, _relative(a, size), energy, moved, delta)
        h = self.space.loads(change)
        cross, = self.team.sum(dots(delta, h))
        rest, least = a2 - 2 * cross, 0.0

        def beyond(reached: np.ndarray) -> bool:
            """Whether the bound is above what is useful: b² is approached from below."""
            nonlocal least
            least = _relative(self._largest(rest + reached), size)
            return least > useful

        b2, sweeps = dual_energy(self.stage, h, rest, (ROUNDING * size) ** 2, beyond)
        squares = rest + b2
        if least > useful:
            return Bound(np.inf, _relative(a, size), energy, moved, delta, sweeps, least=least)
        gap = self._largest(squares)
        return Bound(_relative(gap, size) + self.floor, _relative(a, size), energy, moved, delta, sweeps)

    def _balancing_forces(self, fields: Admissible, u: np.ndarray) -> np.ndarray:
        """(T, D) δf = −ω A f + ½ k B w₂.

        The second term is what the local stage would exchange on top of balancing, opposite on both sides: any such
        pair keeps f̃ balanced; this one brings û closer. The repositioning has made it free of resultants on
        floating subdomains, since both use the same weight. Where nodes do not match, the forces of the points are those
        of the first side, and the second takes all of the imbalance: forces of fewer or more nodes cannot be undone.
        """
        transfer = self.space.transfer
        f = fields.extended[1]
        if not transfer.picks:
            w, = self.space.extended(self.stage.trace(u))
            q = transfer.carried(f) + 0.5 * times(self.soles, transfer.jump(w))
            q = q + (0.5 * transfer.at_pairs - self.share[0]) * (transfer.first(f) + transfer.second(f))
            return (transfer.opposed(q) - f)[:, : self.space.size]
        imbalance = transfer.first(f) + transfer.second(f)
        w, = self.space.extended(u.take(self.space.gather, axis=1))
        soft = self.softness * transfer.jump(w)
        soles = times(self.stage.direction.whole, transfer.spread(soft, soft))  # both sides' by one product
        exchanged = 0.25 * self.softness * (transfer.first(soles) + transfer.second(soles))
        one, two = self.share
        return transfer.spread(exchanged - one * imbalance, -exchanged - two * imbalance)[:, : self.space.size]

    def _largest(self, squares: np.ndarray) -> float:
        """The largest error of all steps from the squared errors (T,) of those at hand."""
        errors = np.sqrt(np.maximum(squares, 0.0))
        return float((errors if self.weights is None else errors @ self.weights).max(initial=0.0))


def _relative(error: float, size: float) -> float:
    """error / ‖u_exact‖, with ‖u_exact‖ ≥ ‖u_D‖ − error: infinite while the error is that large.

    What rounding may add is part of it, so that no tolerance below ``ROUNDING`` is ever reported as met.
    """
    if error == 0:
        return 0.0
    return float(np.hypot(error / (size - error), ROUNDING)) if size > error else np.inf
