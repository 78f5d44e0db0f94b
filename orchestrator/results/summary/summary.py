"""summary.json: its keys, writing and reading it, and what all who read it ask of it."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Iterator, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path

import numpy as np
import scipy

import orchestrator
from orchestrator.blackbox.usage import STAGES as BLACKBOX_STAGES
from orchestrator.errors import wrong
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder

NAME = "summary.json"
KEYS = (
    "name converged stop_reason advice started_from iterations sweeps newton_steps coarse_ends "
    "sole_scale indicator error_bound error_kind error_factor true_error error_shares backward "
    "discretisation_error accuracy tolerance residuals stabilised places element dofs subdomains "
    "interfaces interface_nodes load_steps energy peak_stress peak_displacement reactions "
    "reaction_names reaction_kinds reaction_moments probes paths status_counts "
    "interface_resultants contact_faces bolts tools load_path limit_load detached weakly_held "
    "unbalanced far_bodies warnings timing workload codes asking_seconds orchestrator_seconds "
    "versions memory_peak_mb rank_memory_peak_mb config").split()
MORE_KEYS = ("workers", "nonlinear")  # of which some runs know
LISTS = (
    "advice started_from energy reactions reaction_names reaction_kinds probes paths "
    "interface_resultants contact_faces bolts tools load_path limit_load detached weakly_held "
    "unbalanced far_bodies warnings codes").split()
MAPPINGS = (
    "sweeps error_shares accuracy residuals stabilised places peak_stress peak_displacement "
    "reaction_moments status_counts backward timing workload versions config").split()
EMPTY = dict.fromkeys(LISTS, []) | dict.fromkeys(MAPPINGS, {})
KINDS = {"displacement": "length", "stress": "stress", "force": "force"}  # of probes' numbers
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
    return folder.write(NAME, json.dumps(known(summary), indent=1, allow_nan=False) + "\n")


def known(summary: Mapping[str, object]) -> dict[str, object]:
    """Return a summary as it is written: all of ``KEYS``, in the types of JSON."""
    return jsonable(dict.fromkeys(KEYS) | summary)


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
    """Return ``value`` in plain JSON types: numpy's and dataclasses converted, nan and infinities
    None, unknown objects as text.
    """
    if value is None or type(value) in (str, int, bool):  # nearly all there is
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if is_dataclass(value):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple, set)):
        return [jsonable(item) for item in value]
    return value if isinstance(value, (bool, int, str)) else str(value)


def versions(blackbox: Mapping[str, str] | None = None) -> dict[str, str]:
    """Versions of Python, numpy, scipy and this package, then those of the black box, e.g.
    {"freefem": "4.11"}.
    """
    return {"orchestrator": orchestrator.__version__, "python": platform.python_version(),
            "numpy": np.__version__, "scipy": scipy.__version__, **(blackbox or {})}


class View:
    """A summary for those who read it: its keys as attributes, empty where nothing is known.

    unit : of length, force, stress, moment and energy, a space before; empty where none is named
    many : load steps, None where there is but one
    stages : names of ``STAGES`` and the seconds that they took, those that took some; the rest of
        the total last
    blackbox, blackbox_seconds : stage → seconds on its own clock, and all of them, summed over its
        workers
    """

    def __init__(self, summary: Mapping[str, object]):
        found = {key: jsonable(summary.get(key)) for key in (*KEYS, *MORE_KEYS, *summary)}
        vars(self).update({key: EMPTY.get(key) if x is None else x for key, x in found.items()})
        self.unit = _units((self.config.get("output") or {}).get("units"))
        self.many = steps if (steps := self.load_steps or 1) > 1 else None
        own, total = self.timing.get("blackbox") or {}, self.timing.get("total") or 0.0
        took = [(label, self.timing[stage]) for stage, label in STAGES.items()
                if self.timing.get(stage)]
        rest = max(0.0, total - sum(seconds for _, seconds in took))
        self.stages = [*took, ("everything else", rest)]
        self.blackbox = {stage: own[stage] for stage in BLACKBOX_STAGES
                         if own.get(stage) is not None}
        self.blackbox_seconds = sum(self.blackbox.values())


def quantities(s: View) -> Iterator[tuple[str, str, str, object]]:
    """Yield key, name in words (empty: nothing to compare runs by), kind, and the number of each
    load step, or a number, of what an engineer asks a run for.
    """
    for key, kind in (("peak_stress", "stress"), ("peak_displacement", "length")):
        yield key, key.replace("_", " "), kind, getattr(s, key).get("value")
    yield "energy", "energy", "energy", s.energy or None
    for name, steps in zip(s.reaction_names, s.reactions):
        yield f"reaction.{name}", f"reaction {name}", "force", steps
    ends = [bolt["force"][-1] for bolt in s.bolts if bolt["force"]]
    if ends and len(ends) == len(s.bolts):
        yield "bolt_force_min", "", "force", min(ends)
        yield "bolt_force_max", "", "force", max(ends)
    for bolt in s.bolts:
        name = bolt["name"]
        yield f"bolt.{name}.force", f"bolt {name}, axial", "force", bolt["force"]
        yield f"bolt.{name}.shortening", "", "length", bolt["shortening"]
    for probe in s.probes:
        for name, values in probe["values"].items():
            kind = "moment" if name in ("mx", "my", "mz") else KINDS.get(probe.get("of"), name)
            yield f"{probe['name']}.{name}", f"probe {probe['name']} {name}", kind, values
    for name, counts in s.status_counts.items():
        yield f"pairs.{name}", "", "pairs", counts


def numbers_of(s: View) -> dict[str, float]:
    """Return key → number, of the last load step; what is not known is left out."""
    found: dict[str, object] = {"iterations": s.iterations, "error_bound": s.error_bound,
                                "discretisation_error": s.discretisation_error,
                                "seconds": s.timing.get("total")}
    for face in s.contact_faces:
        found["friction_used"] = max(found.get("friction_used", 0.0), face["used"][-1] or 0.0)
        if face["slips"] and face["slips"]["at"] is not None:
            found["slip_load"] = min(found.get("slip_load", math.inf), face["slips"]["at"])
    for key, _, _, values in quantities(s):
        last = (values or [None])[-1] if isinstance(values, list) else values
        found |= {f"{key}.{axis}": x for axis, x in zip("xyz", last)} if isinstance(last, list) \
            else {key: last}
    return {key: x for key, x in found.items() if isinstance(x, (int, float))}


def _units(named: Mapping[str, str] | None) -> dict[str, str]:
    if not named:
        return dict.fromkeys(("length", "force", "stress", "moment", "energy"), "")
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
