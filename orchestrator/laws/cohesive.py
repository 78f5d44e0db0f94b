"""Glue that breaks: a bilinear law of traction and separation, with a damage that load steps leave
behind.

With the stiffness K per area, the strength σ and the toughness G, A a pair's share of the area, and
on side 1

    δ = (⟨d·n⟩² + |d_t|²)^½,   κ = the largest δ so far,   δ₀ = σ/K,   δ₁ = 2G/σ
    D = 0 for κ ≤ δ₀,    D = δ₁ (κ − δ₀) / (κ (δ₁ − δ₀)) up to κ = δ₁,    D = 1 beyond
    f̂ = (1 − D) K A d,   but f̂·n = K A d·n where the sides are pressed together

the traction grows to σ at δ₀, falls to 0 at δ₁, and G is the area below. Unloading goes straight
back to the origin. D is the law's own variable; κ follows from it. With F = f̂ + keq d and s(κ) = A
σ (δ₁ − κ)/(δ₁ − δ₀) = (1 − D) K A κ, a pair whose damage grows has the κ for which

    (⟨F·n⟩ / (k_n κ + s))² + (|F_t| / (k_t κ + s))² = 1

decreasing and convex in κ where the law falls more slowly than keq rises, so that Newton's method
goes there from below. Where it falls faster the pair breaks at once.

Reference: Camanho & Dávila, NASA/TM-2002-211737 (2002), for equal strengths and toughnesses of all
modes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Positive
from orchestrator.config.boundary import Entry
from orchestrator.laws.base import Law, Measure, Stages, Written
from orchestrator.laws.points import Answer, BONDED, Carries, Hold, Points, Status, dot, norm

INTACT = Status(9, "intact", "#66A61E", Hold.ALWAYS, Hold.ALWAYS)
DAMAGED = Status(10, "damaged", "#E7298A", Hold.ALWAYS, Hold.ALWAYS)
BROKEN = Status(11, "broken", "#A6761D", Hold.PRESSED, Hold.NEVER)
STEPS = 50  # of Newton's method, which doubles its digits in each; it stops when nothing moves
FINAL = 1e-14  # change of κ, relative, that is none


class CohesiveEntry(Entry):
    """Glue that breaks."""

    stiffness: Positive = Field(
        description="stiffness of the undamaged glue, above 0: force per area and per length")
    strength: Positive = Field(description="largest traction, above 0: force per area")
    toughness: Positive = Field(
        description="energy per area that breaking takes, above strength²/(2 stiffness)")

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        given = [raw.get(key) for key in ("stiffness", "strength", "toughness")]
        if all(isinstance(x, int | float) and x > 0 for x in given):
            stiffness, strength, toughness = given
            if toughness <= (least := strength**2 / (2 * stiffness)):
                yield ("toughness",
                       f"toughness {toughness:g} of glue that has stored {least:g} when it begins "
                       "to yield",
                       "a toughness above strength²/(2 stiffness)",
                       f"raise it above {least:g}, or raise the stiffness")


@dataclass(frozen=True, eq=False)
class Cohesive(Law):
    """Glue that breaks: traction up to the strength, then less, until the toughness is spent.

    f = (1 − D) K A d, D from the largest δ so far;  pressed: f_n = K A d_n

    stiffness : K, force/length³; strength : σ, force/length²; toughness : G, force/length
    """

    stiffness: float
    strength: float
    toughness: float

    name, Parameters = "cohesive", CohesiveEntry
    statuses = (INTACT, DAMAGED, BROKEN, BONDED)
    variables = ("damage",)  # 0 where the glue is whole, 1 where it is broken
    measures = (
        Measure("glue", "glue",
                "max |f − (1 − D) K A d| k_eq / (k_eq + (1 − D) K A) / A / max |f| / A",
                "forces that do not belong to how far the glue is drawn", pressure=1),)

    @property
    def rigidity(self) -> float:
        return self.stiffness

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        first, last = self.strength / self.stiffness, 2 * self.toughness / self.strength
        return {"stiff": self.stiffness * area, "first": np.full(len(area), first),
                "last": np.full(len(area), last)}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂, and the damage that it leaves."""
        before, stiff = points["damage"], points["stiff"]
        F_n = points.along(F)
        pull, F_t = np.maximum(F_n, 0.0), F - F_n[..., None, :] * points.normal
        shear = norm(F_t)
        kappa = _reached(points, before)
        whole = (1 - before) * stiff
        grows = np.flatnonzero(np.hypot(pull / (points.stiff_n + whole),
                                        shear / (points.stiff_t + whole)) > kappa)
        kappa[grows] = _grown(points.some(grows), kappa[grows], pull[grows], shear[grows])
        damage = before.copy()
        damage[grows] = _damage(points["first"], points["last"], kappa)[grows]
        across = (1 - damage) * stiff
        normal = np.where(F_n > 0, across, stiff)
        along, aside = normal / (points.stiff_n + normal), across / (points.stiff_t + across)
        answer = Answer(points.scaled(along, aside, F),
                        np.where(damage >= 1, BROKEN, np.where(damage > 0, DAMAGED, INTACT)),
                        own={"damage": damage})
        if derivative:
            answer.active = np.arange(len(points))
            answer.derivative = points.blocks(along, aside)
            at = grows[damage[grows] < 1]
            answer.derivative[..., at] += _softening(points.some(at), kappa[at],
                                                     np.where(F_n > 0, F_n, 0.0)[at], F_t[:, at])
        return answer

    @staticmethod
    def carries(points: Points) -> Carries:
        """Any pressure, and a pull or a shear up to what the damage of the load step before has
        left.
        """
        result = Carries.anything(len(points))
        result.side = np.full(len(points), -1.0)
        result.limit = _falls(points) * (points["last"] - _reached(points, points["damage"]))
        return result

    @staticmethod
    def residuals(points: Points, at: Stages) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The force that law and fields differ by."""
        d_n, across = points.along(at.jump), (1 - at.own["damage"]) * points["stiff"]
        normal = np.where(d_n > 0, across, points["stiff"])
        pressure, glue = points.missed(at.force, at.jump, normal, across)
        return pressure, {"glue": glue}

    def violations(self, at: Written, length: float, pressure: float) -> dict[str, float]:
        """Node by node, relative to the largest traction and to that of whole glue drawn by the
        largest displacement.
        """
        left = (1 - at.own["damage"]) * self.stiffness
        normal = -at.pressure * at.length - np.where(at.opening > 0, left,
                                                     self.stiffness) * at.opening / at.length
        shear = np.linalg.norm(at.shear - left[..., None] * at.slip, axis=2)
        worst = max(np.abs(normal).max(initial=0.0), shear.max(initial=0.0))
        return {"the glue's law": worst / (pressure + self.stiffness * length)}


def _damage(first: np.ndarray, last: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """D of the largest separation κ."""
    return np.clip(last * (kappa - first) / (kappa * (last - first)), 0.0, 1.0)


def _reached(points: Points, damage: np.ndarray) -> np.ndarray:
    """κ that has left a damage; δ₀ where there is none."""
    first, last = points["first"], points["last"]
    return first * last / (last - damage * (last - first))


def _falls(points: Points) -> np.ndarray:
    """A σ/(δ₁ − δ₀): how fast the force falls."""
    return points["stiff"] * points["first"] / (points["last"] - points["first"])


def _grown(points: Points, kappa: np.ndarray, pull: np.ndarray, shear: np.ndarray) -> np.ndarray:
    """κ of pairs whose damage grows from that of ``kappa``."""
    last, falls = points["last"], _falls(points)
    slopes = points.stiff_n - falls, points.stiff_t - falls
    for _ in range(STEPS):
        s = falls * (last - kappa)
        N, M = points.stiff_n * kappa + s, points.stiff_t * kappa + s
        n, m = (pull / N) ** 2, (shear / M) ** 2
        slope = -2 * (n / N * slopes[0] + m / M * slopes[1])
        step = np.where(slope < 0, (1 - n - m) / np.where(slope < 0, slope, 1.0), last)
        moved = np.clip(kappa + step, kappa, last)
        still = (moved - kappa <= FINAL * last).all()
        kappa = moved
        if still:
            break
    return kappa


def _softening(points: Points, kappa: np.ndarray, F_n: np.ndarray, F_t: np.ndarray) -> np.ndarray:
    """(3, 3, Q) what ∂f̂/∂F has beside that at constant damage: by how much κ grows, and what that
    takes from f̂.
    """
    falls = _falls(points)
    s = falls * (points["last"] - kappa)
    N, M = points.stiff_n * kappa + s, points.stiff_t * kappa + s
    slope_n, slope_t = points.stiff_n - falls, points.stiff_t - falls
    pulled = (F_n / N**2) * points.normal + F_t / M**2
    growth = pulled / (F_n**2 / N**3 * slope_n + dot(F_t, F_t) / M**3 * slope_t)
    taken = F_n * (falls * N + s * slope_n) / N**2 * points.normal + (
        falls * M + s * slope_t) / M**2 * F_t
    return -taken[:, None, :] * growth
