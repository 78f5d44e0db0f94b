"""The same scene in other units, and turned: what every number of the YAML is measured in, and which are vectors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

# (length, force) exponents of the numbers under a key, or under a key of that parent; what is not here is a bare number.
# Time stays as it is, so that a density is force · time² / length⁴.
DIMENSIONS: dict[str, tuple[int, int]] = {
    "size": (1, 0), "scale": (1, 0),
    "h": (1, 0), "radius": (1, 0), "centre": (1, 0), "level": (1, 0), "translate": (1, 0), "about": (1, 0), "at": (1, 0),
    "box": (1, 0), "displacement": (1, 0), "jump": (1, 0), "gap": (1, 0), "within": (1, 0), "young": (-2, 1), "density": (-4, 1),
    "gravity": (1, 0), "body_force": (-3, 1), "traction": (-2, 1), "pressure": (-2, 1), "value pressure": (-2, 1),
    "gradient pressure": (-3, 1), "gradient temperature": (-1, 0), "force": (0, 1), "moment": (1, 1), "normal": (-3, 1),
    "normal plane": (0, 0), "weight": (-3, 1), "tangential": (-3, 1), "stiffness": (-3, 1), "stiffness_n": (-3, 1),
    "stiffness_t": (-3, 1), "strength": (-2, 1), "toughness": (-1, 1), "moments_about": (1, 0)}
VECTORS = {"translate", "centre", "about", "displacement", "traction", "gradient", "force", "moment", "body_force", "gravity", "jump", "rotation"}
LOADS = {"displacement", "jump", "gap", "body_force", "gravity", "traction", "pressure", "value pressure", "gradient pressure",
         "weight", "value temperature", "gradient temperature", "temperature", "force", "moment", "rotation", "degrees motion", "translate motion"}
AXIAL = {"moment", "rotation"}  # go the other way round in a mirror


def mapped(data: Any, change: Callable[[str, str, Any], Any], key: str = "", parent: str = "") -> Any:
    """A copy of the data; ``change(key, parent, value)`` gives the new value of every leaf or vector.

    A list of entries hands its own key on as their parent; a list of vectors is changed vector by vector.
    """
    if isinstance(data, dict):
        return {k: mapped(v, change, k, key) for k, v in data.items()}
    if isinstance(data, list) and any(isinstance(x, (dict, list)) for x in data):
        return [mapped(x, change, key, key if isinstance(x, dict) else parent) for x in data]
    return change(key, parent, data)


def scaled(value: Any, factor: float) -> Any:
    """A number, or a list of numbers and nulls, times a factor; anything else as it is."""
    if isinstance(value, list):
        return [scaled(x, factor) for x in value]
    return value * factor if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def in_units(data: dict, length: float, force: float) -> dict:
    """The scene where a length that was 1 is ``length``, and likewise with forces."""
    def change(key: str, parent: str, value: Any) -> Any:
        if (key, parent) == ("stiffness", "matrix") or parent == "histories":
            return value
        a, b = DIMENSIONS.get(f"{key} {parent}", DIMENSIONS.get(key, (0, 0)))
        return scaled(value, length**a * force**b) if a or b else value

    return mapped(data, change)


def loaded(data: dict, factor: float) -> dict:
    """The scene with everything that acts, gaps too, times a factor above 0 (or any, where all is linear)."""
    def change(key: str, parent: str, value: Any) -> Any:
        return scaled(value, factor) if key in LOADS - {"value"} or f"{key} {parent}" in LOADS else value

    result = mapped({k: v for k, v in data.items() if k not in ("parts", "method", "output")}, change)
    for entry in result.get("loads", []):
        if "spin" in entry:
            entry["spin"]["rate"] *= float(np.sqrt(factor))
    for entry, old in zip(result["boundary"], data["boundary"]):
        if "motion" in old:
            motion = entry["motion"] = {k: dict(v) if isinstance(v, dict) else v for k, v in old["motion"].items()}
            motion["translate"] = scaled(motion.get("translate", [0, 0, 0]), factor)
            if "rotate" in motion:
                motion["rotate"]["degrees"] *= factor
    return {k: result.get(k, v) for k, v in data.items()}


def turned(data: dict, turn: np.ndarray, degrees: float, axis: Any) -> dict | None:
    """The scene turned by (3, 3) ``turn``, which is ``degrees`` about ``axis``; None where the YAML cannot say it so."""
    signed = np.allclose(np.abs(turn).max(axis=0), 1.0, atol=1e-12)

    def vector(value: list, key: str) -> list:
        if any(x is None for x in value) or key == "stiffness":
            if not signed:
                raise NotSayable
            turned_to = np.abs(turn).argmax(axis=0)  # own axis → the world's
            result: list = [None] * 3
            for own, world in enumerate(turned_to):
                x = value[own]
                result[world] = x if x is None or key == "stiffness" else float(x * np.sign(turn[world, own])) + 0.0
            return result
        return [float(x) for x in turn @ np.array(value, float)]

    def change(key: str, parent: str, value: Any) -> Any:
        if key == "axis" and not (isinstance(value, list) or value in "xyz") or value is None:
            return value
        if key in ("axis", "plane", "up") and parent != "slices" or (key, parent) == ("normal", "plane"):
            return [float(x) for x in turn @ (np.eye(3)["xyz".index(value)] if isinstance(value, str) else np.array(value, float))]
        if isinstance(value, list) and len(value) == 3 and (key in VECTORS or key == "at" or key == "stiffness" and parent == "foundation"):
            return vector(value, key)
        return value

    def framed(entry: dict) -> dict:
        """An entry of boundary: components along a frame stay."""
        if "frame" not in entry:
            return mapped(entry, change)
        return mapped({k: v for k, v in entry.items() if k == "frame"}, change) | {k: v for k, v in entry.items() if k != "frame"}

    try:
        result = mapped({k: v for k, v in data.items() if k not in ("parts", "boundary")}, change)
        result["boundary"] = [framed(entry) for entry in data["boundary"]]
        for bolt, old in zip(result.get("bolts", []), data.get("bolts", [])):
            point = old["cut"]["at"] * np.eye(3)["xyz".index(old["cut"]["plane"])]
            bolt["cut"]["at"] = [float(x) for x in turn @ point]
        if not signed and (any("symmetry" in e for e in data["boundary"]) or not {"groups"} >= set(_cut(data))):
            raise NotSayable
        if signed and "slices" in data["subdomains"]:
            world = int(np.abs(turn[:, "xyz".index(data["subdomains"]["slices"]["axis"])]).argmax())
            result["subdomains"] = {"slices": {**data["subdomains"]["slices"], "axis": "xyz"[world]}}
        if signed and "grid" in data["subdomains"]:
            result["subdomains"] = {"grid": [data["subdomains"]["grid"][int(np.abs(row).argmax())] for row in turn]}
    except NotSayable:
        return None
    result["parts"] = [_moved(part, turn, degrees, axis) for part in data["parts"]]
    return {k: result[k] for k in data}


class NotSayable(Exception):
    """The YAML has no words for a scene."""


def _cut(data: dict) -> list[str]:
    cut = data["subdomains"]
    return [cut] if isinstance(cut, str) else [k for k in cut if k != "split_above"]


def _moved(part: dict, turn: np.ndarray, degrees: float, axis: Any) -> dict:
    move = dict(part.get("move", {}))
    known = move.get("rotate", [])
    rotate = [*(known if isinstance(known, list) else [known]), {"axis": axis, "degrees": degrees}]
    shift = turn @ np.array(move.get("translate", [0.0, 0.0, 0.0]))
    return {**part, "move": {"rotate": rotate, "translate": [float(x) for x in shift]}}
