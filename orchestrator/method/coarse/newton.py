"""Semismooth Newton's method for one load step of the coarse contact problem, made to go downhill.

    (K₀ − ΣTᵀA L + δ) dy = −ρ(y),    y ← y + θ dy,  θ = 1, ½, ¼

A step is taken if it brings ‖ρ‖ down by a fifth of θ; if none does, the Levenberg shift δ grows. ``Stall`` tells when
that gains nothing any more.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.coarse.load_step import LoadStep

LEVENBERG = 1e-4  # first shift of the Newton matrix, relative to k; raised where a step fails
RAISE, MOST = 30.0, 1e3  # by how much, and beyond what no step is tried any more
LENGTHS = (1.0, 0.5, 0.25)
GAIN = 0.2  # share of ‖ρ‖ that a whole step must gain
FLAT = 1.001  # growth of ρ that still counts as standing still
STILL = 0.99  # an accepted step that leaves this much of ρ has gained next to nothing
SLOW, IDLE = 0.9, 2  # two steps that gain less than a tenth each are a stall


class Newton:
    """The iterates of Newton's method.

    at : the load step
    direction : (matrix values, ρ, δ) → (bodies, n) the step dy, no longer than allowed
    y, rho, size : (bodies, n) fields, their ρ, and ‖ρ‖
    still : the last accepted step gained next to nothing
    """

    def __init__(self, at: LoadStep, y: np.ndarray, direction: Callable[..., np.ndarray]):
        self.at, self.direction, self.still = at, direction, False
        self.move_to(y)

    def move_to(self, y: np.ndarray) -> None:
        """Go on from other fields, with the first shift again."""
        self._accept(y, self.at.residual(y))
        self.shift = LEVENBERG

    def step(self) -> bool:
        """Take a step, or raise the shift; False once no shift helps."""
        if self.matrix is None:
            self.matrix = self.at.matrix()
        dy = self.direction(self.matrix, self.rho, self.shift)
        for theta in LENGTHS:
            trial = self.y + theta * dy
            rho = self.at.residual(trial)
            size = np.linalg.norm(rho)
            # a loose body feels nothing until it touches: once the shift is raised, standing still is allowed
            flat = theta == 1 and self.shift > LEVENBERG and size <= FLAT * self.size
            if size <= (1 - GAIN * theta) * self.size or flat:
                self.still = size > STILL * self.size
                self._accept(trial, rho)
                return True
        self.still = False
        self.shift *= RAISE
        return self.shift <= MOST

    def _accept(self, y: np.ndarray, rho: np.ndarray) -> None:
        self.y, self.rho, self.size, self.matrix = y, rho, np.linalg.norm(rho), None


class Stall:
    """Notices steps in a row that gain less than a tenth each."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what has been seen."""
        self._slow, self._before = 0, np.inf

    def seen(self, size: float) -> bool:
        """Take in ‖ρ‖ before a step; whether the last ones have stalled."""
        self._slow = self._slow + 1 if size > SLOW * self._before else 0
        self._before = size
        return self._slow >= IDLE
