"""What the solve loop tells its subscribers: history, progress, checkpoint.

A subscriber is any callable taking one event; it must not change the event's arrays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Iteration:
    """One finished iteration. ``HISTORY_COLUMNS`` of it go to history.csv.

    Parameters
    ----------
    iteration : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step so far, set-up included
    seconds : since the run began
    indicator : the paper's η, eq. (16), a squared ratio
    displacement_jump : ‖B w‖ relative, weighted by the search direction
    force_imbalance : ‖A f‖ relative, weighted by the inverse search direction
    residual : ‖s_new − s‖ relative
    error_bound : guaranteed bound on the relative energy error; nan when not evaluated
    open, stick, slip : node counts, summed over the steps (contact interfaces)
    target : name and value of what the run waits for, e.g. ("error_bound", 1e-6)
    macro_imbalance : largest |Cᵀf| over the interfaces, relative; 0 to rounding, eq. (17)
    true_error : against the undecomposed solution, relative energy norm; nan without one
    law_residual : with contact, the largest measure of ``law_residuals``; the next four are its parts
    discretisation_error : latest estimate of it, relative, energy norm; nan where there is none yet
    state : (dofs, steps) the state s to resume from
    """

    iteration: int
    sweeps: float
    seconds: float
    indicator: float
    displacement_jump: float
    force_imbalance: float
    residual: float
    error_bound: float
    open: int
    stick: int
    slip: int
    target: tuple[str, float]
    state: np.ndarray
    macro_imbalance: float = math.nan
    true_error: float = math.nan
    law_residual: float = math.nan
    penetration: float = math.nan
    tension: float = math.nan
    cone: float = math.nan
    slip_direction: float = math.nan
    discretisation_error: float = math.nan

    @property
    def tolerance(self) -> float:
        """The value that the run waits for; with ``error: auto`` it follows the estimate."""
        return self.target[1]


HISTORY_COLUMNS = [
    "iteration", "sweeps", "seconds", "indicator", "displacement_jump", "force_imbalance",
    "residual", "error_bound", "open", "stick", "slip",
    "macro_imbalance", "true_error", "law_residual", "penetration", "tension", "cone", "slip_direction",
    "tolerance", "discretisation_error",
]


@dataclass(frozen=True)
class Finished:
    """The loop has ended: ``stop_reason`` is "converged", "max_iterations", "stagnated", "interrupted" …"""

    converged: bool
    stop_reason: str
    iterations: int
