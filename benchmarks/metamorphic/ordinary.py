"""Draw ordinary scenes, kind by kind: what a user of contact sets up on any day.

``ordinary()`` gives (data, words) as ``scenes.scenes`` does; the word ``kind …`` names the kind. Data
are of ordinary size (moduli within a factor of ten, friction up to 0.8), and every scene has a
solution: one that a run gives up, or calls a limit load, is a failure of the run.
"""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from benchmarks.metamorphic.round_meshes import ring

YOUNG, STRAIN = 200e3, 1e-3
STRESS = YOUNG * STRAIN
ROLLER = {"x": [0.0, None, None], "y": [None, 0.0, None], "z": [None, None, 0.0]}
FRICTIONS = [0.0, 0.1, 0.3, 0.6, 0.8]
PATHS = {"press, let go, press": [1.0, 0.5, 1.0], "one": [1.0], "two": [0.5, 1.0]}


def _box(name: str, low: list[float], size: list[float], cells: list[int]) -> dict[str, Any]:
    move = {"move": {"translate": [float(x) for x in low]}} if any(low) else {}
    return {"name": name, "mesh": {"box": {"size": [float(x) for x in size], "cells": cells}}, **move}


def _scene(draw, parts: list[dict], boundary: list[dict], interfaces: list[dict], steps: list[float],
           **more: Any) -> dict[str, Any]:
    """A whole scene; entries with ``history: h`` follow the steps."""
    data = {"name": "trial", "parts": parts, "subdomains": "groups", "boundary": boundary,
            "materials": [{"young": YOUNG, "poisson": draw(st.sampled_from([0.3, 0.3, 0.0, 0.2, 0.45]))}],
            "interfaces": interfaces, "histories": {"h": steps}, **more,
            "method": {"tolerance": {"error": 1e-8}, "max_iterations": 500}}
    if len(parts) > 1 and draw(st.sampled_from([False, False, True])):
        data["materials"].append({"young": YOUNG * draw(st.sampled_from([0.1, 0.3, 3.0])),
                                  "poisson": 0.3, "on": parts[-1]["name"]})
    if "gravity" in str(more):
        for matter in data["materials"]:
            matter["density"] = 1.0
    if draw(st.sampled_from([False] * 5 + [True])):
        data["blackbox"] = {"code": "freefem", "element": "P2"}
    return data


def _contact(draw, **more: Any) -> dict[str, Any]:
    return {"between": "auto", "law": "contact", "friction": draw(st.sampled_from(FRICTIONS)), **more}


def _bricks(draw) -> tuple[list[dict], list[int]]:
    """Two to six bricks that fill a box, and how many there are along x, y, z; meshes match or not."""
    counts = draw(st.sampled_from([[2, 1, 1], [1, 1, 2], [3, 1, 1], [2, 1, 2], [2, 2, 1], [1, 1, 4], [3, 1, 2]]))
    parts = []
    for i in range(counts[0]):
        for j in range(counts[1]):
            for k in range(counts[2]):
                cells = [draw(st.integers(1, 3))] * 3 if draw(st.booleans()) else [2, 2, 2]
                parts.append(_box(f"b{i}{j}{k}", [i, j, k], [1, 1, 1], cells))
    return parts, counts


def _faces(parts: list[dict], counts: list[int], axis: int, end: int) -> list[str]:
    """Names of the outer faces of the bricks on one side of their box."""
    there = (counts[axis] - 1) if end else 0
    return [f"{p['name']}/{'xyz'[axis]}{'max' if end else 'min'}" for p in parts if int(p["name"][1 + axis]) == there]


def _confined(draw) -> dict[str, Any]:
    """Bricks between rollers on five sides, as in an oedometer, pressed from above."""
    parts, counts = _bricks(draw)
    boundary = [{"on": face, "displacement": ROLLER["xyz"[axis]]} for axis in range(3) for end in (0, 1)
                if (axis, end) != (2, 1) for face in _faces(parts, counts, axis, end)]
    pressed = draw(st.sampled_from([{"displacement": [None, None, -STRAIN]}, {"displacement": [0.0, 0.0, -STRAIN]},
                                    {"pressure": STRESS}]))
    boundary += [{"on": face, **pressed, "history": "h"} for face in _faces(parts, counts, 2, 1)]
    return _scene(draw, parts, boundary, [_contact(draw)], draw(st.sampled_from(list(PATHS.values()))))


