"""Makes tube.msh: a quarter of a tube in the bore of a square frame.

    python meshes/tube.py
"""

from math import pi

import gmsh
from bodies import made, named

INSIDE, BORE, HALF, THICK = 8.0, 10.0, 20.0, 4.0  # radii; half the frame's side; length along the tube
H, FINE = 4.0, 1.3  # element size, and at the tube


def main() -> None:
    gmsh.initialize(["-v", "2"])
    occ = gmsh.model.occ

    def quarter(radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(0, 0, 0, 0, 0, THICK, radius, angle=pi / 2)

    tube, = occ.cut([quarter(BORE)], [quarter(INSIDE)])[0]
    frame, = occ.cut([(3, occ.addBox(0, 0, 0, HALF, HALF, THICK))], [quarter(BORE)])[0]
    named({"tube": tube, "frame": frame})
    inner = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getType(2, tag) == "Cylinder"
             and max(gmsh.model.getBoundingBox(2, tag)[3:5]) < (INSIDE + BORE) / 2]
    gmsh.model.addPhysicalGroup(2, inner, name="inside")
    reach = BORE + 0.1
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), H)
    gmsh.model.mesh.setSize(gmsh.model.getEntitiesInBoundingBox(-1, -1, -1, reach, reach, THICK + 1, 0), FINE)
    made(__file__)


if __name__ == "__main__":
    main()
