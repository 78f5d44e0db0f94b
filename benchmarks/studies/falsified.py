"""One reply of FreeFEM falsified by a thousandth, anywhere: the run ends, says so, or is right all the same.

A real process between the pipes changes one value, or all values, of one reply: of a matrix, of a factorisation's word, of
traces, of fields. What counts is the result: exit code 0 with an error above ten times the tolerance must not occur. The
error is the energy of the difference, summed over the tets, to a solution without fault.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.commands import environment
from benchmarks.kit.drawing import BLUE, GREEN, GREY, panels
from benchmarks.kit.elasticity import energy
from benchmarks.kit.study import Case, Study
from benchmarks.problems.hard_scenes import blocks, slices
from orchestrator import BlackBoxError, Scene, Solution, config_from, solve

TOLERANCE, SIZE, TIMES = 1e-6, 1e-3, 10.0
KINDS = ("stiffness", "load", "fields", "traces")
PLACES = 100
PROBLEMS: dict[str, Mapping[str, Any]] = {
    "bonded": {**slices(), "boundary": [{"on": {"plane": "x", "at": 0.0}, "displacement": [0, 0, 0]},
                                        {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 0.0, 10.0]}]},
    "contact": blocks([[0, 0, -0.002], [0.002, 0, -0.002]]),
}


def run(study: Study, places: int = PLACES, seed: int = 1) -> None:
    """Random places of both problems, kinds of replies in turn.

    Parameters
    ----------
    places : falsified runs in all
    """
    study.columns = ("problem", "kind", "how", "number", "outcome", "error", "message")
    random = np.random.default_rng(seed)
    sound = {name: _sound(study, data) for name, data in PROBLEMS.items()}
    for place in range(places):
        name = list(PROBLEMS)[place // len(KINDS) % len(PROBLEMS)]
        exact, counts, own = sound[name]
        kind, how = KINDS[place % len(KINDS)], ("entry", "reply")[int(random.integers(2))]
        fault = {"kind": kind, "how": how, "number": int(random.integers(counts[kind])), "size": SIZE,
                 "seed": int(random.integers(2**31))}
        attempt(study, name, fault, exact, own)
    silent = [row for row in study.rows if row["silent_wrong"] == "yes"]
    study.target("converged with an error above ten times the tolerance, or the sound run's own", "0",
                 len(silent), not silent)
    study.figure(_picture(study))


def attempt(study: Study, name: str, fault: dict[str, Any], exact: Solution, own: float) -> None:
    """One falsified run: its row."""
    begin, scene, error, history = time.perf_counter(), study.scene(problem(name)), None, {}
    try:
        with falsifying(fault):
            solved = solve(config_from(problem(name)), scene)
        error, history = apart(scene, solved, exact), solved.history
        outcome, message = ("converged" if solved.converged else "stopped"), solved.stop_reason
    except BlackBoxError as failure:
        outcome, message = "refused", str(failure).splitlines()[0]
    wrong = outcome == "converged" and error > TIMES * max(TOLERANCE, own)
    study.add(Case(problem(name), {"problem": name, "kind": fault["kind"], "how": fault["how"], "number": fault["number"]}),
              {"outcome": outcome, "error": error, "message": message[:160], "silent_wrong": "yes" if wrong else "no",
               "iterations": len(history.get("iteration", ())), "stop_reason": outcome, "seconds": round(time.perf_counter() - begin, 2)},
              history, message[:90] if error is None else f"error {error:.1e}")


def problem(name: str) -> dict[str, Any]:
    method = {"tolerance": {"error": TOLERANCE}, "max_iterations": 100}
    return {**PROBLEMS[name], "method": method, "blackbox": {"workers": 1}}


def _sound(study: Study, data: Mapping[str, Any]) -> tuple[Solution, dict[str, int], float]:
    """A solution to a thousandth of the tolerance, replies of each kind in a run to the tolerance, and its error."""
    name = next(n for n, d in PROBLEMS.items() if d is data)
    scene, usual = study.scene(problem(name)), problem(name)
    method = {**usual["method"], "tolerance": {"error": 1e-3 * TOLERANCE}, "max_iterations": 500}
    exact = solve(config_from({**usual, "method": method}), scene)
    with tempfile.TemporaryDirectory() as folder:
        counts = Path(folder) / "counts.json"
        with falsifying({"counts": str(counts)}):
            own = solve(config_from(usual), scene)
        return exact, json.loads(counts.read_text()), apart(scene, own, exact)


def apart(scene: Scene, one: Solution, other: Solution) -> float:
    """max_t ‖u − u'‖_K / max_t ‖u'‖_K, subdomain by subdomain."""
    gap = energy(scene, [a - b for a, b in zip(one.sides, other.sides)]).max()
    return float(np.sqrt(max(gap, 0.0) / energy(scene, other.sides).max()))


@contextmanager
def falsifying(fault: Mapping[str, Any]) -> Iterator[None]:
    """Within this context FreeFEM is reached through the proxy."""
    real, root = shutil.which(os.environ.get("ORCHESTRATOR_FREEFEM") or "FreeFem++"), str(Path(__file__).resolve().parents[2])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "freefem"
        path.write_text(f"#!/bin/sh\nPYTHONPATH='{root}' exec '{sys.executable}' -m benchmarks.kit.proxy "
                        f"'{real}' \"$@\"\n")
        path.chmod(0o755)
        with environment({"ORCHESTRATOR_FREEFEM": str(path), "ORCHESTRATOR_FALSIFY": json.dumps(dict(fault))}):
            yield


def _picture(study: Study):
    """How falsified runs ended, kind by kind."""
    figure, ((axes,),) = panels(size=(6.4, 3.6))
    left = np.zeros(len(KINDS))
    for outcome, colour in (("refused", BLUE), ("stopped", GREEN), ("converged", GREY)):
        count = np.array([sum(r["kind"] == k and r["outcome"] == outcome for r in study.rows) for k in KINDS])
        axes.barh(KINDS, count, left=left, color=colour, label=outcome)
        left += count
    axes.set_xlabel("runs with one falsified reply of that kind")
    return figure
