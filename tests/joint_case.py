"""A bolted lap joint as CAD files: two plates with clearance holes, two bolts with their nuts; solids without names."""

from pathlib import Path

import gmsh

from orchestrator.scene.mesh.gmsh_session import session

BOLTS = ((55.0, 0.0), (85.0, 0.0))


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
