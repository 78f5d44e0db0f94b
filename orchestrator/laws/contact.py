"""Unilateral contact with Coulomb friction, closed form (Oumaziz et al., Comput. Mech. 60, 2017).

With p = F_n + keq_n g₀ the normal force if the gap were closed (negative in compression):

    p ≥ 0   open   f̂ = 0
    p < 0   closed f̂_n = p, and with T = F_t − keq_t d_t(previous step)
            |T| ≤ μ|p|  stick  f̂_t = T
            else        slip   f̂_t = μ|p| T/|T|

Friction 0 is a slip without resistance: f̂_t = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from orchestrator.compiled import in_parts
from orchestrator.config.base import Positive, either
from orchestrator.config.boundary import Entry, ROUND
from orchestrator.laws.base import Law, Measure, Stages, Written
from orchestrator.laws.contact_loops import forces, OPENS, slopes, SLIPS, STICKS
from orchestrator.laws.points import Answer, BONDED, Carries, Hold, Points, Status, dot, norm

TOUCHES = 1e-13  # of the gap, and of what a force is worth in jumps, below which sides touch
WORTH = 1 << 13  # pairs, whose forces take several times as long as to hand them out to a thread

OPEN = Status(OPENS, "open", "#d0d0d0", Hold.NEVER, Hold.NEVER)
STICK = Status(STICKS, "stick", "#0072B2", Hold.PRESSED, Hold.PRESSED)
SLIP = Status(SLIPS, "slip", "#E69F00", Hold.PRESSED, Hold.NEVER)

Gap = either(Literal["geometry"], float, lambda value: isinstance(value, str),
             "a number, or geometry")


class ContactEntry(Entry):
    """Unilateral contact with Coulomb friction."""

    friction: float | None = Field(None, ge=0,
                                   description="Coulomb's coefficient, 0 or above; none: 0")
    gap: Gap | None = Field(None, description=(
        "initial gap, negative for a press fit, or geometry: as far as the sides are apart; none: "
        "0, and geometry beside between: auto"))
    within: Positive | None = Field(None,
                                    description=(
                                        "search distance of gap: geometry, a length; none: twice "
                                        "the local element size"))
    pairing: Literal["auto", "fixed", "follow"] = Field("auto", description=(
        "fixed: what lies opposite each other before loading stays paired, for sliding below an "
        "element; follow: paired anew where the sides have slid to, load step after load step; "
        "auto: fixed, and solved again with those that follow that have slid by more than a fifth "
        "of an element, where they can"))

    @property
    def apart(self) -> str:
        return "gap" if self.gap == "geometry" or ((self.found or self.tool)
                                                   and self.gap is None) else ""

    @property
    def reach(self) -> float | None:
        return ROUND * self.within if self.within else None

    @property
    def scaled(self) -> tuple[str, ...]:
        return ("gap",) if isinstance(self.gap, float | int) else ()

    @property
    def follows(self) -> bool:
        return self.pairing == "follow"

    @property
    def fit(self) -> float:
        return 0.0 if self.apart else max(-(self.gap or 0.0), 0.0)

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        between = raw.get("between")
        with_tool = isinstance(between, list) and any(isinstance(side, dict) for side in between)
        read = raw.get("gap") == "geometry" or (raw.get("gap") is None
                                                and (between == "auto" or with_tool))
        if raw.get("history") is not None and not with_tool and (read or not raw.get("gap")):
            yield ("history", "history without a gap to multiply",
                   "history beside a gap that is a number other than 0",
                   "give the gap as a number, or remove the history")
        if raw.get("within") is not None and not read:
            yield ("within", "within without gap: geometry", "within beside gap: geometry only",
                   "remove within, or write gap: geometry")


@dataclass(frozen=True, eq=False)
class Contact(Law):
    """Unilateral contact with Coulomb friction.

    g = g₀ + n·d ≥ 0,  p = −n·f/A ≥ 0,  g p = 0;  |f_t| ≤ μ p A,  where less: no slip, where
    equal: slip along f_t

    friction : Coulomb's coefficient
    distance : (n,) initial gap along the normal, negative where the parts are pressed into each
        other
    """

    friction: float
    distance: np.ndarray

    name = "contact"
    Parameters = ContactEntry
    statuses = (OPEN, STICK, SLIP, BONDED)
    measures = (Measure("penetration", "penetration", "max −(g₀ + n·d) / ℓ",
                        "sides inside each other", length=1),
        Measure("tension", "tension", "max (n·f / A) / max pressure", "sides that pull each other",
                pressure=1),
        Measure("cone", "cone violation", "max (|f_t| − μ |f_n|) / A / max pressure",
                "more friction than Coulomb's law allows", pressure=1),
        Measure("slip_direction", "slip direction",
                "max (|f_t| |Δs| − f_t·Δs) / A / (max pressure · ℓ)",
                "friction that does not oppose the slip Δs", length=1, pressure=1))

    slips = True

    @property
    def convex(self) -> bool:
        return self.friction == 0

    @classmethod
    def of(cls, entry: ContactEntry, count: int, direction: float,
           distance: np.ndarray | None = None) -> Contact:
        if entry.apart:  # faces that are shared touch: a gap read from the geometry is zero there
            gap = np.zeros(count) if distance is None else distance
        else:
            gap = np.full(count, float(entry.gap or 0.0))
        return cls(float(entry.friction or 0.0), gap)

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        """Beside a shorter normal both the gap and the coefficient are larger."""
        return {"gap": self.distance[chosen] / length, "friction": self.friction / length}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """The force a contact carries; the tangential part of ``previous`` is where friction
        sticks.
        """
        F, previous = np.ascontiguousarray(F), np.ascontiguousarray(previous)
        given = (*points.search, points["gap"], points["friction"]), F, previous
        force, status = np.empty(F.shape), np.empty(len(points), int)
        in_parts(forces, len(points), *given, force, status, part=WORTH)
        if not derivative:
            return Answer(force, status)
        active = np.flatnonzero(status != OPEN)
        slope = np.empty((3, 3, len(active)))
        in_parts(slopes, len(active), *given, active, slope, part=WORTH)
        return Answer(force, status, active, slope)

    loops = force

    @staticmethod
    def carries(points: Points) -> Carries:
        """Any pressure, as gaps may close, and friction that goes with it."""
        return Carries.pressed(points.normal, points["friction"], apart=points["gap"])

    @staticmethod
    def duality_gap(points: Points, force: np.ndarray, jump: np.ndarray,
                    previous: np.ndarray) -> np.ndarray:
        """p g, and what friction at most s = μ p would take of the slip Δ beyond what the force
        does: s |Δ| − f_t·Δ.
        """
        push, slip, shear = -points.along(force), points.across(jump - previous), points.across(
            force)
        opened = points["gap"] + points.along(jump)
        opened = np.where(opened > TOUCHES
                          * (np.abs(points["gap"]) + np.abs(push) / points.stiff_n), opened, 0.0)
        far, size = norm(slip), norm(shear)
        size = np.where(size > TOUCHES * np.abs(push), size, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            way = np.where(size > 0, shear / size, 0.0)
            along = dot(slip, way)
            aside = slip - along * way
            # |Δ| − e·Δ without a difference
            lost = np.where(along > 0, dot(aside, aside) / (far + along), far - along)
        return push * opened + np.maximum(points["friction"] * push - size,
                                          0.0) * far + np.where(size > 0, size * lost, 0.0)

    @staticmethod
    def residuals(points: Points, at: Stages) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Pressures, and the four measures; load step after load step, as arrays of all are no
        better than memory.
        """
        gap, friction, largest = points["gap"], points["friction"], []
        for t, (force, jump, answered,
                status) in enumerate(zip(at.force, at.jump, at.answered, at.status)):
            traction, slip = force / points.area, points.across(
                answered - (at.answered[t - 1] if t else at.before))
            pressed, shear = points.along(traction), points.across(traction)
            size, inside = norm(shear), -(gap + points.along(jump))
            inside = np.where(inside > TOUCHES * np.abs(gap), inside, 0.0)
            rubbed = np.where((status == SLIPS) & (friction > 0),
                              size * norm(slip) - dot(shear, slip), 0.0)
            largest.append([np.max(x, initial=0.0) for x in (np.abs(pressed), inside, pressed,
                                                             size - friction
                                                             * np.maximum(-pressed, 0.0), rubbed)])
        pressure, *measures = np.max(np.reshape(largest, (-1, 5)), axis=0)[:, None]
        return pressure, dict(zip(("penetration", "tension", "cone", "slip_direction"), measures))

    def violations(self, at: Written, length: float, pressure: float) -> dict[str, float]:
        """Node by node: no penetration, no tension, Coulomb's cone, no pressure across an open
        gap.
        """
        gap, push = (self.distance[at.chosen] + at.opening) / length, at.pressure / pressure
        shear = np.linalg.norm(at.shear, axis=2) / pressure
        return {"penetration": np.max(-gap, initial=0.0), "tension": np.max(-push, initial=0.0),
            "Coulomb's cone": np.max(shear - self.friction * np.maximum(push, 0.0), initial=0.0),
            "complementarity": np.max(np.minimum(gap, push), initial=0.0)}
