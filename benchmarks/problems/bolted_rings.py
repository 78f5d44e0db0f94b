"""Two rings held together by eight bolts, all of it bonded, with plane sections across the shanks that the mesh knows of."""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path
from typing import Any

import gmsh

from benchmarks.kit.meshes import session
from benchmarks.problems.cases import STEEL

BOLTS, FORCE = 8, 8000.0
_BORE, _OUTSIDE, _THICKNESS, _CIRCLE = 25.0, 50.0, 12.0, 38.0
_SHANK, _HOLE, _HEAD, _HEAD_HEIGHT = 4.0, 5.0, 7.5, 5.0
# Tightened in two rounds, by forces that differ, then pulled at the upper ring.
HISTORIES = {"first": [1, 1, 1], "second": [0, 1, 1], "pull": [0, 0, 1]}


def bolted_rings(folder: Path, h: float = 6.0) -> dict[str, Any]:
    """Mesh the rings and return their problem; the folder takes rings.msh."""
    path = folder / "rings.msh"
    with session():
        _mesh(h)
        gmsh.write(str(path))
    return {
        "name": "bolted-rings", "mesh": {"file": str(path)}, "subdomains": "groups", "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": -_THICKNESS}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": _THICKNESS}, "traction": [2, 0, 12], "history": "pull"}],
        "histories": HISTORIES,
        "bolts": [{"on": f"bolt_{k}", "cut": {"plane": "z", "at": 0}, "force": force(k), "history": "first" if k % 2 else "second"}
                  for k in range(1, BOLTS + 1)],
        "interfaces": [{"law": "perfect"}],
    }


def force(bolt: int) -> float:
    """Of a bolt, counted from 1."""
    return FORCE + 50.0 * bolt


def pulls() -> list[list[float | None]]:
    """Per bolt, per load step, its force; None where it keeps its length."""
    return [[force(k), None, None] if k % 2 else [None, force(k), None] for k in range(1, BOLTS + 1)]


def _mesh(h: float) -> None:
    occ = gmsh.model.occ
    places = [(_CIRCLE * cos(2 * pi * k / BOLTS), _CIRCLE * sin(2 * pi * k / BOLTS)) for k in range(BOLTS)]
    holes = [(3, occ.addCylinder(x, y, -_THICKNESS, 0, 0, 2 * _THICKNESS, _HOLE)) for x, y in places]
    bore = (3, occ.addCylinder(0, 0, -_THICKNESS, 0, 0, 2 * _THICKNESS, _BORE))
    rings = [(3, occ.addCylinder(0, 0, z, 0, 0, _THICKNESS, _OUTSIDE)) for z in (-_THICKNESS, 0)]
    rings = [occ.cut([ring], [bore, *holes], removeTool=False)[0][0] for ring in rings]
    occ.remove([bore, *holes], recursive=True)
    solids, owner = list(rings), ["lower", "upper"]
    for k, (x, y) in enumerate(places, 1):
        for z, length in ((-_THICKNESS, _THICKNESS), (0, _THICKNESS)):  # either half of the shank, and what it ends in
            shank = (3, occ.addCylinder(x, y, z, 0, 0, length, _SHANK))
            head = (3, occ.addCylinder(x, y, -_THICKNESS - _HEAD_HEIGHT if z < 0 else _THICKNESS, 0, 0, _HEAD_HEIGHT, _HEAD))
            solids.append(occ.fuse([shank], [head])[0][0])
            owner.append(f"bolt_{k}")
    pieces = occ.fragment(solids, [])[1]
    occ.synchronize()
    for name in dict.fromkeys(owner):
        tags = [tag for own, found in zip(owner, pieces) if own == name for _, tag in found]
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 8)
    gmsh.model.mesh.generate(3)
