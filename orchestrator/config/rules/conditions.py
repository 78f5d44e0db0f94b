"""Rules for what holds and loads the structure: places, grounds, temperatures, load steps and histories."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from orchestrator.config.entry import Entry
from orchestrator.config.foreign_parts import KINDS
from orchestrator.config.paths import find, get
from orchestrator.config.rules.raw import dotted, is_number, is_per_step, is_vectors, law_of, shown
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import BOLT_LAW, DEFAULT_LAW, LAWS

ENTRIES = {"boundary": ("displacement", "traction"), "loads": ("body_force",), "interfaces": (), "bolts": ()}


def places(data: Any) -> Iterator[Problem]:
    """A place is a plane or a box."""
    for path, on in find(data, ("boundary", "*", "on")):
        if not isinstance(on, dict):
            continue
        plane, at, box = (on.get(key) is not None for key in ("plane", "at", "box"))
        if (plane, at, box) not in ((True, True, False), (False, False, True)):
            given = [key for key in ("plane", "at", "box") if on.get(key) is not None]
            yield Problem(path, " and ".join(given) or "neither plane nor box", "{plane: x, at: 0} or {box: [[..], [..]]}",
                          "give plane and at together, or a box alone")
        corners = on.get("box")
        if is_vectors(corners) and len(corners) == 2 and any(low > high for low, high in zip(*corners)):
            yield Problem((*path, "box"), shown(corners), "the lower corner first, then the upper one",
                          "swap the coordinates that decrease")


def grounds(data: Any) -> Iterator[Problem]:
    """What stands on the ground says how, and a frame has something to turn."""
    for path, entry in find(data, ("boundary", "*")):
        if not isinstance(entry, dict):
            continue
        bed, coupling = entry.get("foundation"), entry.get("coupling")
        if isinstance(bed, dict):
            given = [key for key in ("normal", "tangential", "stiffness") if bed.get(key) is not None]
            if given not in (["normal"], ["normal", "tangential"], ["stiffness"]):
                yield Problem((*path, "foundation"), " and ".join(given) or "nothing", "normal, with tangential or without, or stiffness alone",
                              "write {normal: 1.0e4}, or {stiffness: [0, 0, 1.0e4]}")
            elif given == ["stiffness"] and is_vectors([bed["stiffness"]]) and not any(bed["stiffness"]):
                yield Problem((*path, "foundation", "stiffness"), "no stiffness along any direction", "one above 0 at least", "leave the entry out")
        if isinstance(coupling, dict):
            for kind, load in (("displacement", "force"), ("rotation", "moment")):
                both = [k for k, (x, f) in enumerate(zip(coupling.get(kind) or [], coupling.get(load) or [])) if x is not None and f]
                if both:
                    yield Problem((*path, "coupling", load), f"component {'xyz'[both[0]]} of {load} and of {kind}", "one of the two: what is "
                                  "prescribed is not loaded", f"write null for it in {kind}, or 0 in {load}")
            if not any(x is not None for kind in ("displacement", "rotation") for x in coupling.get(kind) or []) and not any(
                    f for load in ("force", "moment") for f in coupling.get(load) or []) and coupling.get("kind", "rigid") != "rigid":
                yield Problem((*path, "coupling"), "nothing prescribed and nothing loaded", "a displacement, rotation, force or moment",
                              "leave the entry out; kind: rigid alone keeps a surface rigid")
        if bed is not None and entry.get("history") is not None:
            yield Problem((*path, "history"), "history beside foundation, whose springs are what they are", "a history of what is prescribed or "
                          "loaded", "remove the history")
        turned = entry.get("displacement") is not None or entry.get("traction") is not None or \
            isinstance(bed, dict) and bed.get("stiffness") is not None
        if entry.get("frame") is not None and not turned:
            yield Problem((*path, "frame"), "a frame with nothing to turn", "a frame beside a displacement, a traction, or stiffness of a foundation",
                          "remove the frame")


def temperatures(data: Any) -> Iterator[Problem]:
    """A temperature that varies comes from a file, or linearly from a point."""
    for path, field in find(data, ("loads", "*", "temperature")):
        if not isinstance(field, dict):
            continue
        given = [key for key in ("value", "at", "gradient", "file") if field.get(key) is not None]
        if given != ["file"] and set(given) not in ({"at", "gradient"}, {"value", "at", "gradient"}):
            yield Problem(path, " and ".join(given) or "nothing", "a file alone, or at and gradient together, with a value or without",
                          "write a number where it is the same everywhere, {at: [x, y, z], gradient: [a, b, c]} or {file: warm.csv}")


def directions(data: Any) -> Iterator[Problem]:
    """Axes have a direction, and what is spread over a surface is something."""
    for where in (("parts", "*", "move", "rotate", "axis"), ("boundary", "*", "motion", "rotate", "axis"), ("loads", "*", "spin", "axis"),
                  ("bolts", "*", "cut", "plane"), ("boundary", "*", "frame", "axis")):
        for path, axis in find(data, where):
            if isinstance(axis, list) and not any(axis):
                yield Problem(path, shown(axis), "a direction: a vector other than zero", "write axis: z, or [0, 0, 1]")
    for path, resultant in find(data, ("boundary", "*", "resultant")):
        if isinstance(resultant, dict) and not resultant.get("force") and not resultant.get("moment"):
            yield Problem(path, "neither force nor moment", "one of them, or both", "add force: [0, 0, -1000]")


def load_steps(data: Any) -> Iterator[Problem]:
    """Histories exist, and all entries agree on the number of steps."""
    histories = get(data, "histories") or {}
    counts: list[tuple[KeyPath, int]] = []
    for group, keys in ENTRIES.items():
        for path, entry in find(data, (group, "*")):
            if not isinstance(entry, dict) or not isinstance(histories, dict):
                continue
            keys = law_of(entry).Parameters.per_step if group == "interfaces" else keys
            listed = [key for key in keys if is_per_step(entry.get(key))]
            counts += [((*path, key), len(entry[key])) for key in listed]
            history = entry.get("history")
            if not isinstance(history, str):
                continue
            if listed:
                yield Problem((*path, "history"), f"history beside one vector per step in {listed[0]}",
                              "one of the two", "remove the history, or give a single vector")
            elif isinstance(factors := histories.get(history), list):
                counts.append(((*path, "history"), len(factors)))
            elif history not in histories:
                yield Problem((*path, "history"), f"history '{history}', which is not defined",
                              "one of " + ", ".join(histories) if histories else "a name defined under histories",
                              f"define it under histories: {{{history}: [0.5, 1.0]}}")
    for kind in KINDS:
        for path, own in find(data, ("parts", "*", kind)):
            if isinstance(own, dict) and isinstance(histories, dict):
                if isinstance(factors := histories.get(own.get("history")) if isinstance(own.get("history"), str) else None, list):
                    counts.append(((*path, "history"), len(factors)))
                if isinstance(own.get("loads"), list) and len(own["loads"]) > 1:
                    counts.append(((*path, "loads"), len(own["loads"])))
    for path, count in counts[1:]:
        if count != counts[0][1]:
            yield Problem(path, f"{count} load steps", f"{counts[0][1]} load steps, as in {dotted(counts[0][0])}",
                          "give all histories and lists of vectors the same length")


def what_histories_multiply(data: Any) -> Iterator[Problem]:
    """A history beside a law belongs to something that the law prescribes, and its factors suit it."""
    histories = get(data, "histories")
    entries = [(path, law_of(entry).Parameters, entry) for path, entry in find(data, ("interfaces", "*"))]
    entries += [(path, LAWS[BOLT_LAW].Parameters, entry) for path, entry in find(data, ("bolts", "*"))]
    for path, parameters, entry in entries:
        name = entry.get("history") if isinstance(entry, dict) else None
        if not isinstance(name, str):
            continue
        factors = get(histories, name)
        if parameters.scaled is Entry.scaled:
            yield Problem((*path, "history"), f"history beside law: {entry.get('law', DEFAULT_LAW)}, which prescribes nothing",
                          "a history beside a jump, a gap that is a number, or a force", "remove the history")
        elif isinstance(factors, list) and all(map(is_number, factors)) and (wrong := parameters.wrong_factors(factors)):
            yield Problem((*path, "history"), *wrong)


def prescribed_once(data: Any) -> Iterator[Problem]:
    """A displacement prescribes something, and the same place is not told two different things."""
    seen: dict[tuple[str, int], tuple[KeyPath, Any]] = {}
    for path, entry in find(data, ("boundary", "*")):
        vector = entry.get("displacement") if isinstance(entry, dict) else None
        rows = vector if is_per_step(vector) else [vector]
        if not all(isinstance(row, list) and len(row) == 3 for row in rows):
            continue
        if all(value is None for row in rows for value in row):
            yield Problem((*path, "displacement"), "no prescribed component", "at least one number",
                          "remove the entry, or prescribe a component")
        for component in range(3):
            values = [row[component] for row in rows]
            free = [value is None for value in values]
            if any(free) and not all(free):
                yield Problem((*path, "displacement"), f"component {'xyz'[component]} free at some steps only",
                              "free at all load steps or at none", "give a number, or null, at every step")
            elif not all(free):
                # Zero stays zero whatever the history.
                told = values, entry.get("history") if any(values) else None
                first, other = seen.setdefault((shown(entry.get("on")), component), (path, told))
                if other != told:
                    yield Problem((*path, "displacement"),
                                  f"component {'xyz'[component]} of this place prescribed again, differently",
                                  f"one value, as in {dotted(first)}", "remove one of the two, or free it with null")
                    break