def _grains(draw) -> dict[str, Any]:
    """A small polycrystal between rollers, or with free sides, pressed and sheared."""
    grains = draw(st.integers(4, 9))
    parts = [{"name": "g", "mesh": {"polycrystal": {"grains": grains, "size": [1.0, 1.0, 1.0], "h": 0.3,
                                                    "seed": draw(st.integers(1, 50))}}}]
    boundary = [{"on": "g/zmin", "displacement": [0.0, 0.0, 0.0]}]
    top: list[float | None] = [draw(st.sampled_from([0.0, 0.2 * STRAIN])), 0.0, -STRAIN]
    if draw(st.booleans()):
        boundary = [{"on": f"g/{axis}{end}", "displacement": ROLLER[axis]} for axis in "xyz" for end in ("min", "max")][:5]
        top[:2] = None, None
    boundary.append({"on": "g/zmax", "displacement": top, "history": "h"})
    law = {"between": ["*", "*"], "law": "contact", "friction": draw(st.sampled_from(FRICTIONS))}
    return _scene(draw, parts, boundary, [law], draw(st.sampled_from(list(PATHS.values()))))


def _die(draw) -> dict[str, Any]:
    """Bricks in a die whose floor and walls are rigid planes."""
    parts, counts = _bricks(draw)
    walls = draw(st.sampled_from([["x0", "x1"], ["x0", "x1", "y0", "y1"]]))
    rubs, laws = draw(st.sampled_from(FRICTIONS)), [_contact(draw)]
    for axis, end in [("z", 0), *((w[0], int(w[1])) for w in walls)]:
        at, normal = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        number = "xyz".index(axis)
        at[number], normal[number] = float(end * counts[number]), 1.0 - 2.0 * end
        laws += [{"between": [face.split("/")[0], {"plane": {"at": at, "normal": normal}}], "law": "contact", "friction": rubs}
                 for face in _faces(parts, counts, number, end)]
    boundary = [{"on": face, "displacement": [0.0, 0.0, -STRAIN], "history": "h"} for face in _faces(parts, counts, 2, 1)]
    return _scene(draw, parts, boundary, laws, draw(st.sampled_from(list(PATHS.values()))))


def _symmetric(draw) -> dict[str, Any]:
    """A smaller block pressed on a larger one, half or a quarter of it behind planes of symmetry."""
    fine = draw(st.integers(2, 3))
    parts = [_box("base", [0, 0, 0], [2, 2, 1], [fine, fine, 2]),
             _box("punch", [0, 0, 1], [1, 1, 1], [draw(st.integers(1, 3)), 2, 2])]
    planes = draw(st.sampled_from([["x"], ["x", "y"]]))
    boundary = [{"on": "base/zmin", "displacement": [0.0, 0.0, 0.0]}]
    boundary += [{"on": f"{p}/{axis}min", "symmetry": True} for axis in planes for p in ("base", "punch")]
    way = [0.0 if "x" in planes else None, 0.0 if "y" in planes else 0.3 * STRAIN, -STRAIN]
    boundary.append({"on": "punch/zmax", "displacement": way, "history": "h"})
    return _scene(draw, parts, boundary, [_contact(draw)], draw(st.sampled_from(list(PATHS.values()))))


def _layer(draw) -> dict[str, Any]:
    """Two plates with a thin layer between them, pairs found by themselves."""
    thick = draw(st.sampled_from([0.02, 0.05, 0.2]))
    n, m = draw(st.integers(2, 3)), draw(st.integers(2, 4))
    parts = [_box("low", [0, 0, 0], [2, 2, 1], [n, n, 1]), _box("layer", [0, 0, 1], [2, 2, thick], [m, m, 1]),
             _box("top", [0, 0, 1 + thick], [2, 2, 1], [n, n, 1])]
    law = draw(st.sampled_from([{"law": "perfect"}, {"law": "contact", "friction": 0.3}]))
    boundary = [{"on": "low/zmin", "displacement": [0.0, 0.0, 0.0]},
                {"on": "top/zmax", "displacement": [0.2 * STRAIN, 0.0, -STRAIN], "history": "h"}]
    return _scene(draw, parts, boundary, [{"between": "auto", **law}], draw(st.sampled_from(list(PATHS.values()))))


def _fit(draw) -> dict[str, Any]:
    """A ring pressed on a shaft, then turned or pulled by its outer face."""
    sectors = draw(st.sampled_from([8, 12]))
    other = sectors if draw(st.booleans()) else sectors + 4
    files = {"shaft.msh": ring(0.4, 1.0, 1.0, sectors, 1, 2), "ring.msh": ring(1.0, 1.6, 1.0, other, 1, 2)}
    parts = [{"name": name, "mesh": {"file": f"{name}.msh", "scale": 1.0}} for name in ("shaft", "ring")]
    friction = draw(st.sampled_from([0.1, 0.2, 0.4]))
    laws = [{"between": ["ring", "shaft"], "law": "contact", "friction": friction, "gap": -STRAIN, "history": "on"}]
    moved = draw(st.sampled_from([{"translate": [0.0, 0.0, 0.3 * STRAIN]},
                                  {"rotate": {"axis": "z", "degrees": 0.02, "about": [0.0, 0.0, 0.0]}}]))
    boundary = [{"on": "shaft/inner", "displacement": [0.0, 0.0, 0.0]}, {"on": "ring/outer", "motion": moved, "history": "h"}]
    return _scene(draw, parts, boundary, laws, [0.0, 1.0], files=files) | {"histories": {"h": [0.0, 1.0], "on": [1.0, 1.0]}}


