"""What all studies share: cases run one after the other, each on disk before the next begins."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from orchestrator.config import config_from
from orchestrator.method.events import Iteration
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from benchmarks.kit.table import Target, print_table, print_targets
from orchestrator.timing import Stopwatch

ETA, ACCURATE = 1e-5, 1e-6  # the paper's η, and the true relative energy error that studies count stages to
QUANTITIES = ("iteration", "sweeps", "seconds", "indicator", "displacement_jump", "force_imbalance", "residual",
              "error_bound", "macro_imbalance", "law_residual", "true_error")  # columns of curves.csv
_HOW = ("name", "method", "output")  # keys that do not shape a scene


@dataclass(frozen=True)
class Case:
    """One configuration of a study.

    Parameters
    ----------
    config : plain data, as in the YAML
    labels : what tells it from the others; the first columns of the table
    """

    config: Mapping[str, Any]
    labels: Mapping[str, Any]

    def __str__(self) -> str:
        return ", ".join(f"{key} {value}" if isinstance(value, (int, float)) else str(value)
                         for key, value in self.labels.items())


class Study:
    """A study under way.

    Parameters
    ----------
    name, title : as listed
    folder : default results/studies/<name>

    Raises
    ------
    InputError : folder not writable, or with files that are no study's

    Attributes
    ----------
    rows : of the table so far
    histories : per row, its iterations
    """

    def __init__(self, name: str, title: str, folder: str | os.PathLike[str] | None = None):
        self.name, self.title = name, title
        self.folder = ResultsFolder(folder or os.path.join("results", "studies", name))
        self.folder.check_known()  # problems are written there too
        self.folder.check_free(rf"(table|curves|targets)\.csv|{re.escape(name)}\.png")
        self.folder.remove("table.csv", "curves.csv", "targets.csv", f"{name}.png")
        self.rows: list[dict[str, Any]] = []
        self.histories: list[list[Iteration]] = []
        self.targets: list[Target] = []
        self.columns: Sequence[str] = ()
        self.console = Console(soft_wrap=True, highlight=False)
        self.begin = time.perf_counter()
        self._scenes: dict[str, Scene] = {}
        self.console.print(f"{name}: {title}", style="bold")

    def scene(self, config: Mapping[str, Any]) -> Scene:
        """The scene of a configuration; cases that differ in the method alone share it."""
        key = json.dumps({k: v for k, v in config.items() if k not in _HOW}, sort_keys=True)
        if key not in self._scenes:
            self._scenes[key] = build_scene(config_from(dict(config)))
        return self._scenes[key]

    def solve(self, case: Case, measure: Callable[[Solution], Mapping[str, Any]] = lambda solved: {}) -> Solution:
        """Solve a case beside its undecomposed reference, add its row and its curves, write both.

        Parameters
        ----------
        measure : further columns of the row
        """
        config, watch = config_from(dict(case.config)), Stopwatch()
        with self.console.status(str(case)), np.errstate(over="ignore", invalid="ignore"):  # some cases diverge
            with watch("mesh"):
                scene = self.scene(case.config)
            solved = solve(config, scene, reference=True, watch=watch)
        row = {**_measured(solved), "seconds": round(watch.total - watch.seconds["reference"], 2), **measure(solved)}
        self.add(case, row, solved.iterated.history, f"true error {row['true_error']:.1e}")
        return solved

    def add(self, case: Case, row: Mapping[str, Any], history: list[Iteration], accuracy: str) -> None:
        """Add the row and the curves of a finished case, write all, say so in a line.

        Parameters
        ----------
        row : columns beside the labels; with iterations, stop_reason and seconds
        accuracy : what the line says of the result
        """
        self.rows.append({**case.labels, **row})
        self.histories.append(history)
        self.write()
        self.console.print(f"  {len(self.rows):3}  {case}: {row['iterations']} iterations, {row['stop_reason']}, "
                           f"{accuracy}, {row['seconds']:.1f} s")

    def target(self, what: str, wanted: str, measured: Any, met: bool) -> None:
        """Note a figure to reach, what was measured and whether that is enough."""
        self.targets.append(Target(what, wanted, "never" if measured is None else str(measured), bool(met)))

    def write(self) -> None:
        """table.csv and curves.csv of all cases so far."""
        names = list(dict.fromkeys(key for row in self.rows for key in row))
        self.folder.write("table.csv", _csv(names, ([row.get(n) for n in names] for row in self.rows)))
        self.folder.write("curves.csv", _csv(["case", *QUANTITIES], (
            [number, *(getattr(event, q) for q in QUANTITIES)]
            for number, history in enumerate(self.histories, 1) for event in history)))

    def figure(self, content: bytes) -> None:
        """The study's picture, a PNG."""
        self.folder.write(f"{self.name}.png", content)

    def close(self) -> None:
        """Print the table and the targets."""
        print_table(self.console, self.title, self.rows, self.columns)
        if self.targets:
            print_targets(self.console, self.targets)
            self.folder.write("targets.csv", _csv(["target", "wanted", "measured", "met"], (
                [t.what, t.wanted, t.measured, "yes" if t.met else "no"] for t in self.targets)))
        self.console.print(f"{time.perf_counter() - self.begin:.0f} s; table, curves and figure in {self.folder.path}/")


def first(history: Iterable[Iteration], quantity: str, value: float) -> Iteration | None:
    """The first iteration at which a quantity is at most ``value``, or None."""
    return next((event for event in history if getattr(event, quantity) <= value), None)


def _measured(solved: Solution) -> dict[str, Any]:
    """The columns that every study has."""
    history, summary = solved.iterated.history, solved.summary
    eta, accurate = first(history, "indicator", ETA), first(history, "true_error", ACCURATE)
    true, bound = summary["true_error"], summary["error_bound"]
    return {
        "subdomains": summary["subdomains"], "dofs": summary["dofs"], "iterations": solved.iterations,
        "stages_to_eta": eta and eta.iteration, "true_error_at_eta": eta and eta.true_error,
        "stages_to_true_error": accurate and accurate.iteration,
        "true_error": true, "error_bound": bound, "effectivity": bound / true if true else math.nan,
        "stop_reason": solved.stop_reason,
    }


def _csv(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in row] for row in rows)
    return text.getvalue()
