"""summary.json and its short form on the console."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import numpy as np

import orchestrator
from orchestrator.errors import InputError, Problem
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.codes import codes_text
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.results.summary.workload import idle_text

NAME = "summary.json"
KEYS = ["name", "converged", "stop_reason", "iterations", "sweeps", "indicator", "error_bound", "true_error",
        "discretisation_error", "tolerance",
        "residuals", "dofs", "subdomains", "interfaces", "interface_nodes", "load_steps", "energy", "reactions",
        "status_counts", "interface_resultants", "detached", "weakly_held", "warnings", "timing", "workload", "codes",
        "asking_seconds", "orchestrator_seconds", "versions", "memory_peak_mb", "skipped", "config"]
# key in ``timing`` → what it is called; in the order of a run
STAGES = {"startup": "starting Python", "mesh": "mesh", "soles": "soles", "start": "starting the black box",
          "load": "assembling and factorising", "search_direction": "search direction", "macro": "macro problem",
          "linear_stage": "linear stage", "coarse": "coarse contact problem", "local_stage": "local stage",
          "acceleration": "acceleration", "bound": "error measures", "reference": "undecomposed solution",
          "output": "writing results"}
_LARGEST = 6  # stages named on the console
BLACKBOX_STAGES = ["start", "assemble", "factorise", "solve"]


def write_summary(folder: ResultsFolder, summary: Mapping[str, object]) -> Path:
    """Writes summary.json: the keys of ``KEYS`` in their order (null where absent), then any others.

    Numpy numbers and arrays become plain ones; nan and infinities become null, which JSON can hold.

    Raises
    ------
    InputError : disk full or folder not writable
    """
    complete = {key: summary.get(key) for key in KEYS} | dict(summary)
    return folder.write(NAME, json.dumps(jsonable(complete), indent=1, allow_nan=False) + "\n")


def read_summary(directory: str | os.PathLike[str]) -> dict[str, object]:
    """Reads the summary of a results folder.

    Raises
    ------
    InputError : no such folder, or not one a run has written
    """
    path = Path(directory) / NAME
    expected = "a results folder written by a run"
    cure = "run a configuration first, or name its output folder"
    if not path.is_file():
        what = f"no {NAME} in {path.parent}" if path.parent.is_dir() else f"no folder {path.parent}"
        raise InputError(Problem(DIRECTORY_KEY, what, expected, cure))
    try:
        summary = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(Problem(DIRECTORY_KEY, f"{path} cannot be read: {error}", expected, cure)) from error
    missing = [key for key in ("name", "converged", "stop_reason", "iterations", "timing")
               if not isinstance(summary, dict) or key not in summary]
    if missing:
        raise InputError(Problem(DIRECTORY_KEY, f"{path} lacks {', '.join(missing)}", expected, cure))
    return summary


def jsonable(value: object) -> object:
    """``value`` in plain JSON types: numpy converted, nan and infinities None, unknown objects as text."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple, set)):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


def versions(blackbox: Mapping[str, str] | None = None) -> dict[str, str]:
    """Versions of Python, numpy, scipy and this package, then those of the black box, e.g. {"freefem": "4.11"}."""
    return {"orchestrator": orchestrator.__version__, "python": platform.python_version(),
            "numpy": np.__version__, "scipy": metadata.version("scipy"), **(blackbox or {})}


def memory_peak_mb(pid: int | str = "self") -> float:
    """Largest resident memory a process has had, in MB; nan when the process is gone or not on Linux."""
    try:
        # not getrusage: its maximum survives exec and shows the parent's memory
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024 / 1e6
    except (OSError, StopIteration):
        return math.nan


def blackbox_seconds(timing: Mapping[str, object]) -> float:
    """The black box's own seconds, summed over its workers and its stages."""
    own = timing.get("blackbox") or {}
    return float(sum(own.get(stage) or 0.0 for stage in BLACKBOX_STAGES))


