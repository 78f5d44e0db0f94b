"""An L-shaped bracket with a hole, meshed with irregular tets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh

from benchmarks.kit.meshes import session
from benchmarks.problems.cases import STEEL

_LENGTH, _WIDTH, _THICKNESS, _RADIUS = 100.0, 40.0, 40.0, 10.0


def bracket(folder: Path, parts: int = 64, h: float = 3.2) -> dict[str, Any]:
    """Mesh the bracket and return its problem: clamped at the foot, pulled and bent at the arm's end.

    Parameters
    ----------
    folder : takes bracket.msh
    parts : number of METIS parts
    h : element size; half of it around the hole
    """
    path = folder / "bracket.msh"
    with session():
        _mesh(h)
        gmsh.write(str(path))
    return {
        "name": f"bracket-{parts}", "mesh": {"file": str(path)}, "subdomains": {"metis": parts}, "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": _LENGTH}, "traction": [5, 0, -2]}],
    }


def _mesh(h: float) -> None:
    occ = gmsh.model.occ
    post = occ.addBox(0, 0, 0, _THICKNESS, _WIDTH, _LENGTH)
    arm = occ.addBox(0, 0, _LENGTH - _THICKNESS, _LENGTH, _WIDTH, _THICKNESS)
    hole = occ.addCylinder(0.7 * _LENGTH, 0, _LENGTH - _THICKNESS / 2, 0, _WIDTH, 0, _RADIUS)
    body, _ = occ.fuse([(3, post)], [(3, arm)])
    body, _ = occ.cut(body, [(3, hole)])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in body], name="bracket")
    x, z, r = 0.7 * _LENGTH, _LENGTH - _THICKNESS / 2, 1.5 * _RADIUS
    around = [e for e in gmsh.model.getEntitiesInBoundingBox(x - r, -1, z - r, x + r, _WIDTH + 1, z + r, 0)]
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), h)
    gmsh.model.mesh.setSize(around, h / 2)
    gmsh.model.mesh.generate(3)
