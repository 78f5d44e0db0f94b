"""The relation of a scene behind planes of symmetry to the whole of it: every part's mesh and its mirror image."""

from __future__ import annotations

import copy

import numpy as np

from benchmarks.metamorphic.round_meshes import text_of
from benchmarks.metamorphic.variant import Variant
from orchestrator import build_scene, config_from


def mirrored(data: dict, rng: np.random.Generator) -> Variant | None:
    """Return the whole of a scene whose planes of symmetry are x = 0 or y = 0; None where it has none.

    The mirror image of a mesh keeps its operators, so that the half of the whole is the half itself.
    """
    planes = sorted({e["on"].split("/")[1][0] for e in data["boundary"] if e.get("symmetry")})
    if not planes or not all(_beside(part, planes, data["boundary"]) for part in data["parts"]):
        return None
    made, files = copy.deepcopy(data), {}
    made["boundary"] = [e for e in made["boundary"] if not e.get("symmetry")]
    for number, part in enumerate(made["parts"]):
        alone = {"name": "alone", "parts": [{k: part[k] for k in ("name", "mesh")}], "subdomains": "groups",
                 "boundary": [{"on": f"{part['name']}/zmin", "displacement": [0, 0, 0]}],
                 "materials": [{"young": 1.0, "poisson": 0.3}], "blackbox": {"code": "in-process"}}
        mesh = build_scene(config_from(alone)).mesh
        nodes, cells, size = mesh.nodes, mesh.cells[:, :4], np.array(part["mesh"]["box"]["size"])
        for axis in planes:
            nodes, cells = _doubled(nodes, cells, "xyz".index(axis), 1e-9 * size.max())
        low = np.where([axis in planes for axis in "xyz"], -size, 0.0)
        named = {letter + end: np.flatnonzero(np.abs(nodes[:, axis] - value[axis]) < 1e-9 * size.max())
                 for axis, letter in enumerate("xyz") for end, value in (("min", low), ("max", size))}
        files[f"{number}.msh"] = text_of(nodes, cells, named)
        part["mesh"] = {"file": f"{number}.msh"}
    return Variant({**made, "files": files}, whole=True, shuffled=True)


def _beside(part: dict, planes: list[str], boundary: list[dict]) -> bool:
    """Return whether a part is an unturned box whose lower faces lie on all the planes."""
    move = part.get("move", {})
    return "box" in part["mesh"] and "rotate" not in move and all(
        move.get("translate", [0.0] * 3)["xyz".index(axis)] == 0
        and any(e.get("symmetry") and e["on"] == f"{part['name']}/{axis}min" for e in boundary) for axis in planes)


def _doubled(nodes: np.ndarray, cells: np.ndarray, axis: int, close: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and cells with their mirror images, one node where both lie on the plane."""
    own = np.abs(nodes[:, axis]) > close
    number = np.arange(len(nodes))
    number[own] = len(nodes) + np.arange(own.sum())
    image = nodes[own].copy()
    image[:, axis] *= -1
    return np.vstack([nodes, image]), np.vstack([cells, number[cells][:, [1, 0, 2, 3]]])
