"""A punch on a block, meshed together with irregular tets, of one matter or of two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh

from benchmarks.kit.meshes import session

_BLOCK, _PUNCH = 10.0, 6.0  # edges
# pressed, pushed aside, further and across, back, to the other side
_PATH = [[0, 0, -0.01], [0.005, 0, -0.01], [0.01, 0.005, -0.01], [0, 0, -0.01], [-0.01, 0, -0.01]]


def punch(folder: Path, block: float, punch: float, h: float = 1.2, friction: float = 0.2) -> dict[str, Any]:
    """Mesh punch and block, and return their problem: the punch pressed and sheared both ways.

    Parameters
    ----------
    folder : takes punch.msh, if it is not there
    block, punch : Young's moduli
    h : element size
    """
    path = folder / "punch.msh"
    if not path.is_file():
        with session():
            _mesh(h)
            gmsh.write(str(path))
    return {
        "name": f"punch-{block:g}-{punch:g}", "mesh": {"file": str(path)}, "subdomains": "groups",
        "materials": [{"young": block, "poisson": 0.3}, {"young": punch, "poisson": 0.3, "on": "punch"}],
        "boundary": [{"on": {"plane": "z", "at": -_BLOCK}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": _PUNCH}, "displacement": _PATH}],
        "interfaces": [{"law": "contact", "friction": friction}],
    }


def _mesh(h: float) -> None:
    occ = gmsh.model.occ
    block = occ.addBox(-_BLOCK / 2, -_BLOCK / 2, -_BLOCK, _BLOCK, _BLOCK, _BLOCK)
    upon = occ.addBox(-_PUNCH / 2, -_PUNCH / 2, 0, _PUNCH, _PUNCH, _PUNCH)
    occ.fragment([(3, block)], [(3, upon)])
    occ.synchronize()
    for _, volume in gmsh.model.getEntities(3):
        above = occ.getCenterOfMass(3, volume)[2] > 0
        gmsh.model.addPhysicalGroup(3, [volume], name="punch" if above else "block")
    gmsh.option.setNumber("Mesh.MeshSizeMin", h)
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    gmsh.model.mesh.generate(3)