def _lands(draw) -> dict[str, Any]:
    """A block that falls on the ground, or on another block, by its weight or a push."""
    gap = draw(st.sampled_from([0.001, 0.01, 0.1, 1.0]))
    parts = [_box("a", [0, 0, gap], [1, 1, 1], [2, 2, 2])]
    laws: list[dict] = []
    boundary: list[dict] = []
    rubs = draw(st.sampled_from([0.1, 0.3, 0.6]))
    if draw(st.booleans()):
        laws.append({"between": ["a", {"plane": {"at": [0.0, 0.0, 0.0], "normal": "z"}}], "law": "contact",
                     "friction": rubs, "within": 3.0})
    else:
        parts.insert(0, _box("ground", [-1, -1, -1], [3, 3, 1], [3, 3, 1]))
        boundary.append({"on": "ground/zmin", "displacement": [0.0, 0.0, 0.0]})
        laws.append({"between": ["ground", "a"], "law": "contact", "friction": rubs, "gap": "geometry"})
    if draw(st.booleans()):
        return _scene(draw, parts, boundary, laws, [1.0], loads=[{"gravity": [0.0, 0.0, -0.1 * STRESS]}])
    boundary.append({"on": "a/zmax", "traction": [0.02 * STRESS, 0.0, -STRESS], "history": "h"})
    return _scene(draw, parts, boundary, laws, draw(st.sampled_from([[1.0], [0.5, 1.0]])))


def _path(draw) -> dict[str, Any]:
    """Two blocks pressed, then rubbed to and fro in ten to twenty load steps."""
    count, turns = draw(st.integers(10, 20)), draw(st.sampled_from([3, 5, 7]))
    to_and_fro = [draw(st.sampled_from([1.0, 0.7])) * (1 - 2 * ((k // turns) % 2)) * (1 + k % turns) / turns for k in range(count)]
    parts = [_box("low", [0, 0, 0], [2, 2, 1], [2, 2, 2]), _box("top", [0.5, 0.5, 1], [1, 1, 1], [2, 2, 1])]
    boundary = [{"on": "low/zmin", "displacement": [0.0, 0.0, 0.0]},
                {"on": "top/zmax", "displacement": [[f * 0.4 * STRAIN, 0.0, -STRAIN] for f in to_and_fro]}]
    data = _scene(draw, parts, boundary, [_contact(draw)], [1.0])
    del data["histories"]
    return data


def _weight(draw) -> dict[str, Any]:
    """A table on its legs, or a stack, that its own weight alone holds on the ground."""
    if draw(st.booleans()):
        parts = [_box(f"leg{i}{j}", [2 * i, 2 * j, 0], [1, 1, 1], [1, 1, 2]) for i in (0, 1) for j in (0, 1)]
        parts.append(_box("top", [0, 0, 1], [3, 3, 0.5], [3, 3, 1]))
    else:
        parts = [_box(f"s{k}", [0.1 * (k % 2), 0, k], [1, 1, 1], [2, 2, 1]) for k in range(draw(st.integers(2, 5)))]
    ground = [_box("ground", [-1, -1, -1], [5, 5, 1], [5, 5, 1])]
    boundary = [{"on": "ground/zmin", "displacement": [0.0, 0.0, 0.0]}]
    law = {"between": "auto", "law": "contact", "friction": draw(st.sampled_from([0.1, 0.3, 0.6]))}
    side = draw(st.sampled_from([0.0, 0.005]))  # a twentieth of the weight: friction carries it
    return _scene(draw, ground + parts, boundary, [law], [1.0],
                  loads=[{"gravity": [side * STRESS, 0.0, -0.1 * STRESS]}])


KINDS = {"confined": _confined, "grains": _grains, "die": _die, "symmetry": _symmetric, "thin layer": _layer,
         "press fit": _fit, "lands": _lands, "path": _path, "own weight": _weight}


@st.composite
def ordinary(draw) -> tuple[dict[str, Any], list[str]]:
    """A scene of one of the kinds, and its words."""
    kind = draw(st.sampled_from(list(KINDS)))
    data = KINDS[kind](draw)
    words = {f"kind {kind}", f"{len(data['parts'])} parts"}
    if data.get("blackbox", {}).get("element") == "P2":
        words.add("P2")
    frictions = [e.get("friction", 0.0) for e in data["interfaces"]]
    words |= {f"friction {max(frictions):g}"}
    if not any("history" in e for key in ("boundary", "loads", "interfaces") for e in data.get(key, [])):
        data.pop("histories", None)
    return data, sorted(words)
