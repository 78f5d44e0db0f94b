"""Mesh files of other programs: names, node sets, surfaces, ten-node tets."""

from pathlib import Path

import gmsh
import numpy as np
import pytest

from orchestrator.errors import InputError
from orchestrator.scene.mesh.readers.read import read
from orchestrator.scene.mesh.gmsh_session import session
from orchestrator.scene.mesh.geometry import tet_volumes


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Two boxes that share a face, one side named, as gmsh writes them; q: ten-node tets, bent: of a ball."""
    folder = tmp_path_factory.mktemp("saved")
    with session():
        one, two = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1), gmsh.model.occ.addBox(1, 0, 0, 1, 1, 1)
        gmsh.model.occ.fragment([(3, one)], [(3, two)])
        gmsh.model.occ.synchronize()
        sides = gmsh.model.getEntitiesInBoundingBox(-0.01, -0.01, -0.01, 0.01, 1.01, 1.01, 2)
        for dimension, number, tags, name in ((3, 1, [1], "left"), (3, 2, [2], "right"), (2, 3, [t for _, t in sides], "clamp")):
            gmsh.model.addPhysicalGroup(dimension, tags, number, name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
        gmsh.model.mesh.generate(3)
        for ending in ("msh", "unv", "bdf", "inp", "med"):
            gmsh.write(str(folder / f"a.{ending}"))
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.model.mesh.partition(3)
            gmsh.write(str(folder / f"cut{binary}.msh"))
            gmsh.model.mesh.unpartition()
        gmsh.option.setNumber("Mesh.Binary", 0)
        gmsh.model.mesh.setOrder(2)
        for ending in ("msh", "unv", "inp", "med"):
            gmsh.write(str(folder / f"q.{ending}"))
        gmsh.model.add("ball")
        gmsh.model.occ.addSphere(0, 0, 0, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(folder / "bent.msh"))
    return folder


def check(mesh, names=("left", "right"), clamp="clamp"):
    assert list(mesh.volumes) == list(names) and mesh.cells.shape[1] == 4
    volumes = tet_volumes(mesh.nodes, mesh.cells)
    assert np.allclose([volumes[mesh.volume == i].sum() for i in range(2)], 1.0)
    assert (np.abs(mesh.nodes[mesh.surfaces[clamp]][..., 0]) < 1e-12).all()
    corner = mesh.nodes[mesh.surfaces[clamp]]
    assert np.isclose(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum() / 2, 1.0)


@pytest.mark.parametrize("name", ["a.msh", "a.unv", "a.inp", "a.med", "q.msh", "q.unv", "q.inp", "q.med"])
def test_names_survive_every_format(saved, name):
    mesh = read(saved / name)
    check(mesh)
    assert bool(mesh.remarks) == name.startswith("q") and "bend" not in str(mesh.remarks)


@pytest.mark.parametrize("binary", [0, 1])
def test_partitions_are_volumes(saved, binary):
    """Of either box, with the nodes and tets that the file in one piece has."""
    whole, mesh = read(saved / "a.msh"), read(saved / f"cut{binary}.msh")
    assert len(mesh.nodes) == len(whole.nodes) and len(mesh.cells) == len(whole.cells) and len(mesh.volumes) > 3
    assert "in partitions" in str(mesh.remarks) and len(mesh.remarks) == 1
    sizes = tet_volumes(mesh.nodes, mesh.cells)
    for box in ("left", "right"):
        pieces = [i for i, name in enumerate(mesh.volumes) if name in {f"{box}_{k}" for k in (1, 2, 3)}]
        assert sizes[np.isin(mesh.volume, pieces)].sum() == pytest.approx(1.0) and len(pieces) >= 1
    assert len(mesh.surfaces["clamp"]) == len(whole.surfaces["clamp"])


@pytest.mark.parametrize("there, told", [
    ("bar_[123]", "partition 4 of 4 is in none of the files"), ("*", "files of meshes in different partitions")])
@pytest.mark.long
def test_files_that_do_not_belong_together(tmp_path, saved, there, told):
    for file in [*Path(__file__).parent.glob("meshes/bar_*.msh"), saved / "cut0.msh"]:
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(InputError, match=told):
        read(tmp_path / f"{there}.msh")


def test_nastran_has_numbers_for_names(saved):
    check(read(saved / "a.bdf"), ("volume_1", "volume_2"), "surface_1")


def test_edges_that_bend_are_told(saved):
    mesh = read(saved / "bent.msh")
    assert "edges that bend are straight here" in mesh.remarks[1]


DECK = """** a deck as people write them
*HEADING
whatever, 1, 2
*NODE, NSET=ALL
1, 0, 0, 0
2, 1., 0, 0
3, 0, 1.D0, 0
4, 0, 0, 1
*INCLUDE, INPUT=more.inc
*ELEMENT, TYPE=C3D4, ELSET=Body
10, 1, 2, 3, 4
*Element, type=C3D4, elset=Body
11, 2, 3, 4, 5
*NSET, NSET=base, GENERATE
1, 3, 1
*ELSET, ELSET=lower
10
*SURFACE, NAME=front, TYPE=ELEMENT
lower, S2
11, S3
*MATERIAL, NAME=STEEL
*ELASTIC
210000, .3
*SOLID SECTION, ELSET=lower, MATERIAL=STEEL
1.
*STEP
*CLOAD
1, 1, 1.
"""


def deck(tmp_path, text=DECK):
    (tmp_path / "more.inc").write_text("*NODE\n5, 1, 1, 1\n")
    (tmp_path / "part.inp").write_text(text)
    return tmp_path / "part.inp"


def test_a_deck_with_node_sets_surfaces_and_files_included(tmp_path):
    mesh = read(deck(tmp_path))
    assert len(mesh.cells) == 2 and sorted(mesh.volumes) == ["Body", "lower"]
    assert "of 'Body' 1 of 2 are left, the others are in 'lower'" in mesh.remarks[0]
    faces = {name: {tuple(sorted(map(tuple, mesh.nodes[triangle].tolist()))) for triangle in triangles}
             for name, triangles in mesh.surfaces.items()}
    point = dict(zip(range(1, 6), [(0., 0., 0.), (1., 0., 0.), (0., 1., 0.), (0., 0., 1.), (1., 1., 1.)]))
    face = lambda *nodes: tuple(sorted(point[n] for n in nodes))  # noqa: E731
    assert faces["base"] == {face(1, 2, 3)}
    assert faces["front"] == {face(1, 4, 2), face(3, 5, 4)}  # S2 of a tet: 1-4-2; S3: 2-4-3
    assert len(faces["ALL"]) == 3  # of the one tet that has them all


@pytest.mark.parametrize("old, new",
                         [("3, 0, 1.D0, 0", "3, 0, 1.D0, 0, 0., 0., 1."), ("3, 0, 1.D0, 0", "3,, 1.D0"), ("3, 0, 1.D0, 0", "3, , 1.D0, ,"),
                                      ("*MATERIAL", "*SURFACE, NAME=skin, TYPE=ELEMENT\nlower, S1\nlower, SPOS\n*MATERIAL"),
                                      ("*MATERIAL", "*SURFACE, NAME=rim\n99, EDGE2\n99, E1\n98, SNEG\n*MATERIAL")])
def test_lines_that_say_more_or_less_than_is_asked(tmp_path, old, new):
    """Normals of nodes, coordinates left out, faces of shells: such a surface is passed over as a whole, and told."""
    plain, other = read(deck(tmp_path)), read(deck(tmp_path, DECK.replace(old, new, 1)))
    np.testing.assert_array_equal(other.nodes, plain.nodes)
    assert set(other.surfaces) == set(plain.surfaces) and len(other.remarks) == len(plain.remarks) + ("SURFACE" in new)
    assert "SURFACE" not in new or "is passed over" in other.remarks[0]


@pytest.mark.parametrize("whole, files", [
    ("1, 0, 0, 0\n2, 1., 0, 0\n3, 0, 1.D0, 0\n", {"some.inc": "** nodes\n1, 0, 0, 0\n2, 1., 0, 0\n3, 0, 1.D0, 0\n"}),
    ("2, 1., 0, 0\n", {"some.inc": "2, 1., 0, 0\n"}),  # and the card goes on below
    ("2, 1., 0, 0\n3, 0, 1.D0, 0\n", {"some.inc": "2, 1., 0, 0\n*INCLUDE, INPUT=deep.inc", "deep.inc": "3, 0, 1.D0, 0"}),
    ("10, 1, 2, 3, 4\n", {"some.inc": "10, 1, 2,\n3, 4"}), ("1, 3, 1\n", {"some.inc": "1, 3, 1\n"}),
    ("lower, S2\n11, S3\n", {"some.inc": "lower, S2\n11, S3\n"}),
    ("*NSET, NSET=base, GENERATE\n", {"some.inc": "*NSET, NSET=base, GENERATE\n"}),  # its data below
    ("*STEP\n", {"some.inc": "*STEP\n"}),
    ("*INCLUDE, INPUT=more.inc\n", {"some.inc": "*INCLUDE, INPUT='in/more.inc'\n", "in/more.inc": "*INCLUDE, INPUT=last.inc\n",
                                   "last.inc": "*NODE\n5, 1, 1, 1\n"})])
def test_lines_of_files_stand_where_they_are_included(tmp_path, whole, files):
    """Data there continues the card above, as in CalculiX, which looks for all files beside the deck."""
    plain = read(deck(tmp_path))
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert whole in DECK
    other = read(deck(tmp_path, DECK.replace(whole, "*INCLUDE, INPUT=some.inc\n", 1)))
    np.testing.assert_array_equal(other.nodes, plain.nodes)
    assert {name: len(own) for name, own in other.surfaces.items()} == {name: len(own) for name, own in plain.surfaces.items()}
    assert other.volumes == plain.volumes and other.remarks == plain.remarks


def test_included_lines_that_could_be_read_two_ways_are_refused(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "some.inc").write_text("*INCLUDE, INPUT=more.inc\n")
    (tmp_path / "in" / "more.inc").write_text("*NODE\n5, 2, 2, 2\n")
    for text, words in ((DECK.replace("more.inc", "in/some.inc"), "some.inc:1: two files of this name"),
                        ("*INCLUDE, INPUT=bare.inc\n" + DECK, "bare.inc:2: data above the first card")):
        (tmp_path / "bare.inc").write_text("\n6, 0, 0, 0\n")
        with pytest.raises(InputError, match=words):
            read(deck(tmp_path, text))


@pytest.mark.parametrize("old, new, words", [
    ("*NODE", "*NODE, SYSTEM=C", "nodes in SYSTEM=C"), ("*MATERIAL", "*SYSTEM\n0., 0., 1.\n*MATERIAL", "*SYSTEM, which moves nodes"),
    ("3, 0, 1.D0, 0", "3.5, 0, 1., 0", "part.inp:7: '3.5' as the number of a node"),
    ("3, 0, 1.D0, 0", "3, 0, one, 0", "part.inp:7: a word that is no number"),
    ("lower, S2", "lower, P2", "part.inp:19: a face that is not named so"),
    ("11, 2, 3, 4, 5", "11, 2, 3, 4", "numbers for elements of 4 nodes"), ("10, 1, 2, 3, 4", "10, 1, 2, 3, 9", "node 9"),
    ("TYPE=C3D4, ELSET", "TYPE=C3D99, ELSET", "elements of type C3D99"), ("more.inc", "less.inc", "less.inc: no such file")])
def test_what_is_wrong_with_a_deck_is_told_with_its_line(tmp_path, old, new, words):
    with pytest.raises(InputError) as caught:
        read(deck(tmp_path, DECK.replace(old, new, 1)))
    assert words in str(caught.value)
