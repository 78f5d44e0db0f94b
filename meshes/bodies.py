"""What the scripts of this folder share that have gmsh make a mesh of bodies."""

from pathlib import Path

import gmsh


def named(bodies: dict[str, tuple[int, int]]) -> None:
    """Have bodies share the faces on which they touch; each becomes a physical volume of its name."""
    occ = gmsh.model.occ
    _, pieces = occ.fragment(list(bodies.values()), [])
    occ.synchronize()
    for name, own in zip(bodies, pieces):
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in own], name=name)


def made(script: str) -> None:
    """Mesh what there is, write it beside the script under the script's name, and end gmsh."""
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(str(Path(script).with_suffix(".msh")))
    gmsh.finalize()
