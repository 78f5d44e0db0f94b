"""Semismooth Newton's method for a load step of the coarse contact problem, searched along its
lines.

    (K₀ − ΣTᵀA L + δ) dy = −ρ(y),    y ← y + θ dy,    |dy·ρ(y + θ dy)| ≤ ½ |dy·ρ(y)|

A loose body feels nothing until it touches, then more than before: ‖ρ‖ does not tell how far to go.
The work of the imbalance along the line does (Matthies & Strang, Int. J. Numer. Meth. Engng 14,
1979): without friction it is the slope of a convex energy, negative up to its least value. A point
of the line costs the laws at the pairs, a tenth of what the line costs. The shift δ is none to
speak of unless friction makes a line rise from its start.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.coarse.load_step import Line, LoadStep

# shift relative to k: the first, by how much it grows, beyond what nothing is tried
LEAST, SLOWER, MOST = 1e-8, 100.0, 1e3
LEFT = 0.5  # work at the end of a step over that at its start; a closer search saves no steps
POINTS = 20  # of a line: regula falsi halves what is left in each but a few
# last step over all of them together, from which bodies have arrived: forces tell little of where
# loose ones are
SHORT = 1e-2
# the same where it costs no factors, so that loose bodies stand where they stand; steps to get
# there
FINE, FOLLOWED = 1e-3, 4


class Newton:
    """The iterates.

    at : the load step
    farthest : fields (bodies, n) → how far any body moves in them at most
    clipped : step (bodies, n) → the same, no longer than allowed; None: any is
    y, rho, size : (bodies, n) the fields, ρ and ‖ρ‖; start : ‖ρ‖ at the start
    change : (bodies, n) the last step; None before the first
    """

    def __init__(self, at: LoadStep, y: np.ndarray, farthest: Callable[[np.ndarray], float],
                 clipped: Callable[[np.ndarray], np.ndarray] | None = None):
        self.at, self.y, self.farthest, self.clipped = at, y, farthest, clipped
        self.rho = at.residual(y)
        self.start = self.size = np.linalg.norm(self.rho)
        self.change: np.ndarray | None = None
        self._whole = False

    def solved(self, reduction: float, goal: float = 0.0) -> bool:
        """Whether ‖ρ‖ has come down to a share of the start's, or to a goal, and bodies that all
        have a place hardly move any more.

        Where a whole step has led that far, steps by its own factors follow: they show as well that
        bodies have arrived.
        """
        if self.size > max(reduction * self.start, goal):
            return False
        if self.at.bodies.springs is None:
            return True
        if self._whole:
            self._follow()
        return self.start == 0 or self._last <= SHORT * self.farthest(self.y)

    @property
    def _last(self) -> float:
        return np.inf if self.change is None else self.farthest(self.change)

    def _follow(self) -> None:
        for _ in range(FOLLOWED):
            if self._last <= FINE * self.farthest(self.y):
                break
            change = -self._factors.solve(self.rho)
            y = self.y + change
            rho = self.at.residual(y)
            size = np.linalg.norm(rho)
            if size > self.size:
                self.at.residual(self.y)
                break
            self.y, self.rho, self.size, self.change = y, rho, size, change
        self._whole = False

    def step(self) -> bool:
        """Take a step; whether there was a direction for one."""
        matrix, shift = self.at.matrix(), LEAST
        while True:
            self._factors = self.at.factors(matrix, shift)
            dy = -self._factors.solve(self.rho)
            dy = dy if self.clipped is None else self.clipped(dy)
            work = np.vdot(dy, self.rho)
            if work < 0:
                break
            shift *= SLOWER
            if not shift <= MOST:
                return False
        line = Line(self.at, dy)
        length = search(line, work)
        self.change = length * dy
        self.y = self.y + self.change
        self.rho = line.end(length)
        self.size, self._whole = np.linalg.norm(self.rho), length == 1
        return True


def search(work: Callable[[float], float], first: float) -> float:
    """θ in (0, 1] where the work along a line has come down to a part of the first.

    Beyond the whole step's work comes the root of a parabola: it begins with the slope that makes
    the whole step Newton's, and bends up as pairs close on the way. Then the Illinois rule.
    """
    low, at_low, high, at_high, theta = 0.0, first, None, 0.0, 1.0
    before = 0
    for _ in range(POINTS):
        here = work(theta)
        # what is no number has no root
        if not abs(here) > LEFT * abs(first) or (here < 0 and high is None):
            break
        side = 1 if here > 0 else -1
        if side > 0:
            high, at_high, at_low = theta, here, at_low / (2 if before == side else 1)
        else:
            low, at_low, at_high = theta, here, at_high / (2 if before == side else 1)
        theta = low - at_low * (high - low) / (at_high - at_low)
        if not before:  # first + |first| θ + here θ² = 0
            theta = 2 / (1 + np.sqrt(1 + 4 * here / abs(first)))
        before = side
    return theta
