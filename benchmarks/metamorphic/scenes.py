"""Draw whole scenes, as plain data of the YAML.

``scenes()`` gives (data, words): ``words`` tell what the scene has of each feature, for the tables of what was tried.
Magnitudes are about one in units of a strain of a thousandth, so that gaps of some hundredths of a cell close or not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from benchmarks.metamorphic.layout import FACES, Body, Pair, bodies, rounded
from benchmarks.metamorphic.probes import probes
from benchmarks.metamorphic.tools import pressing

YOUNG, STRAIN = 200e3, 1e-3
HISTORIES = {"one": None, "two steps": [0.5, 1.0], "off": [1.0, 0.0], "reversal": [1.0, -1.0], "on and back": [0.4, 1.0, -0.5],
             "four": [1.0, 1.0, 0.2, -0.7]}
CUTS = ["groups"] * 5 + ["split"] * 2 + ["metis", "slices", "grid"]
PRESCRIBING = ("displacement", "partly", "motion", "frame", "rigid coupling", "distributed coupling")
LAWS = ["perfect"] * 5 + ["contact"] * 7 + ["elastic", "elastic", "taut", "jump", "jump", "cohesive"]


@st.composite
def scenes(draw) -> tuple[dict[str, Any], list[str]]:
    """A scene and the words for its features."""
    found, pairs, words = draw(bodies())
    unit = draw(st.sampled_from([1.0] * 5 + [1e-3, 25.0]))
    data: dict[str, Any] = {"name": "trial", "parts": [b.entry(unit) for b in found]}
    steps = draw(st.sampled_from(["one", "one", *HISTORIES]))
    history = HISTORIES[steps]
    words.add(f"history {steps}")
    data["subdomains"] = _cut(draw, found, words)
    data["materials"] = _materials(draw, found, data["parts"], words)
    if history is not None:
        data["histories"] = {"h": history}
    timed = {} if history is None else {"history": "h"}
    data["boundary"] = _boundary(draw, found, unit, timed, words)
    loads = _loads(draw, data, found, unit, timed, words)
    if loads:
        data["loads"] = loads
    if laws := _laws(draw, found, pairs, unit, timed, words):
        data["interfaces"] = laws
    if draw(st.sampled_from([False] * 4 + [True])) and (
            pressed := pressing(draw, found, data["boundary"], unit, YOUNG, STRAIN, words)):
        pressed["between"][1] |= timed if draw(st.booleans()) else {}
        data["interfaces"] = [*laws, pressed]
    if data["subdomains"] == "groups" and draw(st.sampled_from([False] * 7 + [True])):
        if bolt := _bolt(draw, found[0], data["boundary"], unit, timed):
            data["bolts"] = [bolt]
            words |= {"bolt", f"bolt {bolt['then']}"}
    if draw(st.sampled_from([False, False, True])):
        data["output"] = {"probes": probes(draw, found, unit, words)}
    data["method"] = {"tolerance": {"error": 1e-8}, "max_iterations": 200}
    if draw(st.sampled_from([False] * 5 + [True])):
        data["blackbox"] = {"code": "freefem", "element": "P2"}
        words.add("P2")
    return data, sorted(words)


def _cut(draw, found: list[Body], words: set[str]) -> Any:
    how = draw(st.sampled_from(CUTS if len(found) == 1 else ["groups"] * 5 + ["split", "metis"]))
    words.add(f"cut {how}")
    if how == "split":
        return {"groups": True, "split_above": draw(st.sampled_from([60, 100, 200]))}
    if how == "metis":
        return {"metis": draw(st.integers(2, 5))}
    if how == "slices":
        return {"slices": {"axis": draw(st.sampled_from("xyz")), "count": draw(st.integers(2, 3))}}
    if how == "grid":
        return {"grid": [draw(st.integers(1, 2)) for _ in "xyz"]}
    return "groups"


def _materials(draw, found: list[Body], parts: list[dict], words: set[str]) -> list[dict]:
    def matter() -> dict:
        return {"young": YOUNG * draw(st.sampled_from([1, 1, 1, 1, 0.1, 0.3, 1e-3, 1e3])),
                "poisson": draw(st.sampled_from([0.3, 0.3, 0.0, 0.2, 0.45, -0.3]))}

    result = [matter()]
    for part in parts:
        how = draw(st.sampled_from(["same"] * 4 + ["on", "own"]))
        if how == "on":
            result.append({**matter(), "on": part["name"]})
        elif how == "own":
            part["material"] = matter()
            words.add("matter of a part")
        if how != "same":
            words.add("several matters")
    return result


def _vector(draw, size: float) -> list[float]:
    values = st.sampled_from([0.0, 1.0, -1.0, 0.3, 2.0, -0.5])
    vector = [draw(values) * size for _ in "xyz"]
    return vector if any(vector) else [0.0, 0.0, -size]


def _boundary(draw, found: list[Body], unit: float, timed: dict, words: set[str]) -> list[dict]:
    free = {(id(b), face): (b, face) for b in found for face in FACES if face not in b.used}
    length, stress = unit * STRAIN, YOUNG * STRAIN
    first = found[0]
    own = [face for b, face in free.values() if b is first] or FACES
    face = draw(st.sampled_from(own))
    free.pop((id(first), face), None)
    result = [{"on": first.surface(face), "displacement": [0.0, 0.0, 0.0]}]
    kinds = ["traction"] * 3 + ["displacement"] * 3 + ["held", "partly", "pressure", "linear pressure", "resultant", "motion", "symmetry",
                                                       "foundation", "rigid coupling", "distributed coupling", "frame"]
    for _ in range(draw(st.integers(1, 3))):
        if not free:
            break
        key = draw(st.sampled_from(sorted(free, key=lambda k: (free[k][0].name, k[1]))))
        body, face = free.pop(key)
        kind = draw(st.sampled_from(kinds))
        if kind in PRESCRIBING and any(_prescribes(e) and e["on"].startswith(body.name + "/") for e in result) and draw(st.integers(0, 9)):
            kind = "traction"  # two that are prescribed contradict each other on the edge that they share
        entry = {"on": body.surface(face), **_acting(draw, kind, body, face, unit, length, stress)}
        if "foundation" not in entry and "symmetry" not in entry and kind != "held" and draw(st.booleans()):
            entry |= timed
        words.add(kind)
        result.append(entry)
    return result


def _prescribes(entry: dict) -> bool:
    return bool({"displacement", "motion", "coupling", "symmetry"} & set(entry))


def _acting(draw, kind: str, body: Body, face: tuple[int, int], unit: float, length: float, stress: float) -> dict:
    """What an entry of ``boundary`` says beside where."""
    centre = rounded((body.low + body.size / 2) * unit)
    extent = float(max(body.size)) * unit
    if kind == "held":
        return {"displacement": [0.0, 0.0, 0.0]}
    if kind == "displacement":
        return {"displacement": _vector(draw, length)}
    if kind == "partly":
        vector: list = _vector(draw, length)
        vector[draw(st.integers(0, 2))] = None
        return {"displacement": vector}
    if kind == "traction":
        return {"traction": _vector(draw, stress)}
    if kind == "pressure":
        return {"pressure": stress * draw(st.sampled_from([1.0, 0.2, -0.3]))}
    if kind == "linear pressure":
        return {"pressure": {"value": stress, "at": centre, "gradient": _vector(draw, 0.3 * stress / unit)}}
    if kind == "resultant":
        return {"resultant": {"force": _vector(draw, stress * unit**2), "moment": _vector(draw, 0.3 * stress * unit**3)}}
    if kind == "motion":
        return {"motion": {"translate": _vector(draw, length), "rotate": {
            "axis": draw(st.sampled_from(["x", "y", "z", [1.0, 1.0, 0.0]])), "degrees": draw(st.sampled_from([0.05, -0.02])),
            "about": centre}}}
    if kind == "symmetry":
        return {"symmetry": True}
    if kind == "foundation":
        stiff = 0.1 * YOUNG / unit
        return {"foundation": draw(st.sampled_from([{"normal": stiff}, {"normal": stiff, "tangential": 0.3 * stiff},
                                                    {"stiffness": [stiff, 0.0, 2 * stiff]}]))}
    if kind == "frame":
        axis = draw(st.sampled_from("xyz"))
        at = rounded((body.low - 2 - body.size) * unit)
        said = draw(st.sampled_from([{"traction": _vector(draw, stress)}, {"displacement": [length, 0.0, 0.0]},
                                     {"displacement": [None, 0.0, None]}]))
        return {**said, "frame": {"axis": axis, "at": at}}
    coupling: dict[str, Any] = {"kind": kind.split()[0]}
    if draw(st.booleans()):
        coupling["about"] = [centre[0] + extent, centre[1], centre[2]]
    if draw(st.booleans()):
        coupling |= {"force": _vector(draw, stress * unit**2), "moment": _vector(draw, 0.3 * stress * unit**3)}
    else:
        coupling |= {"displacement": _vector(draw, length), "rotation": [0.02, 0.0, None]}
    return {"coupling": coupling}


def _loads(draw, data: dict, found: list[Body], unit: float, timed: dict, words: set[str]) -> list[dict]:
    result = []
    stress, extent = YOUNG * STRAIN, unit
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 1, 2]))):
        kind = draw(st.sampled_from(["body force", "gravity", "spin", "temperature", "linear temperature"]))
        entry: dict[str, Any]
        if kind == "body force":
            entry = {"body_force": _vector(draw, 0.1 * stress / extent)}
        elif kind == "gravity":
            entry = {"gravity": _vector(draw, 0.1 * stress / extent)}
        elif kind == "spin":
            entry = {"spin": {"axis": draw(st.sampled_from("xyz")), "rate": float(np.sqrt(0.1 * stress) / extent),
                              "about": _vector(draw, unit)}}
        elif kind == "temperature":
            entry = {"temperature": draw(st.sampled_from([50.0, -20.0]))}
        else:
            entry = {"temperature": {"value": 20.0, "at": [0.0, 0.0, 0.0], "gradient": _vector(draw, 10 / unit)}}
        if kind in ("gravity", "spin"):
            for matter in data["materials"] + [p["material"] for p in data["parts"] if "material" in p]:
                matter["density"] = 1.0
        elif "temperature" in kind:
            for part in data["parts"]:  # a part's own has no expansion
                if "material" in part:
                    data["materials"].append({**part.pop("material"), "on": part["name"]})
            for matter in data["materials"]:
                matter["expansion"] = 1.2e-5
        if len(found) > 1 and draw(st.sampled_from([False, False, True])):
            entry["on"] = draw(st.sampled_from(found)).name
        if draw(st.booleans()):
            entry |= timed
        words.add(kind)
        result.append(entry)
    return result


def _laws(draw, found: list[Body], pairs: list[Pair], unit: float, timed: dict, words: set[str]) -> list[dict]:
    if len(found) == 1:
        if draw(st.sampled_from([True, True, False])):
            return []
        words.add("law between blocks")
        law = _law(draw, draw(st.sampled_from(["contact", "contact", "elastic"])), None, unit, timed, words)
        return [{"between": ["*", "*"], **law}]
    result: list[dict] = []
    base = draw(st.sampled_from(["none", "perfect", "auto", "auto"]))
    if base == "perfect":
        result.append({"between": ["*", "*"], "law": "perfect"})
    elif base == "auto":
        law = draw(st.sampled_from(LAWS))
        if law == "jump":
            law = "contact"
        entry = {"between": "auto", **_law(draw, law, None, unit, {}, words)}
        if draw(st.booleans()):
            entry["tolerance"] = draw(st.sampled_from([0.02, 0.3, 1.0, 2.5]))
            words.add("auto with a tolerance")
        elif (far := max(pair.gap for pair in pairs)) > 0.1:
            entry["tolerance"] = 2 * far
            words.add("auto with a tolerance")
        words.add("auto")
        result.append(entry)
    for pair in pairs:
        if base != "none" and draw(st.booleans()) or not pair.faces and draw(st.sampled_from([True] * 9 + [False])):
            continue
        names = draw(st.sampled_from([[pair.first.name, pair.second.name], [pair.second.name, pair.first.name]]))
        law = draw(st.sampled_from(LAWS if pair.gap <= 0 else ["contact"] * 9 + LAWS))
        result.append({"between": names, **_law(draw, law, pair, unit, timed, words)})
    return result


def _bolt(draw, body: Body, boundary: list[dict], unit: float, timed: dict) -> dict | None:
    """The first body, cut between two layers of cells and held at both ends: what a bolt's force needs to pull at."""
    axis, end = next(face for face in FACES if body.surface(face) == boundary[0]["on"])
    far = (axis, 1 - end)
    if body.cells[axis] < 2 or far in body.used or any(e["on"] == body.surface(far) for e in boundary):
        return None
    boundary.append({"on": body.surface(far), "displacement": [0.0, 0.0, 0.0]})
    at = float((body.low + draw(st.integers(1, body.cells[axis] - 1)) * body.size / np.array(body.cells))[axis] * unit)
    return {"on": body.name, "cut": {"plane": "xyz"[axis], "at": float(f"{at:.12g}")},
            "force": YOUNG * STRAIN * unit**2 * draw(st.sampled_from([0.3, 2.0])),
            "then": draw(st.sampled_from(["locked", "force"]))} | (timed if draw(st.booleans()) else {})


