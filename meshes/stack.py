"""Makes stack.msh: a shaft on a base, and five rings around it, one upon the other.

    python meshes/stack.py
"""

import gmsh
from bodies import made, named

SHAFT, BASE, BASE_HEIGHT = 10.0, 24.0, 8.0  # radii, height
RINGS, OUTSIDE, HEIGHT, END = 5, 20.0, 9.0, 4.0  # number, radius and height of the rings; what the shaft has above them
H, FINE = 5.0, 3.0  # element size, and at the shaft


def main() -> None:
    gmsh.initialize(["-v", "2"])
    occ = gmsh.model.occ
    top = BASE_HEIGHT + RINGS * HEIGHT
    shaft = (3, occ.addCylinder(0, 0, BASE_HEIGHT, 0, 0, RINGS * HEIGHT + END, SHAFT))
    bodies = {"base": (3, occ.addCylinder(0, 0, 0, 0, 0, BASE_HEIGHT, BASE)), "shaft": shaft}
    for i in range(1, RINGS + 1):
        ring = (3, occ.addCylinder(0, 0, BASE_HEIGHT + (i - 1) * HEIGHT, 0, 0, HEIGHT, OUTSIDE))
        bodies[f"ring_{i}"], = occ.cut([ring], [shaft], removeTool=False)[0]
    named(bodies)
    around = gmsh.model.getEntitiesInBoundingBox(*[-SHAFT - 0.1] * 2, -1, *[SHAFT + 0.1] * 2, top + END + 1, 0)
    upper = [tag for _, tag in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, tag)[2] - top) < 1e-6]
    gmsh.model.addPhysicalGroup(2, upper, name="top")
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), H)
    gmsh.model.mesh.setSize(around, FINE)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 20)
    made(__file__)


if __name__ == "__main__":
    main()
