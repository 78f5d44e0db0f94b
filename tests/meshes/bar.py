"""Makes bar_1.msh … bar_4.msh: a bent bar that gmsh has cut in four partitions, a file for each; and bar.msh, all in one, in bytes."""

import sys
from pathlib import Path

import gmsh

FOLDER = Path(__file__).parent


def bar(folder: Path = FOLDER, partitions: int = 4, size: float = 0.55, one: bool = False) -> None:
    """Writes the files into a folder; gmsh has been initialised.

    one : all in one file, in bytes
    """
    gmsh.clear()
    occ = gmsh.model.occ
    occ.fuse([(3, occ.addBox(0, 0, 0, 4, 1, 1))], [(3, occ.addBox(3, 0, 0, 1, 1, 2.5))])
    occ.synchronize()
    for name, low in (("wall", 0), ("end", 4)):
        sides = gmsh.model.getEntitiesInBoundingBox(low - 0.01, -0.01, -0.01, low + 0.01, 1.01, 2.51, 2)
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in sides], name=name)
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="bar")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.partition(partitions)
    gmsh.option.setNumber("Mesh.Binary", one)
    gmsh.option.setNumber("Mesh.PartitionSplitMeshFiles", not one)
    gmsh.write(str(folder / "bar.msh"))


if __name__ == "__main__":
    gmsh.initialize(sys.argv)
    gmsh.option.setNumber("General.Terminal", 0)
    bar()
    gmsh.finalize()