def _law(draw, law: str, pair: Pair | None, unit: float, timed: dict, words: set[str]) -> dict:
    words.add(f"law {law}")
    stiff = YOUNG / unit * draw(st.sampled_from([0.1, 1.0, 100.0])) if law in ("elastic", "taut", "cohesive") else 0.0
    if law == "elastic":
        return {"law": "elastic", "stiffness_n": stiff, "stiffness_t": 0.4 * stiff}
    if law == "taut":
        return {"law": "elastic", "stiffness_n": stiff, "stiffness_t": 0.4 * stiff, "tension_only": True}
    if law == "cohesive":  # tough enough not to snap
        strength = YOUNG * STRAIN * draw(st.sampled_from([0.3, 1.0, 1e3]))
        return {"law": "cohesive", "stiffness": stiff, "strength": strength, "toughness": 20 * strength**2 / stiff}
    if law == "jump":
        return {"law": "jump", "jump": _vector(draw, unit * STRAIN)} | (timed if draw(st.booleans()) else {})
    if law == "perfect":
        return {"law": "perfect"}
    entry: dict[str, Any] = {"law": "contact"}
    friction = draw(st.sampled_from([0.0, 0.1, 0.3, 0.8]))
    if friction:
        entry["friction"] = friction
        words.add("friction")
    free = pair is None or not pair.gap
    gap = draw(st.sampled_from([None, None, "geometry", 0.5e-3, -0.5e-3] if free else ["geometry", "geometry", None]))
    if gap is not None:
        entry["gap"] = gap if gap == "geometry" else gap * unit
        words.add("gap " + ("geometry" if gap == "geometry" else "given" if gap > 0 else "press fit"))
        if gap != "geometry" and timed and draw(st.sampled_from([False, False, True])):
            entry |= timed
            words.add("gap with a history")
    if draw(st.sampled_from([False] * 9 + [True])):
        entry["pairing"] = "follow"
        words.add("follow")
    return entry
