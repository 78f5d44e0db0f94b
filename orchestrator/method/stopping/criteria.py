"""Stopping criteria: each has a name, a formula and a value it waits for.

- ``error_bound``   (perfect interfaces) the Prager–Synge bound of ``bound``
- ``law_residual``  (other laws) the largest measure of ``law_residuals``
- ``indicator``     the paper's η, for its studies only

With ``error: auto`` the value follows an estimate of the discretisation error:

    ε ≤ fraction · η_h,   η_h estimated anew whenever ε has fallen to the level that the last estimate asked for.

On perfect interfaces ε is the bound. By Galerkin orthogonality both errors are the legs of a right-angled triangle,
so that a fraction of 0.1 makes the whole error half a per cent larger. With contact ε is the largest law residual or
the energy residual, whichever is larger:

    ε_K = max_t (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹)^½ / max_t ‖u‖_K.

It is in the units of the error because the laws are monotone (frictionless ones; Coulomb's where the statuses are
right): (f̂ − f*)·(ŵ − w*) ≤ 0 against the solution *, and ‖u − u*‖²_K = (f − f*)·(w − w*). With f − f̂ = k(w − ŵ)

    ‖u − u*‖²_K ≤ ‖f − f̂‖_k⁻¹ (‖w − w*‖_k + ‖f − f*‖_k⁻¹) ≤ c ‖f − f̂‖_k⁻¹ ‖u − u*‖_K,

c of order one for soles as stiff as the bodies behind them, which the defaults are. It is no guarantee.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.continuity import Continuity
from orchestrator.method.local.state import LocalState
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.indicator import Measures, energy_residual
from orchestrator.method.stopping.lengths import Lengths, LengthScale
from orchestrator.method.stopping.law_residuals import LawMeasure, LawResiduals, law_residuals
from orchestrator.method.linear.stage import Admissible

# What ``error: auto`` begins with, before there is an estimate, and what it never goes below: the fixed default.
FIRST, LEAST = 0.1, 1e-6
BALANCED = 1e-12  # force imbalance that is nothing but rounding and foretells no bound
# (fields, bound) → estimated discretisation error, relative, energy norm
Estimate = Callable[[Admissible, Bound], float]
CLEAR = 0.1  # fraction of the tolerance below which the bound's first part promises the whole


@dataclass(frozen=True)
class Verdict:
    """What a criterion says of one iteration.

    Parameters
    ----------
    met : whether it holds
    measure : what has been compared with the tolerance
    bound : for the delivered fields; its ``relative`` is nan where it is not known; None where nothing is
    laws : the measures of the interface laws, where there are such
    lengths : what they are relative to
    sweeps : back-substitutions per subdomain and load step that it has cost
    discretisation_error : latest estimate of it; nan where there is none
    """

    met: bool
    measure: float
    bound: Bound | None
    laws: LawResiduals | None = None
    lengths: Lengths | None = None
    sweeps: float = 0.0
    discretisation_error: float = math.nan

    @property
    def error_bound(self) -> float:
        """Guaranteed bound on the relative energy error; nan where it is not known."""
        return math.nan if self.bound is None else self.bound.relative

    @property
    def approached(self) -> float:
        """How far the measure has come towards the tolerance; where it is not known, its first part."""
        return self.measure if math.isfinite(self.measure) or self.bound is None else self.bound.a


class Criterion(Protocol):
    """What a run waits for.

    Attributes
    ----------
    name, value : of the quantity, and below what it has to fall
    done : (T,) bool, load steps that seem accurate enough to be left out of the next linear stage
    """

    name: str
    value: float
    done: np.ndarray

    def early(self, fields: Admissible) -> list[np.ndarray]:
        """Arrays to be summed over the ranks before judging an iteration begins, which the acceleration takes along."""

    def begin(self, fields: Admissible, local: LocalState, early: Sequence[np.ndarray] | None
              ) -> tuple[list[np.ndarray], list[float]]:
        """What judging an iteration needs of all ranks: arrays to be summed, and numbers to find the largest of.

        Parameters
        ----------
        early : sums of what ``early`` has given; None: nobody has summed it
        """

    def __call__(self, fields: Admissible, local: LocalState, measures: Callable[[], Measures]) -> Verdict:
        """Judge an iteration that has begun; ``measures``, ``more`` and ``largest`` of which begin with what that has given, are
        waited for when they are needed."""

    def final(self, fields: Admissible, bound: Bound | None) -> tuple[Bound, float]:
        """What belongs to the delivered fields, and the sweeps that it has cost now if it was not known (``bound``)."""

    @property
    def notes(self) -> dict[str, Any]:
        """For the ``Memory`` of an iteration: what is remembered from one to the next."""

    def recall(self, notes: Mapping[str, Any]) -> None:
        """Take ``notes`` back, but for what was judged by another tolerance."""


class ErrorCriterion:
    """Perfect interfaces: the error bound, or η.

    The bound's second part costs back-substitutions. It is evaluated once the first part is below
    the tolerance, and again when the force imbalance has fallen enough to make a difference.

    Parameters
    ----------
    spare : False evaluates both parts after every stage

    Attributes
    ----------
    done : (T,) bool, load steps that seem accurate enough: by their own bound, or while only its first part is
        known by that being far below the tolerance. The run ends on the bound of all steps.
    """

    def __init__(self, d: Decomposition, tolerance, spare: bool = True):
        self.d, self.by_error, self.value = d, *_asked(tolerance)
        self.spare = spare
        self.name = "error_bound" if self.by_error else "indicator"
        self.ratio = 0.0
        self.done = np.zeros(d.steps, dtype=bool)

    def early(self, fields: Admissible) -> list[np.ndarray]:
        """As the protocol says: what the bound needs is carried beside the state."""
        return []

    def begin(self, fields: Admissible, local: LocalState, early: Sequence[np.ndarray] | None
              ) -> tuple[list[np.ndarray], list[float]]:
        """As the protocol says."""
        self._begun = self.d.bound.begin(fields)
        return self._begun.parts, []

    def __call__(self, fields: Admissible, local: LocalState, measures: Callable[[], Measures]) -> Verdict:
        begun, self._begun = self._begun.summed(*measures().more[:2]), None
        bound = self.d.bound(fields, complete=False, begun=begun)
        if not self.by_error:
            eta = measures().indicator
            return Verdict(eta <= self.value, eta, bound)
        imbalance = measures().force_imbalance
        due = bound.a <= self.value and (imbalance <= BALANCED or self.ratio * imbalance <= _of_size(self.value))
        if due or not self.spare:
            bound = self.d.bound(fields, useful=self.value if self.spare else np.inf, begun=begun)
            known = bound.relative if np.isfinite(bound.relative) else bound.least
            self.ratio = _of_size(known) / imbalance if np.isfinite(known) and imbalance > 0 else 0.0
            self.done[:] = bound.errors <= self.value
        elif self.ratio == 0:
            self.done[:] = bound.errors <= CLEAR * self.value
        return Verdict(bool(bound.relative <= self.value), bound.relative, bound, sweeps=bound.sweeps)

    def final(self, fields: Admissible, bound: Bound | None) -> tuple[Bound, float]:
        """The bound of the delivered fields, evaluated now if it has not been, and the sweeps that this costs."""
        if bound is not None and np.isfinite(bound.relative):
            return bound, 0.0
        bound = self.d.bound(fields)
        return bound, bound.sweeps

    @property
    def notes(self) -> dict[str, Any]:
        """As the protocol says."""
        return {"value": self.value, "ratio": self.ratio, "done": self.done.tolist()}

    def recall(self, notes: Mapping[str, Any]) -> None:
        """As the protocol says."""
        if notes["value"] == self.value:
            self.ratio, self.done[:] = notes["ratio"], notes["done"]


def _of_size(relative: float) -> float:
    """An error relative to ‖u_exact‖ ≥ ‖u_D‖ − error, relative to ‖u_D‖: which falls with the forces' imbalance, as the other does not
    while it is large."""
    return relative / (1 + relative)


class LawCriterion:
    """Contact: equilibrium and every law below the tolerance, or η. Where matter is nonlinear, the fixed point's residual too."""

    def __init__(self, d: Decomposition, tolerance):
        self.d, self.by_error, self.value = d, *_asked(tolerance)
        self.auto = tolerance.error == "auto"
        self.name = "law_residual" if self.by_error else "indicator"
        self.done = np.zeros(d.steps, dtype=bool)  # history joins the steps: none is done before the others
        self.lengths = LengthScale(d)
        self.continuity = Continuity(d.space, np.ones(len(d.space.global_dof)))

    def early(self, fields: Admissible) -> list[np.ndarray]:
        """As the protocol says: products with rigid motions, without which nobody knows what deforms."""
        self._apart, products = self.lengths.apart(fields.u)
        return [products]

    def begin(self, fields: Admissible, local: LocalState, early: Sequence[np.ndarray] | None
              ) -> tuple[list[np.ndarray], list[float]]:
        """As the protocol says."""
        stage = self.d.local
        products, = self.d.space.team.sum(*self.early(fields)) if early is None else early
        deformation, loose = self.lengths.deformed(self._apart, products)
        self._begun, self._apart = (LawMeasure(stage.pairs, *fields.extended, local, stage.before), loose), None
        return [self._begun[0].sums], [deformation, *self._begun[0].largest]

    def __call__(self, fields: Admissible, local: LocalState, measures: Callable[[], Measures]) -> Verdict:
        laws, loose = self._begun
        sums, (deformation, *largest) = measures().more[0], measures().largest[: 1 + len(laws.largest)]
        lengths, bound = self.lengths.of(deformation, loose), None
        laws, self._begun = laws.result(sums, largest, lengths), None
        if self.d.nonlinear is not None:
            laws = laws.with_fixed_point(self._fixed_point(local, lengths, measures().residual))
        measure = laws.largest if self.by_error else measures().indicator
        if self.auto:
            bound = self._delivered(fields)
            measure = max(measure, energy_residual(self.d.stage, fields, local, self.d.loading.size(bound.energy)))
        return Verdict(bool(measure <= self.value), measure, bound, laws, lengths)

    def _fixed_point(self, local: LocalState, lengths: Lengths, residual: float) -> float:
        """‖F(s) − s‖ over ‖F(s)‖, given that ratio, or over a small share of k ℓ where the interfaces carry next to nothing."""
        k = self.d.stage.direction.diagonal
        size = float(np.sqrt(np.sum(local.s**2 / k)))
        return residual * size / (max(size, float(np.sqrt(k.sum())) * lengths.of_rest) or 1.0)

    def laws(self, d: Decomposition, iterated: Iterated) -> LawResiduals:
        """How well the laws and equilibrium hold on the interfaces in the end, in all load steps."""
        lengths, local, found = self.lengths(iterated.fields.u), iterated.local, []
        begun = [paired.before for paired in iterated.paired] or [self.d.local.before]
        for (t, pairs), before in zip(d.by_pairing(iterated), begun):
            w, f = (x[t] for x in iterated.fields.extended)
            found.append(LawMeasure(pairs, w, f, local.steps(t), before))
        return law_residuals(found, lengths, d.space.team)

    def _delivered(self, fields: Admissible) -> Bound:
        """Energy and the continuity that perfect interfaces of the scene need; no bound is known."""
        space, d = self.d.space, self.d
        delta = self.continuity(fields.u, d.stage.known)
        energy, = space.team.sum(d.loading.energy_of(
            space.loads(d.stage.robin_of(fields)), fields.u, space.loads(fields.f)))
        modes = sum(m.shape[1] for m in d.modes)
        return Bound(math.nan, math.nan, energy, np.zeros((len(fields.u), modes)), delta)

    def final(self, fields: Admissible, bound: Bound | None) -> tuple[Bound, float]:
        """Energy and continuity of the delivered fields, evaluated now if they have not been; no sweeps."""
        return bound or self._delivered(fields), 0.0

    @property
    def notes(self) -> dict[str, Any]:
        """As the protocol says: nothing is remembered."""
        return {}

    def recall(self, notes: Mapping[str, Any]) -> None:
        """As the protocol says."""


