"""Relations that change what should not matter at all: loads that add up to nothing, a rest before, and what meshes are read from."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from benchmarks.metamorphic.tools import tools
from benchmarks.metamorphic.variant import Variant
from orchestrator import build_scene, config_from
from orchestrator.scene.mesh.faces import faces_of

CANCELLED = {"traction": 3, "pressure": 0, "body_force": 3, "temperature": 0}  # components of what is added and taken off again


def cancelled(data: dict, rng: np.random.Generator) -> Variant | None:
    """Beside it loads that add up to nothing, with histories of their own."""
    made = copy.deepcopy(data)
    kind = str(rng.choice(list(CANCELLED)))
    if kind == "temperature" and not all("expansion" in m for m in data["materials"]):
        return None
    strength = 50.0 if kind == "temperature" else 200.0
    value = rng.uniform(-1, 1, 3) * strength if CANCELLED[kind] else rng.uniform(-1, 1) * strength
    part = data["parts"][int(rng.integers(len(data["parts"])))]
    if kind in ("traction", "pressure") and "box" not in part["mesh"]:  # its faces have other names
        return None
    part = part["name"]
    entries, place = ("boundary", f"{part}/{rng.choice(['xmin', 'ymax', 'zmax'])}") if kind in ("traction", "pressure") else ("loads", part)
    count = len(made[entries]) if entries in made else 0
    for sign in (1.0, -1.0):
        made.setdefault(entries, []).append({"on": place, kind: (sign * value).tolist() if CANCELLED[kind] else float(sign * value)})
    return Variant(made, order=list(range(count if entries == "boundary" else len(data["boundary"]))))


def after_rest(data: dict, rng: np.random.Generator) -> Variant | None:
    """A load step ahead in which nothing acts: all else comes as it came. What is pressed by its shape alone is not left out."""
    laws = data.get("interfaces", [])
    if any(e["law"] == "contact" and (e.get("gap", "geometry" if e["between"] == "auto" else 0.0) == "geometry" or e.get("gap", 0.0) < 0)
           for e in laws) or "bolts" in data or any(e.get("pairing") for e in laws) or any("force" in t for t in tools(data)):
        return None
    made = copy.deepcopy(data)
    timed = "histories" in data and any("history" in e for e in [*data["boundary"], *data.get("loads", []), *laws, *tools(data)])
    factors = data["histories"]["h"] if timed else [1.0]
    made["histories"] = {"h": [0.0, *factors], "all": [0.0, *[1.0] * len(factors)]}
    for entry in [e for e in made["boundary"] if not {"symmetry", "foundation"} & set(e)] + made.get("loads", []) + [
            e for e in made.get("interfaces", []) if "jump" in e] + tools(made):
        entry.setdefault("history", "all")
    return Variant(made, sums=np.eye(len(factors), len(factors) + 1, k=1))


def read_from_files(data: dict, rng: np.random.Generator) -> Variant | None:
    """Every part's mesh from a file, its nodes and tets in another order, its faces named there."""
    if data["subdomains"] not in ("groups", {"groups": True}) or not all("box" in part["mesh"] for part in data["parts"]):
        return None  # METIS and cuts go by the order of the tets
    files: dict[str, str] = {}
    parts = []
    for number, part in enumerate(data["parts"]):
        made = {**data, "parts": [{k: v for k, v in part.items() if k in ("name", "mesh")}], "interfaces": [], "loads": [], "histories": {},
                "boundary": [{"on": f"{part['name']}/zmin", "displacement": [0, 0, 0]}], "bolts": [], "blackbox": {"code": "in-process"},
                "materials": [{"young": 1.0, "poisson": 0.3}], "output": {}}
        files[f"{number}.msh"] = _msh(build_scene(config_from(made)).mesh, part["mesh"]["box"]["size"], rng)
        parts.append({**part, "mesh": {"file": f"{number}.msh"}})
    return Variant({**data, "parts": parts, "files": files}, shuffled=True)


def _msh(mesh: Any, size: list[float], rng: np.random.Generator) -> str:
    """gmsh's file of a box, shuffled; the first corner of every tet stays one of its corners, whichever."""
    order = rng.permutation(len(mesh.nodes))
    new = np.argsort(order)
    even = np.array([[0, 1, 2, 3], [1, 2, 0, 3], [2, 0, 1, 3], [3, 2, 1, 0], [1, 3, 2, 0], [0, 2, 3, 1]])
    cells = new[mesh.cells[rng.permutation(len(mesh.cells)), :4]]
    cells = np.take_along_axis(cells, even[rng.integers(len(even), size=len(cells))], axis=1)
    faces, names, rows = faces_of(mesh.cells[:, :4], len(mesh.nodes)), ["volume"], []
    for axis, letter in enumerate("xyz"):
        for end in (0, 1):
            there = (np.abs(mesh.nodes[faces.triangles][:, :, axis] - end * size[axis]) < 1e-9 * max(size)).all(axis=1) & (faces.neighbour < 0)
            names.append(letter + ("max" if end else "min"))
            rows += [f"2 2 {len(names)} {len(names)} {' '.join(str(1 + n) for n in new[t])}" for t in faces.triangles[there]]
    rows += [f"4 2 1 1 {' '.join(str(1 + n) for n in t)}" for t in cells]
    groups = [f'{3 if name == "volume" else 2} {k} "{name}"' for k, name in enumerate(names, 1)]
    nodes = [f"{k} {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(mesh.nodes[order].tolist(), 1)]
    return "\n".join(["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(groups)), *groups, "$EndPhysicalNames",
                      "$Nodes", str(len(nodes)), *nodes, "$EndNodes", "$Elements", str(len(rows)),
                      *(f"{k} {row}" for k, row in enumerate(rows, 1)), "$EndElements", ""])
