"""Rules for what holds and loads the structure: places, grounds, temperatures, load steps and
histories.

Rules for what is asked of the solution: accuracy, probes.

``output.probes``: values that are asked of the solution. A kind brings the model of its own
entries, which a key tells that it alone has; none is known here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from orchestrator.config.base import ByKey, Name, no_direction, Part
from orchestrator.config.boundary import Entry
from orchestrator.config.mesh import KINDS
from orchestrator.config.paths import (
    called_twice, codes, entries, find, get, is_number, is_per_step, is_vectors, law_of, shown)
from orchestrator.config.tools import LISTED, PLACE
from orchestrator.errors import dotted, KeyPath, Problem
from orchestrator.registry import BOLT_LAW, DEFAULT_LAW, IN_VOLUMES, LAWS, ON_FACES, PROBES


ACTING = {"boundary": ON_FACES, "loads": IN_VOLUMES}


def places(data: Any) -> Iterator[Problem]:
    """A place is a plane or a box."""
    for path, on in entries(data, "boundary", "*", "on"):
        plane, at, box = (on.get(key) is not None for key in ("plane", "at", "box"))
        if (plane, at, box) not in ((True, True, False), (False, False, True)):
            given = [key for key in ("plane", "at", "box") if on.get(key) is not None]
            yield Problem(path, " and ".join(given) or "neither plane nor box",
                          "{plane: x, at: 0} or {box: [[..], [..]]}",
                          "give plane and at together, or a box alone")
        corners = on.get("box")
        if is_vectors(corners) and len(corners) == 2 and any(
            low > high for low, high in zip(*corners)):
            yield Problem((*path, "box"), shown(corners),
                          "the lower corner first, then the upper one",
                          "swap the coordinates that decrease")


def acting(data: Any) -> Iterator[Problem]:
    """Rules of the kinds of loads and supports; a frame must have something to turn."""
    for group, kinds in ACTING.items():
        for name, kind in kinds.items():
            yield from kind.broken_among([(path, entry[name], entry)
                                          for path, entry in entries(data, group, "*")
                                          if entry.get(name) is not None])
        for path, entry in entries(data, group, "*"):
            given = [name for name in kinds if entry.get(name) is not None]
            for name in given:
                yield from kinds[name].broken((*path, name), entry[name], entry)
            if entry.get("frame") is not None and not any(kinds[name].turned(entry[name])
                                                          for name in given):
                yield Problem((*path, "frame"), "a frame with nothing to turn",
                              "a frame beside a displacement, a traction, or stiffness of a "
                              "foundation", "remove the frame")


def directions(data: Any) -> Iterator[Problem]:
    """Axes have a direction."""
    for where in (("parts", "*", "move", "rotate", "axis"), ("bolts", "*", "cut", "plane"),
                  ("output", "probes", "*", "section", "plane"),
                  ("boundary", "*", "frame", "axis")):
        for path, axis in find(data, where):
            yield from no_direction(path, axis)


def load_steps(data: Any) -> Iterator[Problem]:
    """Histories exist, and all entries agree on the number of steps."""
    histories = get(data, "histories") or {}
    # with the keys that list something for each load step
    listing: list[tuple[KeyPath, dict[str, Any], list[str]]] = []
    for group in ("boundary", "loads", "interfaces", "bolts"):
        keys = [name for name, kind in ACTING.get(group, {}).items() if kind.listed]
        for path, entry in entries(data, group, "*"):
            own = law_of(entry).Parameters.per_step if group == "interfaces" else keys
            listing.append((path, entry, [key for key in own if is_per_step(entry.get(key))]))
    listing += [(path, tool, [key for key in LISTED if is_per_step(tool.get(key))])
                for path, tool in entries(data, *PLACE)]
    for path, own in (found for kind in KINDS for found in entries(data, "parts", "*", kind)):
        listing.append((path, own, ["loads"] if isinstance(own.get("loads"), list)
                        and len(own["loads"]) > 1 else []))
    counts: list[tuple[KeyPath, int]] = []
    for path, entry, listed in listing if isinstance(histories, dict) else []:
        counts += [((*path, key), len(entry[key])) for key in listed]
        history = entry.get("history")
        if not isinstance(history, str):
            continue
        if listed and path[0] != "parts":
            yield Problem((*path, "history"), f"history beside one vector per step in {listed[0]}",
                          "one of the two", "remove the history, or give a single vector")
        elif isinstance(factors := histories.get(history), list):
            counts.append(((*path, "history"), len(factors)))
        elif history not in histories:
            yield Problem((*path, "history"), f"history '{history}', which is not defined",
                          "one of " + ", ".join(histories) if histories
                          else "a name defined under histories",
                          f"define it under histories: {{{history}: [0.5, 1.0]}}")
    for path, count in counts[1:]:
        if count != counts[0][1]:
            yield Problem(path, f"{count} load steps",
                          f"{counts[0][1]} load steps, as in {dotted(counts[0][0])}",
                          "give all histories and lists of vectors the same length")


def what_histories_multiply(data: Any) -> Iterator[Problem]:
    """A history beside a law belongs to something that the law prescribes, and its factors suit
    it.
    """
    histories = get(data, "histories")
    multiplied = [(path, law_of(entry).Parameters, entry)
                  for path, entry in entries(data, "interfaces", "*")]
    multiplied += [(path, LAWS[BOLT_LAW].Parameters, entry)
                   for path, entry in entries(data, "bolts", "*")]
    for path, parameters, entry in multiplied:
        name = entry.get("history")
        if not isinstance(name, str):
            continue
        factors = get(histories, name)
        if parameters.scaled is Entry.scaled:
            yield Problem((*path, "history"),
                          f"history beside law: {entry.get('law', DEFAULT_LAW)}, which prescribes "
                          "nothing",
                          "a history beside a jump, a gap that is a number, or a force",
                          "remove the history")
        elif isinstance(factors,
                        list) and all(map(is_number, factors)) and (
                            wrong := parameters.wrong_factors(factors)):
            yield Problem((*path, "history"), *wrong)


def accuracy_possible(data: Any) -> Iterator[Problem]:
    """The iterations' error is a part of what is asked for; what has no mesh of ours has no error
    that is known.
    """
    where, least = ("method", "accuracy"), get(data, "method", "accuracy")
    if least is None:
        return
    least, tolerance = least.get("error") if isinstance(least,
                                                        dict) else least, get(
                                                            data, "method", "tolerance")
    error = get(tolerance, "error")
    if isinstance(tolerance, dict) and not (is_number(error) and is_number(least)
                                            and error < least):
        yield Problem(("method", "tolerance"), f"{shown(tolerance)} beside accuracy",
                      "error: a number below the accuracy, or nothing: a tenth of the "
                      "accuracy", "remove tolerance")
    for path, part in entries(data, "parts", "*"):
        if kind := next((kind for kind in KINDS if part.get(kind) is not None), None):
            yield Problem((*path, kind), f"{kind} beside {dotted(where)}",
                          "parts with meshes of this program's: the error of others "
                          "is not known, nor can they be meshed anew", f"remove {dotted(where)}")
    for path, entry in codes(data):
        if entry.get("form") is not None:
            yield Problem((*path, "form"), f"a form beside {dotted(where)}",
                          "matter of the YAML's young and poisson: of other matter "
                          "stresses are not known", f"remove {dotted(where)}")
    if isinstance(get(data, "parts"),
                  list) and len(data["parts"]) > 1 and not get(data, "interfaces"):
        yield Problem(("parts",),
                      f"{len(data['parts'])} parts and no interfaces, beside {dotted(where)}",
                      "an entry for what joins them: finer meshes of parts do not match any more",
                      "add interfaces: [{between: auto, law: perfect}], or law: contact")


def probes_fit(data: Any) -> Iterator[Problem]:
    """Probes have names of their own, and keys that their quantity heeds."""
    yield from called_twice(data, ("output", "probes", "*"), "probe", "probe_{}")
    for path, probe in entries(data, "output", "probes", "*"):
        ends = probe.get("along")
        if is_vectors(ends) and len(ends) == 2 and ends[0] == ends[1]:
            yield Problem((*path, "along"), shown(ends), "two ends apart",
                          "give another end, or at: for a point")
        resultant = probe.get("quantity") == "resultant"
        for key, fits, where in (("of", not resultant, "a mean or an extreme"),
                                 ("about", resultant, "a resultant")):
            if "on" in probe and probe.get(key) is not None and not fits:
                yield Problem((*path, key),
                              f"{key} beside quantity: {shown(probe.get('quantity', 'mean'))}",
                              f"{key} beside {where} only", f"remove {key}")


def planes_have_points(data: Any) -> Iterator[Problem]:
    """One coordinate says where a plane is along x, y or z alone."""
    for keys in (("output", "probes", "*", "section"), ("bolts", "*", "cut")):
        for path, cut in entries(data, *keys):
            if isinstance(cut.get("plane"), list) and is_number(cut.get("at")):
                yield Problem((*path, "at"), shown(cut["at"]),
                              "a point on the plane, beside a direction", "write at: [x, y, z]")


Quantity = Literal["displacement", "stress"]


class ProbeEntry(Part):
    """Keys that the entries of all kinds understand."""

    name: Annotated[str, Field(pattern=r"^\w[\w. -]*$")] | None = Field(None, description=(
        "in the results; none: probe_1, probe_2, … by its place in the list"))
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever is "
        "there"))


Probes = list[ByKey(ProbeEntry, PROBES, "on").mapping]
