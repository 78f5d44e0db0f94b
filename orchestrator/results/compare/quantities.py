"""Quantities that are compared: numbers of one kind, and facts.

A difference is relative to the number itself, but where that is below ``SMALL`` of the largest of its kind in both folders to this
share: a reaction that is zero but for rounding differs by the rounding of the largest force, and not by all of itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

SMALL = 1e-2  # so that 1e-12 of the largest number, rounding, is 1e-10 of any
LENGTH, STRESS, FORCE, MOMENT, ENERGY = "length", "stress", "force", "moment", "energy"  # other kinds are called as their quantity


@dataclass(frozen=True)
class Quantity:
    """Numbers of one name, in one file.

    kind : with whose largest number it is compared
    values : numbers, of any shape
    where : what says in words where an entry (index into the first axis) is
    """

    name: str
    kind: str
    values: np.ndarray
    where: Callable[[int], str] = lambda index: ""


@dataclass(frozen=True)
class Difference:
    """Difference of what two folders have under one name.

    share : the largest difference, relative to the number itself; inf where there is nothing to compare with
    of_largest : the largest difference, relative to the largest number of the kind
    where : that is, in words; text : what differs, where it is no number
    """

    name: str
    share: float
    of_largest: float = 0.0
    where: str = ""
    text: str = ""


def apart(name: str, text: str, where: str = "") -> Difference:
    """A difference beyond comparison, and why."""
    return Difference(name, np.inf, np.inf, where, text)


class Scales:
    """The largest number of each kind so far; that of moments is at least that of forces times ``size``, a length."""

    def __init__(self) -> None:
        self._largest: dict[str, float] = {}
        self.size = 0.0

    def take(self, quantities: Iterable[Quantity]) -> None:
        """Look at further numbers."""
        for q in quantities:
            largest = float(np.abs(q.values[np.isfinite(q.values)]).max(initial=0.0))
            self._largest[q.kind] = max(self._largest.get(q.kind, 0.0), largest)

    def of(self, kind: str) -> float:
        """The scale that a difference of numbers of this kind is divided by."""
        largest = self._largest.get(kind, 0.0)
        return max(largest, self._largest.get(FORCE, 0.0) * self.size) if kind == MOMENT else largest


def numbers_differ(one: Quantity, other: Quantity, scales: Scales) -> Difference:
    """The largest difference of two quantities of the same name; numbers that neither knows are alike."""
    a, b = np.atleast_1d(one.values), np.atleast_1d(other.values)
    if a.shape != b.shape:
        return apart(one.name, "{} numbers, {} there".format(*(" × ".join(map(str, x.shape)) for x in (a, b))))
    unknown = np.isnan(a) & np.isnan(b)
    with np.errstate(invalid="ignore"):
        gap = np.where(unknown | (a == b), 0.0, np.abs(a - b))
    gap = np.where(np.isfinite(gap), gap, np.inf)
    if not gap.any():
        return Difference(one.name, 0.0)
    scale = scales.of(one.kind)
    size = np.fmax(np.fmax(np.abs(a), np.abs(b)), SMALL * scale)
    worst = int(gap.reshape(len(a), -1).max(axis=1).argmax())
    share = np.divide(gap, size, out=np.zeros_like(gap), where=gap > 0)
    return Difference(one.name, float(share.max()), float(gap.max() / scale), one.where(worst))
