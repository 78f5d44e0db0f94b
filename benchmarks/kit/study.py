"""What all studies share: cases run one after the other, each on disk before the next begins."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.kit.drawing import finished
from benchmarks.kit.table import Target, print_table, print_targets
from orchestrator import InputError, Problem, Scene, Solution, build_scene, config_from, solve

ETA, ACCURATE = 1e-5, 1e-6  # the paper's η, and the true relative energy error that studies count stages to
QUANTITIES = ("iteration", "sweeps", "seconds", "indicator", "displacement_jump", "force_imbalance", "residual",
              "error_bound", "macro_imbalance", "law_residual", "true_error")  # columns of curves.csv
_HOW = ("name", "method", "output")  # keys that do not shape a scene

History = Mapping[str, np.ndarray]  # columns of history.csv


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
        return ", ".join(f"{key} {value}" if isinstance(value, (int, float)) else str(value) for key, value in self.labels.items())


class Study:
    """A study under way.

    Parameters
    ----------
    name, title : as listed
    folder : default results/studies/<name>
    resume : take over what the folder has of the same runs

    Raises
    ------
    InputError : folder not writable

    Attributes
    ----------
    rows : of the table so far
    histories : per row, its iterations
    columns : that are printed at the end; all of them where there are none
    """

    def __init__(self, name: str, title: str, folder: str | os.PathLike[str] | None = None, resume: bool = False):
        self.name, self.title, self.resume = name, title, resume
        self.folder = Path(folder or Path("results", "studies", name)).absolute()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for old in ("table.csv", "curves.csv", "targets.csv", f"{name}.png"):
                (self.folder / old).unlink(missing_ok=True)
        except OSError as error:
            raise InputError(Problem((), f"{self.folder}: {error.strerror}", "a folder that can be written",
                                     "name another by --output")) from error
        self.rows: list[dict[str, Any]] = []
        self.histories: list[History] = []
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
        begin = time.perf_counter()
        with self.console.status(str(case)), np.errstate(over="ignore", invalid="ignore"):  # some cases diverge
            solved = solve(config_from(dict(case.config)), self.scene(case.config), reference=True)
        seconds = time.perf_counter() - begin - solved.summary["timing"]["reference"]
        row = {**_measured(solved), "seconds": round(seconds, 2), **measure(solved)}
        self.add(case, row, solved.history, f"true error {row['true_error']:.1e}")
        return solved

    def add(self, case: Case, row: Mapping[str, Any], history: History, accuracy: str) -> None:
        """Add the row and the curves of a finished case, write all, say so in a line.

        Parameters
        ----------
        row : columns beside the labels; with iterations, stop_reason and seconds
        history : its columns; empty where there is none
        accuracy : what the line says of the result
        """
        self.note({**case.labels, **row}, f"{case}: {row['iterations']} iterations, {row['stop_reason']}, {accuracy}, "
                                          f"{row['seconds']:.1f} s", history)

    def note(self, row: dict[str, Any], line: str, history: History | None = None) -> None:
        """Add a row of any kind, write the table, print the line."""
        self.rows.append(row)
        self.histories.append(history or {})
        self.write()
        self.console.print(f"  {len(self.rows):3}  {line}")

    def kept(self, name: str, asked: Mapping[str, Any], measure: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """A row that an earlier run of the study has kept in NAME.json, or as it is measured now, and then kept.

        Parameters
        ----------
        asked : all that the row depends on
        measure : () → the row; one with a ``failure`` is not kept
        """
        path, asked = self.folder / f"{name}.json", json.loads(json.dumps(asked))
        if self.resume and path.is_file():
            known = json.loads(path.read_text(encoding="utf-8"))
            if known["asked"] == asked:
                return known["row"]
        path.unlink(missing_ok=True)
        with self.console.status(name):
            row = measure()
        if "failure" not in row:
            path.write_text(json.dumps({"asked": asked, "row": row}, indent=1), encoding="utf-8")
        return row

    def target(self, what: str, wanted: str, measured: Any, met: bool) -> None:
        """Note a figure to reach, what was measured and whether that is enough."""
        self.targets.append(Target(what, wanted, "never" if measured is None else str(measured), bool(met)))

    def write(self) -> None:
        """table.csv and curves.csv of all cases so far."""
        names = list(dict.fromkeys(key for row in self.rows for key in row))
        _csv(self.folder / "table.csv", names, ([row.get(n) for n in names] for row in self.rows))
        _csv(self.folder / "curves.csv", ["case", *QUANTITIES], (
            [number, *values] for number, history in enumerate(self.histories, 1) if history
            for values in zip(*(history[q].tolist() for q in QUANTITIES))))

    def beside(self, name: str, title: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Print a second table, of rows with the same keys, and write it to NAME.csv."""
        print_table(self.console, title, rows, ())
        _csv(self.folder / f"{name}.csv", list(rows[0]), (list(row.values()) for row in rows))

    def figure(self, figure: Any, name: str = "", **how: Any) -> None:
        """Write a figure of matplotlib as PNG, by the study's name unless another is given; ``how``: see ``finished``."""
        (self.folder / (name or f"{self.name}.png")).write_bytes(finished(figure, **how))

    def close(self) -> None:
        """Print the table and the targets."""
        print_table(self.console, self.title, self.rows, self.columns)
        if self.targets:
            print_targets(self.console, self.targets)
            _csv(self.folder / "targets.csv", ["target", "wanted", "measured", "met"],
                 ([t.what, t.wanted, t.measured, "yes" if t.met else "no"] for t in self.targets))
        self.console.print(f"{time.perf_counter() - self.begin:.0f} s; table, curves and figure in {self.folder}/")


def first(history: History, quantity: str, value: float) -> int | None:
    """The first iteration after which a quantity is at most ``value``, or None."""
    reached = np.flatnonzero(np.asarray(history[quantity]) <= value)
    return int(history["iteration"][reached[0]]) if len(reached) else None


def _measured(solved: Solution) -> dict[str, Any]:
    """The columns that every study has."""
    history, summary = solved.history, solved.summary
    eta, true, bound = first(history, "indicator", ETA), summary["true_error"], summary["error_bound"]
    return {
        "subdomains": summary["subdomains"], "dofs": summary["dofs"], "iterations": solved.iterations,
        "stages_to_eta": eta, "true_error_at_eta": eta and float(history["true_error"][list(history["iteration"]).index(eta)]),
        "stages_to_true_error": first(history, "true_error", ACCURATE),
        "true_error": true, "error_bound": bound, "effectivity": bound / true if true else math.nan,
        "stop_reason": solved.stop_reason,
    }


def _csv(path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in row] for row in rows)
    path.write_text(text.getvalue(), encoding="utf-8")
