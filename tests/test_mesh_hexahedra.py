"""Mesh files with hexahedra, prisms and pyramids, split into tets; VTK's files with names; gmsh's groups that hold some or share."""

import gmsh
import meshio
import numpy as np
import pytest
from pyvista import ImageData, MultiBlock, UnstructuredGrid
from quick import late

from orchestrator.errors import InputError
from orchestrator.results.fields.files import write_vtu
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.mesh.readers import vtk
from orchestrator.scene.mesh.readers.child import by_vtk
from orchestrator.scene.mesh.faces import edge_patches
from orchestrator.scene.mesh.readers.read import read
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.gmsh_session import session
from orchestrator.scene.mesh.mesh import checked


def name(*groups):
    gmsh.model.removePhysicalGroups()
    for dimension, number, tags, word in groups:
        gmsh.model.addPhysicalGroup(dimension, tags, number, word)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Two boxes one behind the other, as gmsh writes them: hex and hex20 of hexahedra, wedge of prisms, tets with groups of all kinds."""
    folder = tmp_path_factory.mktemp("saved")
    with session():
        def model(recombine):
            gmsh.model.add(f"m{recombine}")
            side = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
            first = gmsh.model.occ.extrude([(2, side)], 0, 0, 1, [2], recombine=True)
            gmsh.model.occ.extrude([first[0]], 0, 0, 1, [2], recombine=True)
            gmsh.model.occ.synchronize()
            name((3, 1, [1], "left"), (3, 2, [2], "right"), (2, 3, [side], "clamp"), (2, 4, [first[2][1]], "flank"))
            if recombine:
                for _, curve in gmsh.model.getBoundary([(2, side)], oriented=False):
                    gmsh.model.mesh.setTransfiniteCurve(curve, 3)
                gmsh.model.mesh.setTransfiniteSurface(side)
                gmsh.model.mesh.setRecombine(2, side)
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
            gmsh.model.mesh.generate(3)

        model(True)
        for ending in ("msh", "unv", "inp", "med", "vtk", "bdf"):
            gmsh.write(str(folder / f"hex.{ending}"))
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        gmsh.model.mesh.setOrder(2)
        for ending in ("msh", "inp", "unv", "med"):
            gmsh.write(str(folder / f"hex20.{ending}"))
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        model(False)
        for ending in ("msh", "med", "inp"):
            gmsh.write(str(folder / f"wedge.{ending}"))

        gmsh.model.add("tets")
        boxes = [gmsh.model.occ.addBox(x, 0, 0, 1, 1, 1) for x in (0, 1)]
        gmsh.model.occ.fragment([(3, boxes[0])], [(3, boxes[1])])
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        clamp = (2, 3, [t for _, t in gmsh.model.getEntitiesInBoundingBox(-.01, -.01, -.01, .01, 1.01, 1.01, 2)], "clamp")
        for version in (2.2, 4.1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            name((3, 1, [1], "left"), clamp)
            gmsh.write(str(folder / f"some{version}.msh"))
            gmsh.option.setNumber("Mesh.SaveAll", 1)
            gmsh.write(str(folder / f"every{version}.msh"))
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            name((3, 1, [1], "left"), (3, 2, [2], "right"), (3, 4, [1, 2], "all"), clamp, (*clamp[:1], 5, clamp[2], "also"))
            gmsh.write(str(folder / f"twice{version}.msh"))
        gmsh.write(str(folder / "twice.med"))
        gmsh.option.setNumber("Mesh.Binary", 1)
        name((3, 1, [1], "left"), clamp)
        gmsh.write(str(folder / "some.msh"))
        gmsh.model.removePhysicalName("all")  # gmsh keeps names without groups
        name((3, 1, [1], "left"), (3, 2, [2], "right"), clamp)
        gmsh.write(str(folder / "named.msh"))
    return folder


def area(mesh, surface):
    return np.linalg.norm(area_vectors(mesh.nodes, mesh.surfaces[surface]), axis=1).sum()


def check(mesh):
    """A conforming mesh of two unit boxes: one skin of the area of both together, named faces on it."""
    mesh, faces = checked(mesh)
    assert np.allclose(np.bincount(mesh.volume, tet_volumes(mesh.nodes, mesh.cells)), 1)
    skin = faces.triangles[faces.outer]
    assert np.isclose(np.linalg.norm(area_vectors(mesh.nodes, skin), axis=1).sum(), 10) and edge_patches(skin)[0] == 1
    for triangles in mesh.surfaces.values():
        assert (faces.find(triangles) >= 0).all()
    return mesh


@pytest.mark.parametrize("file", [
    "hex.msh", late("hex.unv"), "hex.inp", "hex.med", "hex.vtk", "hex.bdf", "hex20.msh", late("hex20.inp"), late("hex20.unv"), late("hex20.med"),
    "wedge.msh", late("wedge.med"), late("wedge.inp")])
def test_hexahedra_and_prisms_are_split_conformingly(saved, file):
    mesh = check(read(saved / file))
    named = not file.endswith(("vtk", "bdf"))
    assert mesh.volumes == (["left", "right"] if named else ["volume_1", "volume_2"])
    if named:
        assert np.isclose(area(mesh, "clamp"), 1) and np.isclose(area(mesh, "flank"), 1)
    words = "prisms are split" if file.startswith("wedge") else "16 hexahedra are split into 96 tetrahedra"
    assert words in mesh.remarks[-1] and any("by their corners" in r for r in mesh.remarks) == file.startswith("hex20")
    assert "bend" not in " ".join(r for r in mesh.remarks if "by their corners" not in r and "split" not in r)


def grid():
    """2 × 2 × 2 hexahedra and one pyramid on each of the upper four, moved a little so that no two are alike."""
    x = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    at = lambda i, j, k: (i * 3 + j) * 3 + k  # noqa: E731
    cube = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    hexes = np.array([[at(i + a, j + b, k + c) for a, b, c in cube] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    tops = hexes[1::2, 4:]
    peaks = x[tops].mean(axis=1) + [0, 0, 1]
    return np.vstack([x, peaks]), hexes, np.column_stack([tops, len(x) + np.arange(4)])


@pytest.mark.long
def test_the_split_does_not_depend_on_numbers_or_on_where_a_cell_begins(tmp_path):
    points, hexes, pyramids = grid()
    random = np.random.default_rng(3)
    points = points + random.uniform(-.05, .05, points.shape) * (points[:, 2:] < 2)  # quads between pyramids and hexahedra stay flat
    made = []
    for turn in (False, True):
        new = random.permutation(len(points)) if turn else np.arange(len(points))
        own = hexes[:, [1, 2, 3, 0, 5, 6, 7, 4]] if turn else hexes
        moved = np.empty_like(points)
        moved[new] = points
        meshio.Mesh(moved, [("hexahedron", new[own]), ("pyramid", new[pyramids])]).write(tmp_path / f"{turn}.vtu")
        mesh, faces = checked(read(tmp_path / f"{turn}.vtu"))
        made.append({tuple(sorted(map(tuple, mesh.nodes[cell]))) for cell in mesh.cells})
        assert len(mesh.cells) == 8 * 6 + 4 * 2 and mesh.remarks[0].startswith("8 hexahedra and 4 pyramids are split into 56 tetrahedra")
        assert edge_patches(faces.triangles[faces.outer])[0] == 1
    assert made[0] == made[1]


@pytest.mark.long
def test_what_cannot_be_split_is_told_by_its_place(tmp_path):
    points, hexes, _ = grid()
    bent = points.copy()
    bent[hexes[0, 0]] = [1.2, 1.2, 1.2]  # through the opposite corner
    meshio.Mesh(bent, [("hexahedron", hexes)]).write(tmp_path / "bent.vtu")
    with pytest.raises(InputError, match=r"1 of 8 hexahedra are too distorted .* around \(0\.65, 0\.65, 0\.65\)"):
        read(tmp_path / "bent.vtu")
    # Tets upon the upper quad of the last hexahedron, cut along one diagonal, then the other.
    a, b, c, d = hexes[-1, 4:]
    peak = len(points) - 1
    for tets, good in (([[a, b, c, peak], [a, c, d, peak]], True), ([[a, b, d, peak], [b, c, d, peak]], False)):
        meshio.Mesh(points, [("hexahedron", hexes), ("tetra", np.array(tets))]).write(tmp_path / "mixed.vtu")
        if good:
            assert len(checked(read(tmp_path / "mixed.vtu"))[0].cells) == 50
        else:
            with pytest.raises(InputError, match=r"1 quads .* other diagonal; the first is around \(1\.5, 1\.5, 2\)"):
                read(tmp_path / "mixed.vtu")


BRICK = """*NODE
1, 0,0,0\n2, 1,0,0\n3, 1,1,0\n4, 0,1,0\n5, 0,0,2\n6, 1,0,2\n7, 1,1,2\n8, 0,1,2\n9, 2,0,0\n10, 2,0,2
*ELEMENT, TYPE=C3D8R, ELSET=Brick
1, 1,2,3,4,5,6,7,8
*ELEMENT, TYPE=C3D6, ELSET=Edge
2, 2,9,3,6,10,7
*NSET, NSET=held
1,4,5,8
*SURFACE, NAME=s, TYPE=ELEMENT
Brick, S5
Edge, S3
Edge, S2
"""


def test_surfaces_and_node_sets_of_a_deck_of_bricks(tmp_path):
    (tmp_path / "a.inp").write_text(BRICK)
    mesh, faces = checked(read(tmp_path / "a.inp"))
    assert mesh.volumes == ["Brick", "Edge"] and len(mesh.cells) == 9 and np.isclose(area(mesh, "held"), 2)
    assert (faces.find(np.vstack(list(mesh.surfaces.values()))) >= 0).all() and len(mesh.surfaces["s"]) == 5
    assert np.isclose(area(mesh, "s"), 2 + 2 + .5)  # y = 1; y = 0; the prism's top
    (tmp_path / "a.inp").write_text(BRICK.replace("Edge, S2", "Edge, S6"))
    with pytest.raises(InputError, match=r"a\.inp:21: a face S6 of an element that has fewer"):
        read(tmp_path / "a.inp")


def test_elements_in_no_group(saved):
    mesh = check(read(saved / "every4.1.msh"))
    assert mesh.volumes == ["left", "volume_0"] and np.isclose(area(mesh, "clamp"), 1)
    mesh = check(read(saved / "every2.2.msh"))  # where gmsh writes the names and no groups
    assert mesh.volumes == ["volume_1", "volume_2"] and "'left'" in mesh.remarks[0] and "no elements" in mesh.remarks[0]


def test_volumes_that_gmsh_did_not_save_are_told(saved):
    for file in ("some4.1.msh", "some.msh"):
        mesh = read(saved / file)
        assert mesh.volumes == ["left"] and any("1 of the 2 volumes of gmsh's model have no elements" in r for r in mesh.remarks)
    assert read(saved / "some2.2.msh").volumes == ["left"]  # it does not say what there was
    assert not read(saved / "named.msh").remarks


@pytest.mark.parametrize("file", ["twice2.2.msh", "twice4.1.msh", "twice.med"])
def test_elements_in_two_groups(saved, file):
    mesh = check(read(saved / file))
    assert mesh.volumes == ["left", "right"] and np.isclose(area(mesh, "clamp"), 1) and np.isclose(area(mesh, "also"), 1)
    (remark,) = mesh.remarks
    assert "of 'all' 0 of" in remark and "in 'left', 'right'" in remark


def test_names_in_files_of_vtk(saved, tmp_path, monkeypatch):
    raw = meshio.read(saved / "named.msh")
    raw.write(tmp_path / "meshio.vtu")
    raw.write(tmp_path / "meshio.vtk")
    for file in ("meshio.vtu", "meshio.vtk"):
        mesh = check(read(tmp_path / file))
        assert mesh.volumes == ["left", "right"] and np.isclose(area(mesh, "clamp"), 1), file
    # the others without a process of their own, as what it gives away is the same
    monkeypatch.setattr(vtk, "apart", lambda room, source, target, folder: by_vtk(str(source), str(target)) or "")
    tets = np.vstack([b.data for b in raw.cells if b.type == "tetra"])
    right = (raw.points[tets].mean(axis=1)[:, 0] > 1).astype(int)
    words = np.array(["left", "right"])

    def of(fields=(), **arrays):
        made = UnstructuredGrid(np.column_stack([np.full(len(tets), 4), tets]), np.full(len(tets), 10), raw.points)
        for key, values in arrays.items():
            made.cell_data[key] = values
        for key, values in fields:
            made.field_data[key] = values
        return made

    numbered = ["volume_0", "volume_1"]
    for made, expected in (
            (of(PhysicalName=words[right]), ["left", "right"]), (of(any=words[right]), ["left", "right"]),
            (of(volume=right, stress=right + .5), numbered), (of(Material_Id=right.astype(float)), numbered),
            (of(subdomain=right), numbered),
            (of([("names", words)], volume=right), ["left", "right"]), (of([("part", words)], part=right + 1), ["left", "right"]),
            (of([("names", np.array([*words, "third"]))], volume=right + 1), ["volume_1", "volume_2"]),  # from 0 or 1? nobody knows
            (of([("bolt", [1, 3]), ("nut", [2, 3])], **{"gmsh:physical": right + 1}), ["bolt", "nut"]), (of(other=right), ["volume_1"])):
        for file in ("a.vtu", "a.vtk"):
            made.save(tmp_path / file)
            mesh = read(tmp_path / file)
            assert sorted(mesh.volumes) == expected, (made.array_names, file)
            if len(expected) == 2:
                first = mesh.nodes[mesh.cells[mesh.volume == mesh.volumes.index(expected[0])]]
                assert (first[..., 0] <= 1 + 1e-12).all()
    write_vtu(ResultsFolder(tmp_path), "own.vtu", raw.points, tets, {"displacement": raw.points},
              {"subdomain": right.astype(np.int32), "von_mises": np.ones(len(tets))})
    assert read(tmp_path / "own.vtu").volumes == numbered
    of(one=words[right], two=words[right]).save(tmp_path / "a.vtu")
    with pytest.raises(InputError, match="'one', 'two'"):
        read(tmp_path / "a.vtu")
    MultiBlock({"left": of()}).save(tmp_path / "a.vtm")
    with pytest.raises(InputError, match="a collection of grids"):
        read(tmp_path / "a.vtm")
    ImageData(dimensions=(3, 2, 2)).cast_to_unstructured_grid().save(tmp_path / "voxels.vtu")
    assert np.isclose(tet_volumes(*(lambda m: (m.nodes, m.cells))(read(tmp_path / "voxels.vtu"))).sum(), 2)