class AutoCriterion:
    """Another criterion, whose tolerance follows the estimated discretisation error.

    Parameters
    ----------
    inner : the criterion
    fraction : tolerance over estimate
    estimate : costs one back-substitution per subdomain and load step
    """

    def __init__(self, inner: ErrorCriterion | LawCriterion, fraction: float, estimate: Estimate):
        self.inner, self.fraction, self.estimate = inner, fraction, estimate
        self.name, self.final, self.done, self.begin, self.early = inner.name, inner.final, inner.done, inner.begin, inner.early
        self.lengths = getattr(inner, "lengths", None)
        self.discretisation_error = math.nan

    @property
    def value(self) -> float:
        """The tolerance as it is now."""
        return self.inner.value

    def __call__(self, fields: Admissible, local: LocalState, measures: Callable[[], Measures]) -> Verdict:
        verdict = self.inner(fields, local, measures)
        if verdict.met:
            self.discretisation_error = self.estimate(fields, verdict.bound)
            self.inner.value = max(self.fraction * self.discretisation_error, LEAST)
            self.done[:] = False
            verdict = replace(verdict, met=bool(verdict.measure <= self.value), sweeps=verdict.sweeps + 1)
        return replace(verdict, discretisation_error=self.discretisation_error)

    @property
    def notes(self) -> dict[str, Any]:
        """As the protocol says."""
        return {**self.inner.notes, "value": self.value, "fraction": self.fraction,
                "discretisation_error": self.discretisation_error}

    def recall(self, notes: Mapping[str, Any]) -> None:
        """As the protocol says."""
        if notes.get("fraction") == self.fraction:
            self.inner.value, self.discretisation_error = notes["value"], notes["discretisation_error"]
            self.inner.recall(notes)


def _asked(tolerance) -> tuple[bool, float]:
    """Whether the error decides, and below what."""
    if tolerance.error == "auto":
        return True, FIRST
    return (False, tolerance.indicator) if tolerance.error is None else (True, tolerance.error)


def make_criterion(d: Decomposition, tolerance, estimate: Estimate | None = None, spare: bool = True) -> Criterion:
    """The criterion for a decomposition and ``method.tolerance``; ``estimate`` is needed for ``error: auto``."""
    criterion = ErrorCriterion(d, tolerance, spare) if d.all_perfect else LawCriterion(d, tolerance)
    return AutoCriterion(criterion, tolerance.fraction, estimate) if tolerance.error == "auto" else criterion