def print_summary(summary: Mapping[str, object], directory: str | os.PathLike[str] | None = None,
                  console: object | None = None) -> None:
    """Prints what matters of a summary as a compact table.

    Parameters
    ----------
    summary : as for ``write_summary``
    directory : the results folder, to say where the figures are
    console : a rich Console; default: standard output
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = console or Console(highlight=False)
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for label, text in summary_rows(summary):
        style = "" if label != "result" else "green" if summary.get("converged") else "red"
        table.add_row(label, Text(text, style=style))
    if directory is not None:
        figures = sorted(Path(directory).glob("figures/*.png"))
        table.add_row("results", Text(str(directory)))
        if figures:
            table.add_row("figures", Text("\n".join(map(str, figures))))
    console.print(table)


def summary_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """Label and text of each line of the short summary; what is not known is left out."""
    def shown(key: str, form: str = "{:,}") -> str | None:
        value = jsonable(summary.get(key))
        return None if value is None else form.format(value)

    state = "converged" if summary.get("converged") else "NOT converged"
    reason = str(summary.get("stop_reason") or "")
    sweeps = summary.get("sweeps") or {}
    total = sweeps.get("total") if isinstance(sweeps, Mapping) else sweeps
    rows = [("run", shown("name", "{}")),
            ("result", state if reason in ("", "converged") else f"{state} ({reason})"),
            ("iterations", shown("iterations") and f"{shown('iterations')}"
             + (f", {total:.4g} sweeps (back-substitutions per subdomain and load step)" if total is not None else "")),
            ("error bound", shown("error_bound", "{:.2e}  (guaranteed, relative, energy norm)")),
            ("true error", shown("true_error", "{:.2e}  (against the undecomposed solution)")),
            ("law residual", _law_text(summary)),
            ("mesh's error", _mesh_text(summary)),
            ("interfaces", _status_text(summary)),
            ("not held", "\n".join(hold_sentences(summary))),
            ("warning", "\n".join(summary.get("warnings") or ())),
            ("size", ", ".join(f"{shown(key)} {word if summary[key] == 1 else word + 's'}"
                               for key, word in (("dofs", "dof"), ("subdomains", "subdomain"),
                                                 ("interfaces", "interface"), ("load_steps", "load step"))
                               if shown(key))),
            ("time", _time_text(summary)),
            ("codes", codes_text(summary)),
            ("workers", idle_text(summary.get("workload"))),
            ("skipped", _skipped_text(summary)),
            ("memory", shown("memory_peak_mb", "{:,.0f} MB at the peak"))]
    return [(label, text) for label, text in rows if text]


def _law_text(summary: Mapping[str, object]) -> str | None:
    residuals = jsonable(summary.get("residuals"))
    value = residuals.get("law_residual") if isinstance(residuals, Mapping) else None
    return None if value is None else f"{value:.2e}  (equilibrium and interface laws, the largest relative residual)"


def _mesh_text(summary: Mapping[str, object]) -> str | None:
    value, config = jsonable(summary.get("discretisation_error")), summary.get("config") or {}
    if value is None:
        return None
    asked = (config.get("method") or {}).get("tolerance") or {}
    text = f"{value:.2e}  (estimated discretisation error, relative, energy norm)"
    if asked.get("error") == "auto":
        text += f"; tolerance {summary['tolerance']:.2e}, {asked['fraction']:g} of it"
    return text


def shown_statuses(counts: object) -> list[str]:
    """Names of the statuses that say something: open, stick and slip only where there are such."""
    if not isinstance(counts, Mapping):
        return []
    usual = [name for name in COUNTED if counts.get(name)]
    return (usual if any(any(counts[name]) for name in usual) else []) + [n for n in counts if n not in COUNTED]


def _status_text(summary: Mapping[str, object]) -> str | None:
    """Node pairs that are open, stick, slip … at the last load step."""
    counts = summary.get("status_counts")
    names = shown_statuses(counts)
    if not names:  # imposed jumps alone
        return None
    steps = len(counts[names[0]])
    when = f"  (node pairs, load step {steps} of {steps})" if steps > 1 else "  (node pairs)"
    return ", ".join(f"{counts[name][-1]:,} {name}" for name in names) + when


def hold_sentences(summary: Mapping[str, object]) -> list[str]:
    """Which bodies are detached or weakly held, at which load steps, in words."""
    result = []
    for key, what in (("detached", "pressed on by no held body"), ("weakly_held", "held, but free to move as a whole")):
        when: dict[str, list[int]] = {}
        for step, names in enumerate(summary.get(key) or (), 1):
            for name in names:
                when.setdefault(name, []).append(step)
        alike: dict[tuple[int, ...], list[str]] = {}
        for name, steps in when.items():
            alike.setdefault(tuple(steps), []).append(name)
        for steps, names in alike.items():
            shown = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
            result.append(f"{shown}: {what} at load step {', '.join(map(str, steps))}; "
                          f"{'its' if len(names) == 1 else 'their'} rigid position is undetermined")
    return result


def _skipped_text(summary: Mapping[str, object]) -> str:
    """What was not done because the scene does not need it, and which switch of ``method.skip`` allowed it."""
    return "; ".join(f"{', '.join(f'{count:,} {what}' for what, count in entry['saved'].items())} ({entry['skip']})"
                     for entry in summary.get("skipped") or ())


def _time_text(summary: Mapping[str, object]) -> str | None:
    timing = jsonable(summary.get("timing")) or {}
    if timing.get("total") is None:
        return None
    stages = sorted(((timing[s], s) for s in STAGES if timing.get(s)), reverse=True)
    text = f"{timing['total']:.2f} s"
    shown = [f"{STAGES[name]} {seconds:.2f}" for seconds, name in stages[:_LARGEST]]
    rest = timing["total"] - sum(seconds for seconds, _ in stages[:_LARGEST])
    if shown:
        text += ": " + ", ".join(shown + ([f"the rest {rest:.2f}"] if rest >= 0.005 else []))
    own = blackbox_seconds(timing)
    if own:
        text += f"\nblack box {own:.2f} s of its own clock, summed over its workers"
        workers = summary.get("workers")
        if workers and timing["total"]:
            text += f" ({100 * own / (workers * timing['total']):.0f} % of {workers} × {timing['total']:.2f} s)"
    return text
