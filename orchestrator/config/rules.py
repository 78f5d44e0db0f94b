"""Rules that concern several keys at once: what belongs together, excludes another, or means
nothing beside it.

They read the raw data, not the validated model, so that a user sees them together with the errors
of single keys. Each is a function ``data → problems`` that skips what has no sensible shape
(reported elsewhere) and is listed in ``RULES``; those of what holds and loads the structure are in
``conditions``, of what is asked of the solution in ``asked``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from orchestrator.config.conditions import (accuracy_possible, acting, directions,
                                            load_steps, places, planes_have_points, probes_fit,
                                            what_histories_multiply)
from orchestrator.config.blackbox import settings_class
from orchestrator.config.method import RATIO_RANGE, ROUNDING
from orchestrator.config.mesh import KINDS, elements_of
from orchestrator.config.paths import (
    all_perfect, called_twice, codes, entries, find, follows, get, is_number, law_of, shown)
from orchestrator.config.tools import PLACE, SHAPES, tools_fit
from orchestrator.errors import KeyPath, Problem, dotted
from orchestrator.registry import IN_VOLUMES, ON_FACES

# of numbers in a configuration: squares of what is beyond leave double precision
SMALLEST, HUGEST = 1e-30, 1e30

SOURCES = ("beam", "box", "polycrystal", "file", "step")
# Mappings of which exactly one of some keys must be given.
ONE_OF: dict[KeyPath, tuple[str, ...]] = {
    ("mesh",): SOURCES,
    ("parts", "*"): ("mesh", *KINDS),
    ("parts", "*", "mesh"): SOURCES,
    ("subdomains",): ("slices", "grid", "metis", "groups"),
    ("method", "tolerance"): ("error", "law", "indicator"),
    ("boundary", "*"): tuple(ON_FACES),
    ("loads", "*"): tuple(IN_VOLUMES),
    PLACE: SHAPES,
}


def exactly_one(data: Any) -> Iterator[Problem]:
    for pattern, keys in ONE_OF.items():
        for path, value in entries(data, *pattern):
            given = [key for key in value if key in keys and value[key] is not None]
            if len(given) > 1:
                yield Problem((*path, given[1]), " and ".join(given) + " together",
                              "exactly one of " + ", ".join(keys),
                              f"keep {given[0]} or {given[1]}, remove the other")
            elif not given:
                empty = [f"{key}: null" for key in value if key in keys]
                yield Problem(path, " and ".join(empty) or "none of " + ", ".join(keys),
                              "exactly one of " + ", ".join(keys) if empty else
                              "exactly one of them",
                              "say what it is, or remove the entry" if empty
                              else f"add one, such as {keys[0]}")


def belongs_to(data: Any) -> Iterator[Problem]:
    """Keys that mean something only beside another one."""
    meshes = (("mesh",), ("parts", "*", "mesh"))
    for pattern, key, partner in (*((mesh, key, "step") for mesh in meshes
                                    for key in ("h", "conforming", "exclude", "refine")),
                                  (("subdomains",), "split_above", "groups")):
        for path, value in entries(data, *pattern):
            if value.get(key) is not None and value.get(partner) is None:
                yield Problem((*path, key), f"{key} without {partner}",
                              f"{key} beside {partner} only", f"remove {key}, or use {partner}")
    for mesh in meshes:
        for path, value in entries(data, *mesh):
            if isinstance(sizes := value.get("h"), dict):
                if "curvature" not in sizes and value.get("conforming") is not False:
                    yield Problem((*path, "h"),
                                  "an element size for each solid, where solids share their faces",
                                  "one number, or solids that share nothing",
                                  "write conforming: false beside it")
                for name, size in [("", sizes), *sizes.items()]:
                    low, high = get(size, "min"), get(size, "max")
                    if is_number(low) and is_number(high) and low > high:
                        yield Problem((*path, "h", *[name] * bool(name)),
                                      f"min: {low:g} above max: {high:g}", "min below max",
                                      "swap them")
            if value.get("rename") is not None and value.get("step") is None and value.get(
                "file") is None:
                yield Problem((*path, "rename"), "rename without step or file",
                              "rename beside volumes of a file", "remove rename")
    for path, tolerance in entries(data, "method", "tolerance"):
        if tolerance.get("fraction") is not None and tolerance.get("error") != "auto":
            fixed = next((f"{key}: {shown(tolerance[key])}" for key in ("error", "law", "indicator")
                          if tolerance.get(key) is not None), "no error")
            yield Problem((*path, "fraction"), f"fraction beside {fixed}",
                          "fraction beside error: auto only",
                          "remove fraction, or write error: auto")
    for path, entry in entries(data, "interfaces", "*"):
        for key, *told in law_of(entry).Parameters.broken(entry):
            yield Problem((*path, key), *told)


def rounding(data: Any) -> Iterator[Problem]:
    """Numbers of ``method`` with which rounding would spoil the result."""
    ratio, low, high = get(data, "method", "sole", "modulus_ratio"), *RATIO_RANGE
    extreme = get(data, "method", "sole", "allow_extreme") is True
    if is_number(ratio) and ratio > 0 and not low <= ratio <= high and not extreme:
        yield Problem(("method", "sole", "modulus_ratio"), f"{ratio:g}",
                      f"a number from {low:g} to {high:g}",
                      "take 0.5; outside the range rounding spoils the result (allow_extreme: "
                      "true permits it for studies)")
    error = get(data, "method", "tolerance", "error")
    if is_number(error) and 0 < error <= ROUNDING:
        yield Problem(("method", "tolerance", "error"), f"{error:g}",
                      f"a number > {ROUNDING:g}: rounding alone leaves as much",
                      "write error: 1e-8, or law: with interfaces that open, which compares "
                      "residuals")


def following(data: Any) -> Iterator[Problem]:
    """Sides that are paired anew as they slide change what crosses them from one load step to the
    next.
    """
    if not follows(data):
        return
    if get(data, "method", "macro", "on") == "all":
        yield Problem(("method", "macro", "on"), "all beside pairing: follow",
                      "perfect: a macro problem across sides that slide on would have to be made "
                      "anew with every pairing", "leave on out")
    increment = get(data, "method", "increment")
    if is_number(increment) and increment > 1:
        yield Problem(("method", "increment"), f"{increment:g} beside pairing: follow",
                      "one load step after the other: where sides have slid to decides who meets "
                      "next", "leave increment out")


def heeded(data: Any) -> Iterator[Problem]:
    """Keys of ``method`` that mean nothing beside others are refused, not ignored."""
    if get(data, "method", "tolerance", "law") is not None and all_perfect(data):
        yield Problem(("method", "tolerance", "law"), "law where all interfaces are perfect",
                      "error: there the energy error is bounded",
                      "write error in its place")
    acceleration, memory = get(data, "method", "acceleration"), get(data, "method", "memory")
    if acceleration == "gmres" and not all_perfect(data):
        yield Problem(("method", "acceleration"), "gmres with interfaces that are not perfect",
                      "a linear problem for gmres", "use anderson")
    if acceleration not in (None, "anderson") and memory not in (None, "auto"):
        why = "gmres keeps the whole history" if acceleration == "gmres" else "relaxation has none"
        yield Problem(("method", "memory"),
                      f"memory: {shown(memory)} beside acceleration: {acceleration}",
                      f"memory beside acceleration: anderson only; {why}",
                      "remove memory, or take anderson")
    kplus = get(data, "method", "search_direction", "kplus")
    opens = [(path, entry) for path, entry in find(data, ("interfaces", "*"))
             if not law_of(entry).perfect]
    stabilisation = get(data, "method", "contact", "stabilisation")
    if is_number(stabilisation) and stabilisation and not opens:
        yield Problem(("method", "contact", "stabilisation"),
                      f"stabilisation: {shown(stabilisation)} where all interfaces "
                      "are perfect", "a number beside interfaces that may open or slide",
                      "remove it")
    if kplus not in (None, "exchange") and opens:
        path, entry = opens[0]
        yield Problem(("method", "search_direction", "kplus"),
                      f"kplus: {shown(kplus)} beside law: {shown(entry.get('law'))} "
                      f"({dotted(path)})",
                      "a choice of k⁺ where all interfaces are perfect; beside other laws it is "
                      "the diagonal that their pointwise answers need", "remove kplus")


def one_element(data: Any) -> Iterator[Problem]:
    """Require one element in all entries of ``blackbox``."""
    elements = [(path, entry.get("element", settings_class(entry).model_fields["element"].default))
                for path, entry in entries(data, "blackbox", "*")]
    for path, element in elements[1:]:
        if element != (first := elements[0][1]):
            yield Problem((*path, "element"), f"{element} beside {first}",
                          "the same element in all entries",
                          "interfaces need the same nodes on both sides: choose one element")


def magnitudes(data: Any, path: KeyPath = ()) -> Iterator[Problem]:
    """Numbers whose products with each other are numbers still: twenty powers of ten more than any
    unit asks for.
    """
    if is_number(data):
        known = isinstance(data, int) or math.isfinite(data)  # others are refused as no numbers
        if data and known and not SMALLEST <= abs(data) <= HUGEST:
            yield Problem(path, f"{data:.3g}" if isinstance(data, float)
                          else f"a number of {len(str(data))} digits",
                          f"0, or a number from {SMALLEST:g} to {HUGEST:g} but for its sign",
                          "take units in which the problem's numbers are of ordinary size")
    elif isinstance(data, (dict, list)):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from magnitudes(value, (*path, key))


def a_mesh(data: Any) -> Iterator[Problem]:
    """A mesh or parts, not both, and matter for all of it."""
    if not isinstance(data, dict):
        return
    mesh, parts = data.get("mesh"), data.get("parts")
    if mesh is None and parts is None:
        yield Problem(("mesh",), "null" if "mesh" in data else "no mesh",
                      "exactly one of beam, box, polycrystal, file and step; or parts", "add mesh")
    elif mesh is not None and parts is not None:
        yield Problem(("parts",), "mesh and parts together", "one of the two",
                      "make the mesh a part: parts: [{name: base, mesh: {…}}, …]")
    bare = [part.get("name") for _, part in entries(data, "parts", "*")
            if not part.get("material") and not part.get("deck")]  # which has moduli of its own
    if data.get("materials") is None and (parts is None or bare):
        found = "null" if "materials" in data else "no materials"
        yield Problem(("materials",), found + (f", and no material of {bare[0]}" if bare else ""),
                      "at least one, such as {young: 200e3, poisson: 0.3}", "add materials")


def parts_fit(data: Any) -> Iterator[Problem]:
    """Parts have names of their own, at most one element size, and one element."""
    yield from called_twice(data, ("parts", "*"), "part", "")
    for path, part in entries(data, "parts", "*"):
        if part.get("h") is None:
            continue
        if get(part, "mesh", "step") is None:
            yield Problem((*path, "h"), "h of a part whose mesh is not from step",
                          "h beside mesh: {step: …} only",
                          "remove h; beam and polycrystal have an h of their own")
        elif get(part, "mesh", "h") is not None:
            yield Problem((*path, "h"), "h of the part and h of its mesh", "one of the two",
                          "remove one")
    said = [(("parts", i, "element"), element) for i, element in elements_of(get(data, "parts"))]
    first = next((entry for _, entry in codes(data)), {})
    if said and isinstance(element := first.get("element"), str):
        said.insert(0, (("blackbox", "element"), element))
    for path, element in said[1:]:
        if element != said[0][1]:
            yield Problem(path, f"{element} beside {said[0][1]} in {dotted(said[0][0])}",
                          "one element for all parts",
                          "choose one: parts of different elements in one scene are not supported")


def foreign_parts(data: Any) -> Iterator[Problem]:
    """Parts whose mesh is not ours stay whole, where they are, and meet linear tets."""
    for kind in KINDS:
        for path, _ in find(data, ("parts", "*", kind)):
            part = get(data, *path[:2])
            for key in ("move", "h", "element"):
                if part.get(key) is not None:
                    yield Problem((*path[:2], key), f"{key} of a part that is a {kind}",
                                  f"{key} beside mesh only",
                                  f"remove {key}: such a part is taken as it is, in the axes of "
                                  "its own files")
            cut = data.get("subdomains")
            if cut != "groups" and not (isinstance(cut, dict) and cut.get("groups")
                                        and cut.get("split_above") is None):
                yield Problem(("subdomains",), f"{shown(cut)} beside a part that is a {kind}",
                              "groups: such a part is a subdomain",
                              "write subdomains: groups")
            for _, entry in codes(data):
                if entry.get("element") == "P2":
                    yield Problem(("blackbox",), f"element: P2 beside a part that is a {kind}",
                                  "element: P1 there",
                                  "write element: P1, with a finer mesh; the part's own elements "
                                  "may be quadratic")


RULES = [following, magnitudes, rounding, exactly_one, belongs_to, places, acting, load_steps,
         what_histories_multiply, heeded,
         accuracy_possible, one_element, a_mesh, parts_fit, foreign_parts, directions, probes_fit,
         planes_have_points,
         tools_fit]


def broken_rules(data: Any) -> list[Problem]:
    """Problems of all rules."""
    return [problem for rule in RULES for problem in rule(data)]
