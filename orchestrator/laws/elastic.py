"""Springs between the sides, distributed over the interface: glue, a gasket, a bed.

With the stiffnesses k_n and k_t per area, A a pair's share of it, and the force on side 1

    f̂_n = k_n A d_n,    f̂_t = k_t A d_t,    so that    f̂ = K/(keq + K) F,    K = k A

along the normal and across it. ``tension_only`` leaves the normal spring slack where the sides
approach, d_n < 0 or F_n < 0, which is the same; the tangential one always acts. A slack pair does
not keep the sides from passing through each other: that is what contact is for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from orchestrator.config.base import Positive
from orchestrator.config.boundary import Entry
from orchestrator.laws.base import Law, Measure, Stages, Written
from orchestrator.laws.points import Answer, BONDED, Carries, Hold, Points, Status, dot

SPRUNG = Status(4, "sprung", "#CC79A7", Hold.ALWAYS, Hold.ALWAYS)
TAUT = Status(5, "taut", "#56B4E9", Hold.PULLED, Hold.ALWAYS)
SLACK = Status(6, "slack", "#F0E442", Hold.NEVER, Hold.ALWAYS)


class ElasticEntry(Entry):
    """Springs along the normal and across it."""

    stiffness_n: Positive = Field(
        description="stiffness of the normal springs, above 0: force per area and per length")
    stiffness_t: Positive = Field(
        description="stiffness of the tangential springs, above 0: force per area and per length")
    tension_only: bool = Field(False,
                               description=(
                                   "true: normal springs are slack where the sides approach; "
                                   "tangential ones always act"))


@dataclass(frozen=True, eq=False)
class Elastic(Law):
    """Springs of the stiffness k per area, along the normal and across it.

    f_n = k_n A d_n,  f_t = k_t A d_t;  tension_only: f_n = k_n A max(d_n, 0)

    stiffness_n, stiffness_t : k_n and k_t, force/length³
    tension_only : normal springs are slack where the sides approach
    """

    stiffness_n: float
    stiffness_t: float
    tension_only: bool = False

    name = "elastic"
    Parameters = ElasticEntry
    convex = True
    statuses = (SPRUNG, TAUT, SLACK, BONDED)
    measures = (
        Measure("spring", "spring law", "max |f − k A d| k_eq / (k_eq + k A) / A / max |f| / A",
                "forces that do not belong to what the springs are stretched by",
                pressure=1),)

    @property
    def joins(self) -> bool:
        return not self.tension_only

    @property
    def rigidity(self) -> float:
        return min(self.stiffness_n, self.stiffness_t)

    def along(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness per area along the points' normal, stretched and slack.

        What is left of the normal beside prescribed components is shorter than 1: the rest of such
        an axis lies in the interface, where the tangential springs act.
        """
        across = (1 - length**2) * self.stiffness_t
        taut = length**2 * self.stiffness_n + across
        return taut, across if self.tension_only else taut

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        taut, slack = self.along(length)
        return {"taut": taut * area, "slack": slack * area, "across": self.stiffness_t * area,
                "loosens": np.full(len(chosen), self.tension_only)}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂ = K/(keq + K) F."""
        F_n, across = points.along(F), points["across"] / (points.stiff_t + points["across"])
        normal = _normal(points, F_n)
        normal = normal / (points.stiff_n + normal)
        answer = Answer(points.scaled(normal, across, F),
                        np.where(points["loosens"], np.where(F_n < 0, SLACK, TAUT), SPRUNG))
        if derivative:
            answer.active = np.arange(len(points))
            answer.derivative = points.blocks(normal, across)
        return answer

    @staticmethod
    def carries(points: Points) -> Carries:
        """Anything, but no push where springs are slack."""
        pulls, anything = Carries.pressed(points.normal, side=1.0,
                                          limit=np.inf), Carries.anything(len(points))
        slack = points["loosens"] & (points["slack"] == 0)
        anything.directions = np.where(slack, pulls.directions, anything.directions)
        anything.side = np.where(slack, pulls.side, 0.0)
        return anything

    @staticmethod
    def duality_gap(points: Points, force: np.ndarray, jump: np.ndarray,
                    previous: np.ndarray) -> np.ndarray:
        """½ (K d − f)·K⁻¹(K d − f), along the normal with what K is at d and at f."""
        d, f, across = points.along(jump), points.along(force), points["across"]
        here, there = _normal(points, d), _normal(points, f)
        stretch = np.divide(f, there, out=np.zeros_like(f), where=there > 0)
        normal = np.where(here == there, 0.5 * here * (d - stretch) ** 2,
                          0.5 * here * d**2 + 0.5 * there * stretch**2 - f * d)
        apart = points.across(jump) - points.across(force) / across
        return np.maximum(normal, 0.0) + 0.5 * across * dot(apart, apart)

    @staticmethod
    def residuals(points: Points, at: Stages) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The force that law and fields differ by."""
        normal = _normal(points, points.along(at.jump))
        pressure, spring = points.missed(at.force, at.jump, normal, points["across"])
        return pressure, {"spring": spring}

    def violations(self, at: Written, length: float, pressure: float) -> dict[str, float]:
        """Node by node, relative to the largest traction and to that of springs stretched by the
        largest displacement.
        """
        taut, slack = self.along(at.length)
        stiff = np.where(at.opening < 0, slack, taut)
        normal = -at.pressure * at.length - stiff * at.opening / at.length
        shear = np.linalg.norm(at.shear - self.stiffness_t * at.slip, axis=2)
        return {"the normal springs' law": np.max(np.abs(normal) / (pressure + stiff * length),
                                                  initial=0.0),
                "the tangential springs' law": np.max(shear, initial=0.0)
                / (pressure + self.stiffness_t * length)}


def _normal(points: Points, stretch: np.ndarray) -> np.ndarray:
    """(…, P) K along the normal, where the normal springs are stretched by something of this
    sign.
    """
    return np.where(stretch < 0, points["slack"], points["taut"])
