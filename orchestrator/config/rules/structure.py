"""Rules for what the structure is made of, and for the points that are watched: meshes, parts, probes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from orchestrator.config.foreign_parts import KINDS
from orchestrator.config.parts import elements_of
from orchestrator.config.paths import dotted, find, get, shown
from orchestrator.errors import Problem


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
            yield Problem(path, f"{element} beside {said[0][1]} in {dotted(said[0][0])}", "one element for all parts",
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
                yield Problem(("subdomains",), f"{shown(cut)} beside a part that is a {kind}", "groups: such a part is a subdomain",
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
                yield Problem((*path, key), f"{key} beside quantity: {shown(probe.get('quantity', 'mean'))}",
                              f"{key} beside {where} only", f"remove {key}")
