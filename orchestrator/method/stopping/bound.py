"""Guaranteed bound on the energy error of perfect interfaces (discrete Prager–Synge).

Two fields are made from one linear stage, per load step, from interface data alone:

- u_D, kinematically admissible: after one coarse rigid repositioning c = argmin ‖B N(u + R c)‖_k of
  the subdomains, the sides of every interface are replaced by their stiffness-weighted mean;
- û, statically admissible: every subdomain is in equilibrium with balanced interface forces f̃ = f
+ δf, see ``admissible``.

Both errors then are the legs of a right-angled triangle,

    ‖u_D − u_exact‖²_K + ‖û − u_exact‖²_K = ‖u_D − û‖²_K = a² + b² − 2 δᵀNᵀδf

with a = ‖u_D − u₂‖_K (δ on the boundary, zero inside), b = ‖K⁺Nᵀδf‖_K. Both a and the
cross term are sparse products; b² = hᵀS⁺h, h = Nᵀδf, takes a few back-substitutions
(``dual_energy``). The run ends on a b² that is known from above: what the conjugate gradients seem
to leave may be less than soft fields of a body, or of a matter in it, still add.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from orchestrator.config.method import ROUNDING
from orchestrator.method.interface.rows import Blocks, dots, peak, times
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import per_node
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.stopping.admissible import Balancing, NodeBalancing, RigidModes
from orchestrator.method.stopping.continuity import Continuity
from orchestrator.method.stopping.dual_energy import Enough, dual_energy
from orchestrator.method.stopping.error_estimate import Judged, relative
from orchestrator.method.stopping.known_answers import KnownAnswers
from orchestrator.method.stopping.softest import BesideRigid, softest


class ErrorBound:
    """The bound for one decomposition; among ranks, sums per subdomain and per interface are formed
    where these are.

    direction : search direction; what it then is asked of, a linear stage and its loads, is told by
        ``of``
    stiffness : (B, B) the subdomains' stiffness on their boundary dofs
    modes : per subdomain (boundary dofs, r) rigid motions that vanish on its prescribed dofs
    external : (T, B) external nodal forces on the boundary dofs

    floor : relative energy error of the subdomains' own matrices, where their digits are few
    """

    def __init__(self, direction: SearchDirection, stiffness: Blocks, modes: list[np.ndarray],
                 external: np.ndarray):
        self.space, self.stiffness = direction.space, stiffness
        self.external, self.floor = external, 0.0
        weight, balancing = stiffness.diagonal(), Balancing
        if self.space.by_nodes:
            weight, balancing = per_node(weight, self.space), NodeBalancing
        self.continuity, self.modes = Continuity(self.space, weight), RigidModes(self.space, modes)
        self.balance = balancing(direction, weight, self.modes)
        self.weights: np.ndarray | None = None
        self.softness: Any = None

    def of(self, stage: LinearStage, steps: slice | np.ndarray = slice(None)) -> ErrorBound:
        """The same for the linear stage of all load steps, or of some."""
        part = copy(self)
        part.stage, part.external = stage, self.external[steps]
        if self.softness is None:  # of the bodies alone, whatever their loads
            part.known = cache(lambda: stage.macro and KnownAnswers(stage.macro, stage.direction))
            part.softness = cache(lambda: softest(
                stage, BesideRigid(stage, self.modes.dense), part.known()))
        return part

    def for_cases(self, weights: np.ndarray) -> ErrorBound:
        """The same, but valid for all steps (T) that are combinations of the present ones, weights
        (r, T).

        The error of a combination is at most the combination of the errors with positive weights;
        the largest energy of all steps is at least that of the present ones.
        """
        wider = copy(self)
        wider.weights = np.abs(weights)
        return wider

    def first(self, fields: Admissible) -> tuple[Judged, np.ndarray, np.ndarray]:
        """Return what is known without back-substitutions; u + R c (T, B); and a² (T,)."""
        c = self.balance.reposition(fields.extended[0])
        u = fields.u + self.modes.moved(c)
        delta = self.continuity(u, self.stage.loading.known)
        a2, energy = self.space.team.sum(*moved_energy(self.stage, self.stiffness, self.external,
                                                       fields, delta))
        size = self.stage.loading.size(energy)
        return Judged("bound", np.nan, 1.0, None, size, relative(self._largest(a2), size), energy,
                      c[:, self.modes.own], delta), u, a2

    def __call__(self, fields: Admissible, useful: float = np.inf,
                 known: tuple[Judged, np.ndarray, np.ndarray] | None = None,
                 asked: float = 0.0) -> Judged:
        """Evaluate the bound of a linear stage.

        useful : a bound above it need not be known: it is infinite then, and ``least`` what has
            been reached
        asked : a bound below it is to be one: b² is known from above
        known : what ``first`` has found
        """
        bound, u, a2 = self.first(fields) if known is None else known
        w, = self.space.extended(self.stage.trace(u))
        change, balanced = self.balance(fields.extended[1], w)
        if not balanced:  # no energy belongs to such forces, and nothing is reached from below
            return replace(bound, relative=np.inf)
        h, size = self.space.loads(change), bound.size
        cross, = self.space.team.sum(dots(bound.correction, h))
        rest, reached = a2 - 2 * cross, Reached(self._largest, size, useful)
        enough, solved = Enough((ROUNDING * size) ** 2,
                                met=self._met(asked, size) ** 2), self.stage.blackbox.solved
        dual = dual_energy(self.stage, h, rest, enough, reached, self.softness, aside=self.known())
        found = self._relative(rest + dual.energy, size)
        if reached.least <= useful and found <= asked and not dual.above:
            dual = dual_energy(self.stage, h, rest, enough, reached, self.softness(), dual,
                               self.known())
            found = self._relative(rest + dual.energy, size)
        sweeps = (self.stage.blackbox.solved - solved) / len(h)
        if reached.least > useful:
            return replace(bound, relative=np.inf, sweeps=sweeps, least=reached.least)
        return replace(bound, relative=found, steps=self._errors(rest + dual.energy), sweeps=sweeps)

    def _relative(self, squares: np.ndarray, size: float) -> float:
        return relative(self._largest(squares), size) + self.floor

    def _met(self, asked: float, size: float) -> float:
        """The error of each load step with which a bound is ``asked`` at most."""
        left = float(
            np.sqrt(max(asked - self.floor, 0.0) ** 2
                    - ROUNDING**2)) if asked - self.floor > ROUNDING else 0.0
        most = 1.0 if self.weights is None else float(self.weights.sum(axis=0).max())
        return size / (1 + 1 / left) / most if left and most else 0.0

    def _errors(self, squares: np.ndarray) -> np.ndarray:
        """(T,) errors of all steps from the squared errors of those at hand."""
        errors = np.sqrt(np.maximum(squares, 0.0))
        return errors if self.weights is None else errors @ self.weights

    def _largest(self, squares: np.ndarray) -> float:
        return peak(self._errors(squares))


def moved_energy(stage: LinearStage, stiffness: Blocks, external: np.ndarray, fields: Admissible,
                 delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) a² = δᵀK δ of boundary values δ (T, B), and ‖u₂ + δ‖²_K, u₂ the linear stage's fields;
    this rank's part of either.

    stiffness, external : as for ``ErrorBound``
    """
    forces, robin = stage.space.loads(fields.f), stage.space.loads(stage.robin_of(fields))
    a2 = dots(delta, times(stiffness, delta))
    return a2, stage.loading.energy_of(robin, fields.u,
                                       forces) + 2 * dots(delta, external + forces) + a2


class Reached:
    """Ends ``dual_energy`` once the error is above what is useful: b² is approached from below.

    error : (T,) squares → the error
    size : energy norm that it is relative to

    least : what the relative error is at least
    """

    def __init__(self, error: Callable[[np.ndarray], float], size: float, useful: float):
        self.error, self.size, self.useful, self.least = error, size, useful, 0.0

    def __call__(self, squares: np.ndarray) -> bool:
        self.least = relative(self.error(squares), self.size)
        return self.least > self.useful
