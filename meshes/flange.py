"""Makes flange.msh: two flanges, the upper one with a neck, and eight bolts whose heads stand on it.

    python meshes/flange.py

The shanks have room in their holes; they end where the lower flange ends, in surfaces bolt_1_end … bolt_8_end.
"""

from math import cos, pi, sin

import gmsh
from bodies import made, named

BORE, OUTSIDE, THICKNESS = 25.0, 50.0, 12.0  # of either flange: radii, height
NECK, NECK_HEIGHT = 32.0, 25.0  # outer radius
BOLTS, CIRCLE = 8, 40.5  # number, radius of the circle they stand on
SHANK, HOLE, HEAD, HEAD_HEIGHT = 4.0, 5.0, 8.0, 6.0
H, FINE = 9.0, 4.5  # element size, and at the bolts


def main() -> None:
    gmsh.initialize(["-v", "2"])
    occ = gmsh.model.occ
    places = [(CIRCLE * cos(2 * pi * i / BOLTS), CIRCLE * sin(2 * pi * i / BOLTS)) for i in range(BOLTS)]
    holes = [(3, occ.addCylinder(x, y, -THICKNESS, 0, 0, 2 * THICKNESS, HOLE)) for x, y in places]
    bore = (3, occ.addCylinder(0, 0, -THICKNESS, 0, 0, 2 * THICKNESS + NECK_HEIGHT, BORE))
    lower = (3, occ.addCylinder(0, 0, -THICKNESS, 0, 0, THICKNESS, OUTSIDE))
    upper = (3, occ.addCylinder(0, 0, 0, 0, 0, THICKNESS, OUTSIDE))
    neck = (3, occ.addCylinder(0, 0, THICKNESS, 0, 0, NECK_HEIGHT, NECK))
    upper, = occ.fuse([upper], [neck])[0]
    bodies = {}
    for name, body in (("lower", lower), ("upper", upper)):
        bodies[name], = occ.cut([body], [bore, *holes], removeTool=False)[0]
    occ.remove([bore, *holes], recursive=True)
    for i, (x, y) in enumerate(places, 1):
        shank = (3, occ.addCylinder(x, y, -THICKNESS, 0, 0, 2 * THICKNESS, SHANK))
        head = (3, occ.addCylinder(x, y, THICKNESS, 0, 0, HEAD_HEIGHT, HEAD))
        bodies[f"bolt_{i}"], = occ.fuse([shank], [head])[0]
    named(bodies)
    for i, (x, y) in enumerate(places, 1):
        ends = gmsh.model.getEntitiesInBoundingBox(x - HOLE, y - HOLE, -THICKNESS - 0.1, x + HOLE, y + HOLE, 0.1 - THICKNESS, 2)
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in ends], name=f"bolt_{i}_end")
    foot = [tag for _, tag in gmsh.model.getEntities(2)
            if abs(occ.getCenterOfMass(2, tag)[2] + THICKNESS) < 1e-6 and occ.getMass(2, tag) > 10 * pi * SHANK**2]
    gmsh.model.addPhysicalGroup(2, foot, name="foot")
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), H)
    for x, y in places:
        r = HEAD + 0.5
        gmsh.model.mesh.setSize(gmsh.model.getEntitiesInBoundingBox(x - r, y - r, -50, x + r, y + r, 50, 0), FINE)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 8)
    made(__file__)


if __name__ == "__main__":
    main()
