"""Errors of an answer in the energy norm, whoever finds them: one class, so that all are told
alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchestrator.config.method import ROUNDING


@dataclass(frozen=True)
class ErrorEstimate:
    """An error, T load steps.

    kind : what finds it: "bound" of bonded parts (``stopping.bound``), "certificate" of laws
        (``stopping.certificate``), "mesh" (``stopping.discretisation``); "": nothing does
    relative : the largest over the largest energy norm; nan: not known, infinite: more than was
        asked about
    factor : with which it is a bound: 1 where it is one by itself; nan: it is an estimate
    steps : (T,) energy norms, times ``factor`` where that is known; None: not known
    size : energy norm that ``relative`` is over
    cells : (T, m) each cell's share; √Σ cells² at the worst load step is ``relative``
    leaps : (T,) share of leaps between bonded sides in that sum of squares
    """

    kind: str
    relative: float
    factor: float
    steps: np.ndarray | None
    size: float
    cells: np.ndarray | None = field(default=None, kw_only=True)
    leaps: np.ndarray | float = field(default=0.0, kw_only=True)

    @property
    def guaranteed(self) -> bool:
        """Whether it is a bound."""
        return not np.isnan(self.factor)

    @property
    def word(self) -> str | None:
        """How it is known; None: it is not."""
        return None if not np.isfinite(
            self.relative) else "guaranteed" if self.guaranteed else "estimated"


@dataclass(frozen=True)
class Judged(ErrorEstimate):
    """The error of an iterate, with the admissible fields that it is measured with.

    a : the displacement part alone, relative
    energy : (T,) ‖u_D‖²_K
    repositioned : (T, modes) rigid motions c of the floating subdomains
    correction : (T, B) δ, what brings u + R c to u_D, or v, on the boundary dofs
    sweeps : back-substitutions spent per subdomain and load step, those for the softness with the
        first that needs it
    least : of an error that is larger than what was asked about, and therefore not known
        (infinite), what it is at least
    pair : v and λ̂ of a certificate
    dual : S⁺h of a certificate, as well as its error needs it; None where that is not known
    """

    a: float
    energy: np.ndarray
    repositioned: np.ndarray
    correction: np.ndarray
    sweeps: float = 0.0
    least: float = 0.0
    pair: Any = None
    dual: Any = None

    @classmethod
    def joined(cls, batches: Sequence[Judged]) -> Judged:
        """Return what is known of all load steps from batches of them, in order; bonded parts have
        one batch.
        """
        def stacked(name: str) -> np.ndarray:
            return np.concatenate([getattr(b, name) for b in batches])

        last = replace(batches[-1], **{name: stacked(name)
                                       for name in ("energy", "repositioned", "correction")})
        if last.pair is None:
            return last
        steps, size, duals = stacked("steps"), max(b.size for b in batches), [b.dual
                                                                              for b in batches]
        return replace(last, relative=relative(float(steps.max()), size), size=size, steps=steps,
                       factor=float(np.max([b.factor for b in batches])),
                       a=max(b.a for b in batches), sweeps=sum(b.sweeps for b in batches),
                       pair=last.pair.joined([b.pair for b in batches]),
                       dual=None if None in duals else last.dual.joined(duals))


def relative(error: float, size: float) -> float:
    """error / ‖u_exact‖, with ‖u_exact‖ ≥ ‖u_D‖ − error: infinite while the error is that large.

    What rounding may add is part of it, so that no tolerance below ``ROUNDING`` is ever reported as
    met.
    """
    if error == 0:
        return 0.0
    return float(np.hypot(error / (size - error), ROUNDING)) if size > error else np.inf
