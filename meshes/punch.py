"""Makes punch.msh: a round punch standing on a block, two volumes that share the punch's face.

    python meshes/punch.py
"""

import gmsh
from bodies import made

BLOCK, RADIUS, HEIGHT = (3.0, 2.0, 1.0), 0.5, 0.7
FINE, COARSE = 0.12, 0.3  # element size at the face and away from it


def main() -> None:
    gmsh.initialize(["-v", "2"])
    occ = gmsh.model.occ
    block = occ.addBox(-BLOCK[0] / 2, -BLOCK[1] / 2, -BLOCK[2], *BLOCK)
    punch = occ.addCylinder(0, 0, 0, 0, 0, HEIGHT, RADIUS)
    occ.fragment([(3, block)], [(3, punch)])
    occ.synchronize()
    for _, volume in gmsh.model.getEntities(3):
        above = occ.getCenterOfMass(3, volume)[2] > 0
        gmsh.model.addPhysicalGroup(3, [volume], name="punch" if above else "block")
    for name, height in (("foot", -BLOCK[2]), ("head", HEIGHT)):
        faces = [f for _, f in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, f)[2] - height) < 1e-6]
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    ring = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(ring, "F", f"{FINE} + 0.25*max(sqrt(x*x + y*y + z*z) - {RADIUS}, 0)")
    size = gmsh.model.mesh.field.add("Min")
    coarse = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(coarse, "F", str(COARSE))
    gmsh.model.mesh.field.setNumbers(size, "FieldsList", [ring, coarse])
    gmsh.model.mesh.field.setAsBackgroundMesh(size)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    made(__file__)


if __name__ == "__main__":
    main()
