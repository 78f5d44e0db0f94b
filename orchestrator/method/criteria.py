"""Stopping criteria: each has a name, a formula and a value it waits for.

- ``error_bound``   (perfect interfaces) the Prager–Synge bound of ``bound``
- ``law_residual``  (other laws) the largest measure of ``law_residuals``
- ``indicator``     the paper's η, for its studies only
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orchestrator.method.bound import Bound
from orchestrator.method.local_state import LocalState
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.indicator import force_imbalance
from orchestrator.method.law_residuals import LawResiduals, law_residuals
from orchestrator.method.linear_stage import Admissible


@dataclass
class Verdict:
    """What a criterion says of one iteration.

    Parameters
    ----------
    met : whether it holds
    bound : for the delivered fields; its ``relative`` is nan where it is not known
    laws : the measures of the interface laws, where there are such
    """

    met: bool
    bound: Bound
    laws: LawResiduals | None = None


class ErrorCriterion:
    """Perfect interfaces: the error bound, or η.

    The bound's second part costs back-substitutions. It is evaluated once the first part is below
    the tolerance, and again when the force imbalance has fallen enough to make a difference.
    """

    def __init__(self, d: Decomposition, tolerance):
        self.d, self.by_error = d, tolerance.error is not None
        self.value = tolerance.error if self.by_error else tolerance.indicator
        self.target = ("error_bound" if self.by_error else "indicator", self.value)
        self.ratio = 0.0

    def __call__(self, fields: Admissible, local: LocalState, eta: float) -> Verdict:
        bound = self.d.bound(fields, complete=False)
        if not self.by_error:
            return Verdict(eta <= self.value, bound)
        imbalance = force_imbalance(self.d.stage.direction, fields)
        if bound.a <= self.value and self.ratio * imbalance <= self.value:
            bound = self.d.bound(fields)
            self.ratio = bound.relative / imbalance if np.isfinite(bound.relative) and imbalance > 0 else 0.0
        return Verdict(bool(bound.relative <= self.value), bound)

    def final(self, fields: Admissible, bound: Bound) -> Bound:
        """The bound of the delivered fields, evaluated now if it has not been."""
        return bound if np.isfinite(bound.relative) else self.d.bound(fields)


class LawCriterion:
    """Contact: equilibrium and every law below the tolerance, or η."""

    def __init__(self, d: Decomposition, tolerance):
        self.d, self.by_error = d, tolerance.error is not None
        self.value = tolerance.error if self.by_error else tolerance.indicator
        self.target = ("law_residual" if self.by_error else "indicator", self.value)
        # bodies move by their loads even where their interfaces do not
        self.scale = max((np.abs(s.prescribed).max(initial=0.0) for s in d.scene.subdomains), default=0.0)

    def __call__(self, fields: Admissible, local: LocalState, eta: float) -> Verdict:
        scale = max(np.abs(fields.u).max(initial=0.0), self.scale)
        laws = law_residuals(self.d.local.pairs, fields.w, fields.f, local, scale, self.d.local.previous)
        met = (laws.largest if self.by_error else eta) <= self.value
        return Verdict(bool(met), self._delivered(fields), laws)

    def _delivered(self, fields: Admissible) -> Bound:
        """Energy and the continuity that perfect interfaces of the scene need; no bound is known."""
        space, d = self.d.space, self.d
        mean = space.class_mean
        delta = mean.T @ ((mean @ fields.u) / np.asarray(mean.sum(axis=1)).reshape(-1, 1)) - fields.u
        energy = d.loading.energy_of(space.scatter @ d.stage.robin_force(fields.s, fields.alpha), fields.u,
                                     space.scatter @ fields.f)
        modes = sum(m.shape[1] for m in d.modes)
        return Bound(math.nan, math.nan, energy, np.zeros((modes, fields.u.shape[1])), delta)

    def final(self, fields: Admissible, bound: Bound) -> Bound:
        return bound


def make_criterion(d: Decomposition, tolerance) -> ErrorCriterion | LawCriterion:
    """The criterion for a decomposition and ``method.tolerance``."""
    return (ErrorCriterion if d.all_perfect else LawCriterion)(d, tolerance)
