"""A bolted lap joint as CAD files: two plates with clearance holes, two bolts with their nuts; solids without names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gmsh

from orchestrator.scene.mesh.gmsh_session import session

BOLTS = ((55.0, 0.0), (85.0, 0.0))
PRETENSION, FRICTION, PULL = 25e3, 0.2, 12e3


def lap_joint(folder: Path, shift: float = 0.0) -> list[Path]:
    """Writes plates.step and bolts.step.

    shift : of the bolts in their holes along x
    """
    occ = gmsh.model.occ

    def plate(x, z):
        holes = [(3, occ.addCylinder(u, v, z, 0, 0, 8, 5.5)) for u, v in BOLTS]
        occ.cut([(3, occ.addBox(x, -20, z, 100, 40, 8))], holes)

    with session():
        plate(0, 0), plate(40, 8)
        occ.synchronize()
        gmsh.write(str(folder / "plates.step"))
    with session():
        for x, y in BOLTS:
            occ.fuse([(3, occ.addCylinder(x + shift, y, -10, 0, 0, 26, 5))], [(3, occ.addCylinder(x + shift, y, 16, 0, 0, 6, 8))])
            occ.cut([(3, occ.addCylinder(x + shift, y, -8, 0, 0, 8, 8))], [(3, occ.addCylinder(x + shift, y, -8, 0, 0, 8, 5))])
        occ.synchronize()
        gmsh.write(str(folder / "bolts.step"))
    return [folder / "plates.step", folder / "bolts.step"]


def joint_scene(folder: Path, pull: Sequence[float], size: tuple[int, float, float] = (12, 5.9, 4.2)) -> dict[str, Any]:
    """The configuration as ``orchestrator init`` writes it and four lines are edited, of four-node tets.

    pull : factors of the pull, a load step each, after the one that tightens the bolts
    size : elements on a circle, and the largest of the plates and of the bolts
    """
    plates, bolts = lap_joint(folder)
    circle, *largest = size
    sizes = [{"curvature": circle, "min": 0.1 * most, "max": most} for most in largest]
    names = {"solid_1": "bolt_1", "solid_2": "nut_1", "solid_3": "bolt_2", "solid_4": "nut_2"}
    end = {"on": {"plane": "x", "at": 140}}
    return {
        "name": "lap_joint",
        "parts": [{"name": "plates", "mesh": {"step": str(plates), "h": sizes[0], "conforming": False,
                                              "rename": {"solid_1": "lower", "solid_2": "upper"}}},
                  {"name": "bolts", "mesh": {"step": str(bolts), "h": sizes[1], "conforming": False, "rename": names}}],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}, {**end, "displacement": [None, 0, 0]},
                     {**end, "resultant": {"force": [PULL, 0, 0]}, "history": "pull"}],
        "histories": {"tighten": [1.0] * (1 + len(pull)), "pull": [0.0, *pull]},
        "bolts": [{"on": f"bolts/bolt_{k}", "force": PRETENSION, "history": "tighten"} for k in (1, 2)],
        "interfaces": [{"between": "auto", "law": "contact", "friction": FRICTION, "within": 0.65},
                       *({"between": [f"bolts/bolt_{k}", f"bolts/nut_{k}"], "law": "perfect"} for k in (1, 2))],
        "blackbox": {"code": "freefem", "element": "P1"}, "method": {"tolerance": {"error": 1e-4}}, "output": {"figures": False}}
