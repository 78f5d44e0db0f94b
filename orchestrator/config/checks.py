"""Rules that concern several keys at once.

They read the raw data, not the validated model, so that a user sees them together with the
errors of single keys. Each is a function ``data → problems`` that skips what has no sensible
shape (reported elsewhere) and is listed in ``RULES``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from orchestrator.config.blackbox import settings_class
from orchestrator.config.entry import Entry
from orchestrator.config.method import RATIO_RANGE
from orchestrator.config.foreign_parts import KINDS
from orchestrator.config.parts import elements_of
from orchestrator.config.paths import find, get
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import BOLT_LAW, DEFAULT_LAW, LAWS

SMALLEST, HUGEST = 1e-30, 1e30

SOURCES = ("beam", "box", "polycrystal", "file", "step")
# Mappings of which exactly one of some keys must be given.
ONE_OF: dict[KeyPath, tuple[str, ...]] = {
    ("mesh",): SOURCES,
    ("parts", "*"): ("mesh", *KINDS),
    ("parts", "*", "mesh"): SOURCES,
    ("subdomains",): ("slices", "grid", "metis", "groups"),
    ("method", "tolerance"): ("error", "indicator"),
    ("boundary", "*"): ("displacement", "symmetry", "motion", "traction", "pressure", "resultant", "foundation", "coupling"),
    ("loads", "*"): ("body_force", "gravity", "spin", "temperature"),
}
ENTRIES = {"boundary": ("displacement", "traction"), "loads": ("body_force",), "interfaces": (), "bolts": ()}


def exactly_one(data: Any) -> Iterator[Problem]:
    for pattern, keys in ONE_OF.items():
        for path, value in find(data, pattern):
            if not isinstance(value, dict):
                continue
            given = [key for key in value if key in keys and value[key] is not None]
            if len(given) > 1:
                yield Problem((*path, given[1]), " and ".join(given) + " together", "exactly one of " + ", ".join(keys),
                              f"keep {given[0]} or {given[1]}, remove the other")
            elif not given and not any(key in keys for key in value):
                yield Problem(path, "none of " + ", ".join(keys), "exactly one of them", f"add one, such as {keys[0]}")


def belongs_to(data: Any) -> Iterator[Problem]:
    """Keys that mean something only beside another one."""
    meshes = (("mesh",), ("parts", "*", "mesh"))
    for pattern, key, partner in (*((mesh, key, "step") for mesh in meshes for key in ("h", "conforming", "exclude")),
                                  (("subdomains",), "split_above", "groups")):
        for path, value in find(data, pattern):
            if isinstance(value, dict) and value.get(key) is not None and value.get(partner) is None:
                yield Problem((*path, key), f"{key} without {partner}", f"{key} beside {partner} only",
                              f"remove {key}, or use {partner}")
    for mesh in meshes:
        for path, value in find(data, mesh):
            if isinstance(value, dict) and isinstance(value.get("h"), dict) and value.get("conforming") is not False:
                yield Problem((*path, "h"), "an element size for each solid, where solids share their faces",
                              "one number, or solids that share nothing", "write conforming: false beside it")
    for path, tolerance in find(data, ("method", "tolerance")):
        if isinstance(tolerance, dict) and tolerance.get("fraction") is not None and tolerance.get("error") != "auto":
            fixed = next((f"{key}: {_show(tolerance[key])}" for key in ("error", "indicator")
                          if tolerance.get(key) is not None), "no error")
            yield Problem((*path, "fraction"), f"fraction beside {fixed}", "fraction beside error: auto only",
                          "remove fraction, or write error: auto")
    for path, entry in find(data, ("interfaces", "*")):
        for key, *told in law_of(entry).Parameters.broken(entry) if isinstance(entry, dict) else ():
            yield Problem((*path, key), *told)


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
        if _is_vectors(corners) and len(corners) == 2 and any(low > high for low, high in zip(*corners)):
            yield Problem((*path, "box"), _show(corners), "the lower corner first, then the upper one",
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
            elif given == ["stiffness"] and _is_vectors([bed["stiffness"]]) and not any(bed["stiffness"]):
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


def sole_ratio(data: Any) -> Iterator[Problem]:
    ratio, low, high = get(data, "method", "sole", "modulus_ratio"), *RATIO_RANGE
    extreme = get(data, "method", "sole", "allow_extreme") is True
    if _is_number(ratio) and ratio > 0 and not low <= ratio <= high and not extreme:
        yield Problem(("method", "sole", "modulus_ratio"), f"{ratio:g}", f"a number from {low:g} to {high:g}",
                      "take 0.5; outside the range rounding spoils the result (allow_extreme: true permits it for studies)")


def following(data: Any) -> Iterator[Problem]:
    """Sides that are paired anew as they slide change what crosses them from one load step to the next."""
    if not any(isinstance(entry, dict) and entry.get("pairing") == "follow" for _, entry in find(data, ("interfaces", "*"))):
        return
    if get(data, "method", "macro", "on") == "all":
        yield Problem(("method", "macro", "on"), "all beside pairing: follow", "perfect: a macro problem across sides that slide "
                      "on would have to be made anew with every pairing", "leave on out")
    increment = get(data, "method", "increment")
    if _is_number(increment) and increment > 1:
        yield Problem(("method", "increment"), f"{increment:g} beside pairing: follow", "one load step after the other: where sides "
                      "have slid to decides who meets next", "leave increment out")


def load_steps(data: Any) -> Iterator[Problem]:
    """Histories exist, and all entries agree on the number of steps."""
    histories = get(data, "histories") or {}
    counts: list[tuple[KeyPath, int]] = []
    for group, keys in ENTRIES.items():
        for path, entry in find(data, (group, "*")):
            if not isinstance(entry, dict) or not isinstance(histories, dict):
                continue
            keys = law_of(entry).Parameters.per_step if group == "interfaces" else keys
            listed = [key for key in keys if _is_per_step(entry.get(key))]
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
            yield Problem(path, f"{count} load steps", f"{counts[0][1]} load steps, as in {_dotted(counts[0][0])}",
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
        elif isinstance(factors, list) and all(map(_is_number, factors)) and (wrong := parameters.wrong_factors(factors)):
            yield Problem((*path, "history"), *wrong)


def prescribed_once(data: Any) -> Iterator[Problem]:
    """A displacement prescribes something, and the same place is not told two different things."""
    seen: dict[tuple[str, int], tuple[KeyPath, Any]] = {}
    for path, entry in find(data, ("boundary", "*")):
        vector = entry.get("displacement") if isinstance(entry, dict) else None
        rows = vector if _is_per_step(vector) else [vector]
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
                first, other = seen.setdefault((_show(entry.get("on")), component), (path, told))
                if other != told:
                    yield Problem((*path, "displacement"),
                                  f"component {'xyz'[component]} of this place prescribed again, differently",
                                  f"one value, as in {_dotted(first)}", "remove one of the two, or free it with null")
                    break


def acceleration_fits(data: Any) -> Iterator[Problem]:
    if get(data, "method", "acceleration") == "gmres" and not all(
            law_of(entry).perfect for _, entry in find(data, ("interfaces", "*"))):
        yield Problem(("method", "acceleration"), "gmres with interfaces that are not perfect",
                      "a linear problem for gmres", "use anderson")


def heeded(data: Any) -> Iterator[Problem]:
    """Keys of ``method`` that mean nothing beside others are refused, not ignored."""
    acceleration, memory = get(data, "method", "acceleration"), get(data, "method", "memory")
    if acceleration in ("gmres", "none") and memory not in (None, "auto"):
        why = "gmres keeps the whole history" if acceleration == "gmres" else "relaxation alone has none"
        yield Problem(("method", "memory"), f"memory: {_show(memory)} beside acceleration: {acceleration}",
                      f"memory beside acceleration: anderson only; {why}", "remove memory, or take anderson")
    kplus = get(data, "method", "search_direction", "kplus")
    opens = [(path, entry) for path, entry in find(data, ("interfaces", "*")) if not law_of(entry).perfect]
    stabilisation = get(data, "method", "contact", "stabilisation")
    if _is_number(stabilisation) and stabilisation and not opens:
        yield Problem(("method", "contact", "stabilisation"), f"stabilisation: {_show(stabilisation)} where all interfaces "
                      "are perfect", "a number beside interfaces that may open or slide", "remove it")
    if kplus not in (None, "exchange") and opens:
        path, entry = opens[0]
        yield Problem(("method", "search_direction", "kplus"), f"kplus: {_show(kplus)} beside law: {_show(entry.get('law'))} "
                      f"({_dotted(path)})", "a choice of k⁺ where all interfaces are perfect; beside other laws it is the "
                      "diagonal that their pointwise answers need", "remove kplus")


def a_mesh(data: Any) -> Iterator[Problem]:
    """A mesh or parts, not both, and matter for all of it."""
    if not isinstance(data, dict):
        return
    mesh, parts = data.get("mesh"), data.get("parts")
    if mesh is None and parts is None:
        yield Problem(("mesh",), "null" if "mesh" in data else "no mesh", "exactly one of beam, box, polycrystal, file and step; or parts", "add mesh")
    elif mesh is not None and parts is not None:
        yield Problem(("parts",), "mesh and parts together", "one of the two",
                      "make the mesh a part: parts: [{name: base, mesh: {…}}, …]")
    bare = [part.get("name") for _, part in find(data, ("parts", "*")) if isinstance(part, dict) and not part.get("material")
            and not part.get("deck")]  # which has moduli of its own
    if data.get("materials") is None and (parts is None or bare):
        yield Problem(("materials",), ("null" if "materials" in data else "no materials") + (f", and no material of {bare[0]}" if bare else ""),
                      "at least one, such as {young: 200e3, poisson: 0.3}", "add materials")


def parts_fit(data: Any) -> Iterator[Problem]:
    """Parts have names of their own, at most one element size, and one element."""
    seen: dict[str, int] = {}
    for path, part in find(data, ("parts", "*")):
        if not isinstance(part, dict):
            continue
        name = part.get("name")
        if isinstance(name, str) and seen.setdefault(name, path[1]) != path[1]:
            yield Problem((*path, "name"), f"a second part called '{name}'", "a name for each part", "give it another name")
        if part.get("h") is None:
            continue
        if get(part, "mesh", "step") is None:
            yield Problem((*path, "h"), "h of a part whose mesh is not from step", "h beside mesh: {step: …} only",
                          "remove h; beam and polycrystal have an h of their own")
        elif get(part, "mesh", "h") is not None:
            yield Problem((*path, "h"), "h of the part and h of its mesh", "one of the two", "remove one")
    said = [(("parts", i, "element"), element) for i, element in elements_of(get(data, "parts"))]
    code = get(data, "blackbox")
    first = next((entry for entry in (code if isinstance(code, list) else [code]) if isinstance(entry, dict)), {})
    if said and isinstance(element := first.get("element"), str):
        said.insert(0, (("blackbox", "element"), element))
    for path, element in said[1:]:
        if element != said[0][1]:
            yield Problem(path, f"{element} beside {said[0][1]} in {_dotted(said[0][0])}", "one element for all parts",
                          "choose one: parts of different elements in one scene are not supported")


def foreign_parts(data: Any) -> Iterator[Problem]:
    """Parts whose mesh is not ours stay whole, where they are, and meet linear tets."""
    histories = get(data, "histories") or {}
    for kind in KINDS:
        for path, own in find(data, ("parts", "*", kind)):
            part = get(data, *path[:2])
            for key in ("move", "h", "element"):
                if part.get(key) is not None:
                    yield Problem((*path[:2], key), f"{key} of a part that is a {kind}", f"{key} beside mesh only",
                                  f"remove {key}: such a part is taken as it is, in the axes of its own files")
            cut = data.get("subdomains")
            if cut != "groups" and not (isinstance(cut, dict) and cut.get("groups") and cut.get("split_above") is None):
                yield Problem(("subdomains",), f"{_show(cut)} beside a part that is a {kind}", "groups: such a part is a subdomain",
                              "write subdomains: groups")
            code = data.get("blackbox")
            for entry in code if isinstance(code, list) else [code]:
                if isinstance(entry, dict) and entry.get("element") == "P2":
                    yield Problem(("blackbox",), f"element: P2 beside a part that is a {kind}", "element: P1 there",
                                  "write element: P1, with a finer mesh; the part's own elements may be quadratic")
            history = own.get("history") if isinstance(own, dict) else None
            if isinstance(history, str) and history not in histories:
                yield Problem((*path, "history"), f"history '{history}', which is not defined",
                              "one of " + ", ".join(histories) if histories else "a name defined under histories",
                              f"define it under histories: {{{history}: [0.5, 1.0]}}")


def directions(data: Any) -> Iterator[Problem]:
    """Axes have a direction, and what is spread over a surface is something."""
    for where in (("parts", "*", "move", "rotate", "axis"), ("boundary", "*", "motion", "rotate", "axis"), ("loads", "*", "spin", "axis"),
                  ("bolts", "*", "cut", "plane"), ("boundary", "*", "frame", "axis")):
        for path, axis in find(data, where):
            if isinstance(axis, list) and not any(axis):
                yield Problem(path, _show(axis), "a direction: a vector other than zero", "write axis: z, or [0, 0, 1]")
    for path, resultant in find(data, ("boundary", "*", "resultant")):
        if isinstance(resultant, dict) and not resultant.get("force") and not resultant.get("moment"):
            yield Problem(path, "neither force nor moment", "one of them, or both", "add force: [0, 0, -1000]")


def probes_fit(data: Any) -> Iterator[Problem]:
    """Probes have names of their own, and keys that their quantity heeds."""
    seen: dict[str, int] = {}
    for path, probe in find(data, ("output", "probes", "*")):
        if not isinstance(probe, dict):
            continue
        name = probe.get("name") or f"probe_{path[-1] + 1}"
        if isinstance(name, str) and seen.setdefault(name, path[-1]) != path[-1]:
            yield Problem((*path, "name"), f"a second probe called '{name}'", "a name for each probe", "give it another name")
        resultant = probe.get("quantity") == "resultant"
        for key, fits, where in (("of", not resultant, "a mean or an extreme"), ("about", resultant, "a resultant")):
            if "on" in probe and probe.get(key) is not None and not fits:
                yield Problem((*path, key), f"{key} beside quantity: {_show(probe.get('quantity', 'mean'))}",
                              f"{key} beside {where} only", f"remove {key}")


def one_element(data: Any) -> Iterator[Problem]:
    """The same element in all entries of ``blackbox``."""
    elements = [(path, entry.get("element", settings_class(entry).model_fields["element"].default))
                for path, entry in find(data, ("blackbox", "*")) if isinstance(entry, dict)]
    for path, element in elements[1:]:
        if element != (first := elements[0][1]):
            yield Problem((*path, "element"), f"{element} beside {first}", "the same element in all entries",
                          "interfaces need the same nodes on both sides: choose one element")


def magnitudes(data: Any, path: KeyPath = ()) -> Iterator[Problem]:
    """Numbers whose products with each other are numbers still: twenty powers of ten more than any unit asks for."""
    if _is_number(data):
        known = isinstance(data, int) or math.isfinite(data)  # others are refused as no numbers
        if data and known and not SMALLEST <= abs(data) <= HUGEST:
            yield Problem(path, f"{data:.3g}" if isinstance(data, float) else f"a number of {len(str(data))} digits",
                          f"0, or a number from {SMALLEST:g} to {HUGEST:g} but for its sign",
                          "take units in which the problem's numbers are of ordinary size")
    elif isinstance(data, (dict, list)):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from magnitudes(value, (*path, key))


RULES = [following, magnitudes, exactly_one, belongs_to, places, temperatures, grounds, sole_ratio, load_steps, what_histories_multiply,
         prescribed_once, acceleration_fits, heeded, one_element, a_mesh, parts_fit, foreign_parts, directions, probes_fit]


def broken_rules(data: Any) -> list[Problem]:
    """Problems of all rules."""
    return [problem for rule in RULES for problem in rule(data)]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_per_step(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def _is_vectors(value: Any) -> bool:
    return _is_per_step(value) and all(isinstance(row, list) and all(map(_is_number, row)) for row in value)


def law_of(entry: Any) -> Any:
    """The class of the law that a raw entry of ``interfaces`` names; of none, or of an unknown one, the default."""
    name = entry.get("law") if isinstance(entry, dict) else None
    return LAWS[name if isinstance(name, str) and name in LAWS else DEFAULT_LAW]


def _dotted(path: KeyPath) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")


def _show(value: Any) -> str:
    """Text of a value that does not depend on the order of keys nor on 1 against 1.0."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_show(value[key])}" for key in sorted(value)) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_show, value)) + "]"
    return f"{value:.12g}" if _is_number(value) else str(value)
