"""What must not change an answer, or must change it in a known way.

A relation makes of a scene its ``Variant``: another scene, and how the other's answer is seen as the first one's. None
where it has nothing to say of that scene.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.metamorphic import models, unchanged
from benchmarks.metamorphic.mirrored import mirrored
from benchmarks.metamorphic.tools import tools
from benchmarks.metamorphic.units import in_units, loaded, turned
from benchmarks.metamorphic.variant import Variant

ODD = ["Käse [1]", "a b", "x*", "q?", "ß-1_2.3", "Ω", "1", "groups", "auto", "null", "part.1.2", "9.5", "true", "a a  a", "-"]
SOUND_NAMES = ["Käse 1", "a b", "q.q", "ß-1_2.3", "1", "groups", "auto", "null", "part.1.2", "9.5", "true", "a a  a", "block 0-0-0"]


Relation = Callable[[dict[str, Any], np.random.Generator], "Variant | None"]


def turned_round(data: dict, rng: np.random.Generator) -> Variant | None:
    """By a quarter turn or two about an axis."""
    axis, times = int(rng.integers(3)), int(rng.integers(1, 4))
    from benchmarks.metamorphic.layout import quarter_turn

    turn = quarter_turn(axis, times)
    made = turned(data, turn, 90.0 * times, "xyz"[axis])
    return made and Variant(made, turn=turn)


def turned_askew(data: dict, rng: np.random.Generator) -> Variant | None:
    """By any angle about any axis."""
    axis, degrees = rng.normal(size=3), float(rng.uniform(5, 355))
    n, angle = axis / np.linalg.norm(axis), np.radians(degrees)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    made = turned(data, turn, degrees, [float(x) for x in axis])
    return made and Variant(made, turn=turn)


def other_units(data: dict, rng: np.random.Generator) -> Variant | None:
    """Lengths and forces in other units, up to nine powers of ten."""
    length, force = (float(rng.choice([1e-3, 1e3, 25.4, 1e-6, 7.0])) for _ in range(2))
    return Variant(in_units(data, length, force), length=length, force=force)


def loaded_more(data: dict, rng: np.random.Generator) -> Variant | None:
    """Everything that acts, and all gaps that are numbers, times a factor: all laws are homogeneous in that."""
    if any(e.get("gap") == "geometry" or e.get("between") == "auto" and e.get("law") == "contact" and "gap" not in e
           for e in data.get("interfaces", [])) or any(e.get("pairing") or e["law"] == "cohesive" for e in data.get("interfaces", [])) or tools(data):
        return None
    # contact opens, bolts pull, turning bodies are pulled out
    one_way = any(e["law"] == "contact" or e.get("tension_only") for e in data.get("interfaces", [])) or (
        "bolts" in data or any("spin" in e for e in data.get("loads", [])))
    factor = float(rng.choice([0.01, 3.0, 50.0] if one_way else [0.01, 3.0, -1.0]))
    return Variant(loaded(data, factor), factor=factor, force=1.0)


def renamed(data: dict, rng: np.random.Generator) -> Variant | None:
    """Parts and histories under other names."""
    names = [p["name"] for p in data["parts"]]
    new = dict(zip(names, rng.permutation(SOUND_NAMES)[: len(names)].tolist()))

    def changed(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            return {("H 1" if key == "histories" else k): changed(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [changed(v, key) for v in value]
        if key == "history":
            return "H 1"
        if key in ("name", "on", "between", "slave", "exclude", "part") and isinstance(value, str):
            head, slash, tail = value.partition("/")
            return new.get(head, head) + slash + tail
        return value

    made = {k: v if k == "name" else changed(v, k) for k, v in data.items()}
    return Variant(made, names={b: a for a, b in new.items()})


def reordered(data: dict, rng: np.random.Generator) -> Variant | None:
    """Parts, entries of boundary and loads in another order; laws too, where no two speak of one pair."""
    made = copy.deepcopy(data)
    order = rng.permutation(len(data["boundary"]))
    made["boundary"] = [made["boundary"][i] for i in order]
    made["parts"] = [made["parts"][i] for i in rng.permutation(len(made["parts"]))]
    if "loads" in made:
        made["loads"] = [made["loads"][i] for i in rng.permutation(len(made["loads"]))]
    return Variant(made, order=[int(i) for i in np.argsort(order)], joint=True)


def sides_swapped(data: dict, rng: np.random.Generator) -> Variant | None:
    """between: [b, a] for [a, b]; jumps go the other way."""
    def named(entry: dict) -> bool:
        return isinstance(entry["between"], list) and isinstance(entry["between"][1], str)

    if not any(named(e) and e["between"] != ["*", "*"] for e in data.get("interfaces", [])):
        return None
    made = copy.deepcopy(data)
    for entry in made["interfaces"]:
        if named(entry):
            entry["between"].reverse()
            if "jump" in entry:
                entry["jump"] = [0.0 - x for x in entry["jump"]]
    return Variant(made)


def cut_otherwise(data: dict, rng: np.random.Generator) -> Variant | None:
    """Cut in more, fewer or other subdomains; laws between blocks of one part go with the cut, so they stay."""
    if len(data["parts"]) == 1 and data.get("interfaces"):
        return None
    joined = any(e["law"] != "perfect" for e in data.get("interfaces", []))
    choices: list[Any] = ["groups", {"groups": True, "split_above": int(rng.integers(40, 300))}]
    if len(data["parts"]) == 1:
        choices += [{"metis": int(rng.integers(2, 6))}, {"slices": {"axis": str(rng.choice(list("xyz"))), "count": 2}},
                    {"grid": [int(x) for x in rng.integers(1, 3, 3)]}]
    elif not joined:
        choices += [{"metis": int(rng.integers(2, 6))}]
    choices = [c for c in choices if c != data["subdomains"]]
    return Variant({**data, "subdomains": choices[int(rng.integers(len(choices)))]}, cuts=True)


def solved_otherwise(data: dict, rng: np.random.Generator) -> Variant | None:
    """Other settings of the method, which shape the way and not the answer."""
    method: dict[str, Any] = copy.deepcopy(data["method"])
    bonded = all(e["law"] == "perfect" for e in data.get("interfaces", [])) and not any(
        "foundation" in e or "coupling" in e for e in data["boundary"])
    choices: list[dict] = [
        {"skip": {"congruent": False}},
        {"sole": {"kind": str(rng.choice(["layer", "symmetric", "springs"]))}},
        {"sole": {"modulus_ratio": float(rng.choice([0.2, 1.0, 2.0]))}},
        {"macro": {"strategy": str(rng.choice(["equilibrium", "continuity"])), "basis": str(rng.choice(["rigid", "affine"]))}},
        {"increment": int(rng.integers(1, 3))}]
    if bonded:
        choices += [{"acceleration": "gmres"}]
    else:
        choices += [{"sole": {"fit": False}}, {"sole": {"contact_ratio": 0.6}}, {"memory": 10}]
    method |= choices[int(rng.integers(len(choices)))]
    return Variant({**data, "method": method})


def solved_roughly(data: dict, rng: np.random.Generator) -> Variant | None:
    """To a larger error; of sides that slide on none is known."""
    if any(e.get("pairing") for e in data.get("interfaces", [])):
        return None
    method = {**data["method"], "tolerance": {"error": float(rng.choice([0.1, 0.01, 1e-4]))}}
    return Variant({**data, "method": method}, rough=True)


def in_two_sittings(data: dict, rng: np.random.Generator) -> Variant:
    """Stopped after a few iterations, one at least for each load step, and resumed."""
    steps = max((len(e["displacement"]) if isinstance(e.get("displacement", [0])[0], list) else 1
                 for e in data["boundary"]), default=1)
    return Variant({**data, "sittings": max(steps, len(_factors(data)), int(rng.integers(1, 12)))})


def batched(data: dict, rng: np.random.Generator) -> Variant | None:
    """Load steps solved one after the other, or in twos."""
    steps = len(_factors(data))
    return Variant({**data, "method": {**data["method"], "increment": int(rng.integers(1, steps))}}) if steps > 1 else None


def step_repeated(data: dict, rng: np.random.Generator) -> Variant | None:
    """The last load step once more: nothing changes any more."""
    if len(_factors(data)) == 1:
        return None
    made = {**data, "histories": {k: [*v, v[-1]] for k, v in data["histories"].items()}}
    count = len(data["histories"]["h"])
    return Variant(made, sums=np.eye(count, count + 1))


def superposed(data: dict, rng: np.random.Generator) -> Variant | None:
    """Whatever acts in a load step of its own, where all is linear: the answers add up."""
    if any(e["law"] in ("contact", "cohesive") or e.get("tension_only") for e in data.get("interfaces", [])) or "bolts" in data:
        return None
    made, factors = copy.deepcopy(data), []
    h = _factors(data)
    acting = [e for e in made["boundary"] if not {"symmetry", "foundation"} & set(e)] + made.get("loads", []) + [
        e for e in made.get("interfaces", []) if "jump" in e]
    for number, entry in enumerate(acting):
        factors.append(h if entry.get("history") else [1.0] * len(h))
        entry["history"] = f"h{number}"
    made["histories"] = {f"h{n}": [float(n == k) for k in range(len(acting))] for n in range(len(acting))}
    return Variant(made, sums=np.array(factors).T)


def said_otherwise(data: dict, rng: np.random.Generator) -> Variant:
    """The same in other words: lists in place of histories, weight as a body force, matter under materials."""
    made = copy.deepcopy(data)
    h = _factors(data)
    for entry in [*made["boundary"], *made.get("loads", [])]:
        if "gravity" in entry and all(m.get("density") == 1.0 for m in made["materials"]):
            entry["body_force"] = entry.pop("gravity")
        for key in ("displacement", "traction", "body_force"):
            if key in entry and entry.get("history"):
                entry[key] = [[x if x is None else x * f for x in entry[key]] for f in h]
                del entry["history"]
    for part in made["parts"]:
        if "material" in part:
            made["materials"].append({**part.pop("material"), "on": part["name"]})
    return Variant(made)


def _factors(data: dict) -> list[float]:
    """The factors of the history, per load step; a history that nothing names makes no load steps."""
    entries = [e for key in ("boundary", "loads", "interfaces", "bolts") for e in data.get(key, [])] + tools(data)
    return data["histories"]["h"] if any("history" in e for e in entries) else [1.0]


RELATIONS: dict[str, Relation] = {
    "turned by quarters": turned_round, "turned askew": turned_askew, "other units": other_units, "loaded more": loaded_more,
    "renamed": renamed, "reordered": reordered, "sides swapped": sides_swapped, "cut otherwise": cut_otherwise,
    "solved otherwise": solved_otherwise, "solved roughly": solved_roughly, "in two sittings": in_two_sittings,
    "batched": batched, "step repeated": step_repeated, "superposed": superposed, "said otherwise": said_otherwise,
    "cancelled": unchanged.cancelled, "after rest": unchanged.after_rest, "read from files": unchanged.read_from_files,
    "mirrored": mirrored}
# Dearer ones, tried on fewer scenes.
DOORS: dict[str, Relation] = {
    "another code": models.other_code, "part as matrix": models.part_as_matrix, "part as deck": models.part_as_deck,
    "part as form": models.part_as_form, "two ranks": models.two_ranks}
RELATIONS |= DOORS
