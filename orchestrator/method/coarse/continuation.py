"""Pseudo-transient continuation for a load step of the coarse contact problem whose bodies all have a place, if by weak springs.

    (K₀ − ΣTᵀA L + δ) dy = −ρ(y),    y ← y + dy

(Kelley & Keyes, SIAM J. Numer. Anal. 35, 1998, with δ = 1/Δt.) The shift δ falls with the imbalance, and faster, so that
what is left is Newton's method; it grows where a step raises the imbalance. Steps may raise it a little: a loose body
feels nothing until it touches, then more than before. That is why ‖ρ‖ is not what a line search could go by.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.coarse.load_step import LoadStep

FIRST, LEAST, MOST = 1e-5, 1e-8, 1e3  # shift relative to k: the first, that of Newton's method, beyond what nothing is tried
RISE = 1.2  # growth of the imbalance in one step that is still accepted
FASTER, SLOWER = 3.0, 10.0  # a step that is accepted divides the shift by this and more; one that is not multiplies it
SHORT = 0.1  # last step over all of them together, from which bodies have arrived: forces tell little of where loose ones are
PATIENCE, GAIN = 15, 0.9  # steps in which the least imbalance has to fall by a tenth


class Continuation:
    """The iterates.

    Parameters
    ----------
    at : the load step
    direction : (matrix values, ρ, δ) → (bodies, 12) the step dy, no longer than allowed
    farthest : fields (bodies, 12) → how far any body moves in them at most

    Attributes
    ----------
    start, size : ‖ρ‖ at the start and the least so far; y : (bodies, 12) the fields that have it
    """

    def __init__(self, at: LoadStep, y: np.ndarray, direction: Callable[..., np.ndarray],
                 farthest: Callable[[np.ndarray], float]):
        self.at, self.direction, self.farthest, self.shift = at, direction, farthest, FIRST
        self.y = self._here = y
        self._rho = at.residual(y)
        self.start = self.size = self._size = np.linalg.norm(self._rho)
        self._matrix, self._waited, self._mark, self._last = None, 0, self.size, np.inf

    def solved(self, reduction: float) -> bool:
        """Whether ‖ρ‖ has come down to a share of the start's, and the bodies hardly move any more."""
        if self.size > reduction * self.start:
            return False
        return self.start == 0 or self._last <= SHORT * self.farthest(self.y)

    def step(self) -> str:
        """Take a step, or raise the shift; why there is no other, or nothing."""
        if self._matrix is None:
            self._matrix = self.at.matrix()
        dy = self.direction(self._matrix, self._rho, self.shift)
        trial = self._here + dy
        rho = self.at.residual(trial)
        size = np.linalg.norm(rho)
        if size <= RISE * self._size:
            self.shift = max(self.shift * min(size / self._size, 1.0) / FASTER, LEAST)
            self._here, self._rho, self._size, self._matrix = trial, rho, size, None
            if size < self.size:
                self.y, self.size, self._last = trial, size, self.farthest(dy)
        else:
            self.shift *= SLOWER
            if not self.shift <= MOST:
                return "no direction"
        self._waited += 1
        if self.size <= GAIN * self._mark:
            self._waited, self._mark = 0, self.size
        return "stalled" if self._waited >= PATIENCE else ""
