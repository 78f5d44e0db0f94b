"""Pretension: across a cut through a bolt the whole force along its axis is given, then the length
that goes with it.

The cut's sides do not move across the axis, and along it all of them by the same unknown d. With n
from side 1 to side 2, and the force N > 0 of a bolt that is pulled,

    tightened   Σ f̂·n = N,   d_n = d at all pairs:   d = (Σ F·n − N) / Σ keq_n,   f̂ = F − keq d n
    locked      d as at the end of the load step before:   f̂ = F − keq d_before

so that −d > 0 is what tightening has taken off the bolt's length. It is the pretension node of
other codes: one unknown per bolt and load step, which the local stage finds in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from orchestrator.config.base import Positive
from orchestrator.config.boundary import Entry
from orchestrator.laws.base import Law, Measure, Moves, Stages
from orchestrator.laws.perfect import Perfect
from orchestrator.laws.points import Answer, BONDED, Carries, Collective, Hold, Points, Status

TIGHTENED = Status(7, "tightened", "#D55E00", Hold.NEVER, Hold.ALWAYS)
LOCKED = Status(8, "locked", "#009E73", Hold.ALWAYS, Hold.ALWAYS)


class PretensionEntry(Entry):
    """The force of a bolt, and what comes after it."""

    force: Positive = Field(
        description="pretension, above 0: the force that pulls at the bolt while it is tightened")
    then: Literal["locked", "force"] = Field("locked", description=(
        "locked: from the load step after the last change of its history the bolt keeps its "
        "length; force: its force is what the history says at all load steps"))

    @property
    def scaled(self) -> tuple[str, ...]:
        return ("force",)

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        if raw.get("between") == "auto":
            yield ("between", "auto beside law: pretension",
                   "the names of the two parts that the force pulls together",
                   "name them, or name the bolt under bolts:")

    @classmethod
    def wrong_factors(cls, factors: Sequence[float]) -> tuple[str, str, str] | None:
        if min(factors) < 0:
            return (
                f"a factor of {min(factors):g}", "factors of 0 or above: a bolt pulls",
                "write positive factors")
        if not any(factors):
            return (
                "a bolt that is never tightened", "a factor above 0 at some load step",
                "write one, or leave the bolt out")
        return None

    def at_steps(self, factors: Sequence[float]) -> list[Entry]:
        """Before the history leaves zero the bolt is in place and holds by the length it has."""
        begun = next((t for t, x in enumerate(factors) if x), len(factors))
        last = next(t for t in range(len(factors)) if all(x == factors[t] for x in factors[t:]))
        last = len(factors) if self.then == "force" else last
        return [self.model_copy(update={"force": x * self.force if begun <= t <= last else None})
                for t, x in enumerate(factors)]


@dataclass(frozen=True, eq=False)
class Pretension(Law):
    """Pretension across a bolt's cut: its force is given, then its length.

    tightened: d = d n, Σ f·n = N;  locked: d = d at the load step before

    pull : N at this load step; None: the bolt keeps its length
    """

    pull: float | None

    name = "pretension"
    Parameters = PretensionEntry
    moves = Moves.AXIAL
    statuses = (TIGHTENED, LOCKED, BONDED)
    measures = (Measure("bolt_force", "bolt force", "max |Σ f·n − N| / N",
                        "bolts whose force is not what is prescribed"),)

    @classmethod
    def of(cls, entry: PretensionEntry, count: int, direction: float,
           distance: np.ndarray | None = None) -> Pretension:
        return cls(entry.force)

    @property
    def acts(self) -> bool:
        return bool(self.pull)

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        by_force = self.pull is not None
        return {"pull": np.full(len(chosen), self.pull if by_force else 0.0),
                "tightened": np.full(len(chosen), by_force)}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂ = F − keq d, interface by interface."""
        by_force = points["tightened"]
        group = np.unique(points.interface, return_inverse=True)[1]
        stiffness = np.bincount(group, weights=points.stiff_n)
        d = (np.bincount(group, weights=points.along(F))
             - _one_each(group, points["pull"])) / stiffness
        force = F - np.where(by_force, points.stiff_n * d[group] * points.normal,
                             points.stiffness(previous))
        answer = Perfect.force(points, force, previous, derivative)
        answer.status = np.where(by_force, TIGHTENED, LOCKED)
        if derivative:
            at = np.flatnonzero(by_force)
            share = (points.stiff_n / stiffness[group])[at]
            answer.collective = Collective(group[at], at, share * points.normal[:, at],
                                           points.normal[:, at])
        return answer

    @staticmethod
    def carries(points: Points) -> Carries:
        """Anything across the axis, and along it the force that is given, or any once the bolt is
        locked.
        """
        result, by_force = Carries.anything(len(points)), points["tightened"]
        result.motions = np.where(by_force, points.normal, 0.0)[None]
        result.works = np.where(by_force, points["pull"], 0.0)[None]
        return result

    @staticmethod
    def residuals(points: Points, at: Stages) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Distance of whole forces from the prescribed ones."""
        group = np.unique(points.interface, return_inverse=True)[1]
        pull = _one_each(group, np.where(points["tightened"], points["pull"], 0.0))
        found = np.stack([np.bincount(group, weights=f_n) for f_n in points.along(at.force)])
        off = np.abs(found - pull)[:, pull > 0] / pull[pull > 0]
        return np.abs(points.along(at.force)) / points.area, {"bolt_force": off}


def _one_each(group: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(groups,) what all points of a group share."""
    result = np.zeros(int(group.max(initial=-1)) + 1)
    result[group] = values
    return result
