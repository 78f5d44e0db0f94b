"""summary.json: its keys, writing and reading it, and what all who read it ask of it."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy

import orchestrator
from orchestrator.blackbox.usage import STAGES as BLACKBOX_STAGES
from orchestrator.errors import wrong
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder

NAME = "summary.json"
KEYS = (
    "name converged stop_reason advice iterations sweeps newton_steps coarse_ends sole_scale "
    "indicator error_bound error_kind error_factor true_error error_shares backward "
    "discretisation_error accuracy tolerance residuals stabilised places element dofs subdomains "
    "interfaces interface_nodes load_steps energy peak_stress peak_displacement reactions "
    "reaction_names reaction_kinds reaction_moments probes paths status_counts "
    "interface_resultants contact_faces bolts tools load_path limit_load detached weakly_held "
    "unbalanced far_bodies warnings timing workload codes asking_seconds orchestrator_seconds "
    "versions memory_peak_mb rank_memory_peak_mb skipped config").split()
# key in ``timing`` → what it is called; in the order of a run
STAGES = {"startup": "starting Python", "meshes_before": "coarser meshes", "mesh": "mesh",
          "parts": "numbering, parts of ranks", "soles": "soles",
          "start": "starting the black box",
          "load": "assembling and factorising", "search_direction": "search direction",
          "macro": "macro problem",
          "linear_stage": "linear stage", "coarse": "coarse contact problem",
          "local_stage": "local stage",
          "acceleration": "acceleration", "bound": "error measures",
          "reference": "undecomposed solution",
          "output": "writing results"}


def write_summary(folder: ResultsFolder, summary: Mapping[str, object]) -> Path:
    """Writes summary.json: the keys of ``KEYS`` in their order (null where absent), then any
    others.

    Numpy numbers and arrays become plain ones; nan and infinities become null, which JSON can hold.
    """
    complete = {key: summary.get(key) for key in KEYS} | dict(summary)
    return folder.write(NAME, json.dumps(jsonable(complete), indent=1, allow_nan=False) + "\n")


def read_summary(directory: str | os.PathLike[str]) -> dict[str, object]:
    """Reads the summary of a results folder.

    Raises InputError: no such folder, or not one a run has written
    """
    path, beside = Path(directory) / NAME, ("a results folder written by a run",
                                            "run a configuration first, or name its output folder")
    if not path.is_file():
        raise wrong(DIRECTORY_KEY, f"no {NAME} in {path.parent}" if path.parent.is_dir()
                    else f"no folder {path.parent}", *beside)
    try:
        summary = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}", *beside) from error
    needed = ("name", "converged", "stop_reason", "iterations", "timing")
    if missing := [key for key in needed if not isinstance(summary, dict) or key not in summary]:
        raise wrong(DIRECTORY_KEY, f"{path} lacks {', '.join(missing)}", *beside)
    return summary


def jsonable(value: object) -> object:
    """``value`` in plain JSON types: numpy converted, nan and infinities None, unknown objects as
    text.
    """
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
    """Versions of Python, numpy, scipy and this package, then those of the black box, e.g.
    {"freefem": "4.11"}.
    """
    return {"orchestrator": orchestrator.__version__, "python": platform.python_version(),
            "numpy": np.__version__, "scipy": scipy.__version__, **(blackbox or {})}


def blackbox_seconds(timing: Mapping[str, object]) -> float:
    """The black box's own seconds, summed over its workers and its stages."""
    own = timing.get("blackbox") or {}
    return float(sum(own.get(stage) or 0.0 for stage in BLACKBOX_STAGES))


def stage_seconds(timing: Mapping[str, object]) -> list[tuple[str, float]]:
    """Names of ``STAGES`` and the seconds that they took, those that took some; the rest of the
    total last.
    """
    rows = [(label, float(timing[stage])) for stage, label in STAGES.items() if timing.get(stage)]
    return [*rows,
            ("everything else",
             max(0.0, (timing.get("total") or 0.0) - sum(seconds for _, seconds in rows)))]


def units_of(summary: Mapping[str, object]) -> dict[str, str]:
    """Units of length, force, stress and moment with a space before; empty where none are named."""
    named = ((summary.get("config") or {}).get("output") or {}).get("units")
    if not named:
        return {key: "" for key in ("length", "force", "stress", "moment", "energy")}
    # pydantic comes with it, for which who draws would wait
    from orchestrator.config.model import Units

    units = Units.model_validate(named)
    moment = f" {units.force}·{units.length}"
    return {"length": f" {units.length}", "force": f" {units.force}", "stress": f" {units.stress}",
            "moment": moment, "energy": moment}


def place_text(on: str | Mapping[str, object], part: str | None = None) -> str:
    """``on`` of the YAML in words: xmin, x = 0, box (0, 0, 0) … (1, 1, 1), and the ``part`` that is
    meant.
    """
    if part is not None:
        return f"{place_text(on)} of {part}"
    if isinstance(on, str):
        return on
    if "plane" in on:
        return f"{on['plane']} = {on['at']:g}"
    return "box " + " … ".join("(" + ", ".join(f"{x:g}" for x in corner) + ")"
                               for corner in on["box"])


def code_label(entry: Mapping[str, object]) -> str:
    """Name of a code with its transport."""
    return f"{entry['code']} ({entry['transport']})"


def numbers_of(summary: Mapping[str, object]) -> dict[str, float]:
    """Name → number; what is not known is left out. Forces of boundaries and bolts, probes and
    statuses are of the last load step.
    """
    found: dict[str, object] = {key: summary.get(key)
                                for key in ("iterations", "error_bound", "discretisation_error")}
    found["seconds"] = (summary.get("timing") or {}).get("total")
    for key in ("peak_stress", "peak_displacement"):
        found[key] = (summary.get(key) or {}).get("value")
    found["energy"] = _last(summary.get("energy"))
    for name, steps in zip(summary.get("reaction_names") or (), summary.get("reactions") or ()):
        found |= {f"reaction.{name}.{axis}": value
                  for axis, value in zip("xyz", _last(steps) or ())}
    bolts = summary.get("bolts") or ()
    if bolts and all(bolt["force"] for bolt in bolts):
        found |= {f"bolt_force_{end}": pick(bolt["force"][-1] for bolt in bolts)
                  for end, pick in (("min", min), ("max", max))}
    for bolt in bolts:
        found |= {f"bolt.{bolt['name']}.{key}": _last(bolt[key]) for key in ("force", "shortening")}
    for probe in summary.get("probes") or ():
        found |= {f"{probe['name']}.{name}": _last(column)
                  for name, column in probe["values"].items()}
    found |= {f"pairs.{name}": _last(counts)
              for name, counts in (summary.get("status_counts") or {}).items()}
    return {name: value for name, value in found.items() if isinstance(value, (int, float))
            and math.isfinite(value)}


def _last(values: object) -> object:
    return values[-1] if isinstance(values,
                                    Sequence) and not isinstance(values, str) and len(
                                        values) else None
