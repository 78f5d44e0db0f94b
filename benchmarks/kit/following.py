"""Contact cases: no undecomposed reference exists, so each run is judged by the solution it tends to.

The solution of a frictional problem need not be unique. Every run is therefore repeated on the same soles, by the defaults
and to a smaller tolerance; the error of each of its iterations is the relative distance of the interface state s from that
end's: s has the displacements and the forces of all sides, the latter over the search direction. Where the repetition gets no
further than the run, the end is not known, and neither are errors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.kit.study import Case, History, Study, first
from orchestrator import Iteration, Scene, Solution, Subscriber, config_from, solve

OWN = 1e-7  # law residual of a run that is its own end: a tenth of the smallest error that counts
BETTER = 0.1  # law residual of an end, over the run's own, from which errors may be measured against it
CONTINUED = 600  # iterations at most, to find where a run tends to
LEVELS = (1e-1, 1e-2, 1e-3, 1e-6)
STATUSES = ("open", "stick", "slip")


class States(Subscriber):
    """The interface state s of every iteration, in single precision."""

    wants_states = True

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def iteration(self, event: Iteration) -> None:
        self.seen.append(event.state.astype(np.float32))

    def errors(self, end: np.ndarray) -> np.ndarray:
        """Relative distance of every iteration from a state."""
        return np.array([np.linalg.norm(state - end) / np.linalg.norm(end) for state in self.seen])


@dataclass(frozen=True)
class Followed:
    """A contact case and the solution it tends to.

    Parameters
    ----------
    solved : the run itself
    history : its own, with the column true_error
    end : where it tends to
    seconds : of the run alone, with its mesh
    """

    solved: Solution
    history: History
    end: Solution
    seconds: float

    @property
    def scene(self) -> Scene:
        return self.solved.scene

    def sweeps_to(self, quantity: str, value: float) -> int | None:
        """Back-substitutions per subdomain, over all load steps and without set-up, until a quantity is at most ``value``."""
        found = first(self.history, quantity, value)
        return found and found * self.scene.steps


def follow(study: Study, case: Case, beside: Followed | None = None, *, continued: int = CONTINUED) -> Followed:
    """Solve a case, find its end, add its row and its curves.

    Parameters
    ----------
    beside : the row says how far the end is from this one's
    continued : iterations at most of the repetition
    """
    states, begin = States(), time.perf_counter()
    with study.console.status(str(case)), np.errstate(over="ignore", invalid="ignore"):  # some cases diverge
        scene = study.scene(case.config)
        solved = solve(config_from(dict(case.config)), scene, [states])
        seconds = time.perf_counter() - begin
        end, errors = _end(case.config, solved, states, continued)
    history = {**solved.history, "true_error": errors}
    followed = Followed(solved, history, end, seconds)
    summary = solved.summary
    row = {"subdomains": summary["subdomains"], "dofs": summary["dofs"], "steps": scene.steps, "iterations": solved.iterations,
           **{f"sweeps_{level:.0e}": followed.sweeps_to("true_error", level) for level in LEVELS},
           "true_error": float(errors[-1]), "law_residual": float(history["law_residual"][-1]),
           "indicator": float(history["indicator"][-1]), "end_law_residual": float(end.history["law_residual"][-1]),
           **(apart(end, beside.end) if beside else {}), **{name: int(end.history[name][-1]) for name in STATUSES},
           "stop_reason": solved.stop_reason, "seconds": round(seconds, 2)}
    study.add(case, row, history, f"law residual {row['law_residual']:.1e}, error {row['true_error']:.1e}")
    return followed


def apart(one: Solution, other: Solution) -> dict[str, Any]:
    """Relative distance of two solutions' displacements, and how many statuses differ."""
    gap = np.linalg.norm(one.displacement - other.displacement) / np.linalg.norm(other.displacement)
    return {"apart": float(gap), "other_statuses": int((one.interfaces.status != other.interfaces.status).sum())}


def _end(config: Mapping[str, Any], solved: Solution, states: States, continued: int) -> tuple[Solution, np.ndarray]:
    """Where a run tends to: itself if it came there; else repeated with the defaults, on its own soles; and its errors."""
    if solved.converged or solved.history["law_residual"][-1] <= OWN:
        return solved, states.errors(states.seen[-1])
    method = {"tolerance": config["method"]["tolerance"], "max_iterations": continued, "sole": config["method"].get("sole", {})}
    last = States()
    end = solve(config_from({**config, "method": method}), solved.scene, [last])
    if end.history["law_residual"][-1] < BETTER * solved.history["law_residual"][-1]:
        return end, states.errors(last.seen[-1])
    return solved, np.full(len(states.seen), math.nan)  # nothing better is known
