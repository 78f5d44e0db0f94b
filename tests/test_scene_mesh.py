"""Mesh sources: counts, volumes, names, and everything a mesh file can do wrong."""

import os
import signal
from types import SimpleNamespace

import gmsh
import meshio
import numpy as np
import pytest

from orchestrator.errors import InputError
from orchestrator.scene.mesh.gmsh_session import locate, session
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh, checked
from orchestrator.scene.mesh.sources import bricks, make_mesh


def from_file(path, **more):
    return make_mesh(SimpleNamespace(file=str(path), **more))[0]


def problems_of(call, *arguments, **named):
    with pytest.raises(InputError) as caught:
        call(*arguments, **named)
    return caught.value.problems


def one_problem(call, *arguments, **named):
    problems = problems_of(call, *arguments, **named)
    assert len(problems) == 1
    return problems[0]


def small():
    return bricks(np.array([2.0, 1.0, 1.0]), np.array([2, 1, 1]), "box")


# --- structured -----------------------------------------------------------------------------------------


# --- faces ------------------------------------------------------------------------------------------------


# --- files ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gmsh_files(tmp_path_factory):
    """Two blocks side by side, with physical groups, in gmsh's two formats."""
    folder = tmp_path_factory.mktemp("gmsh")
    with session():
        occ, model = gmsh.model.occ, gmsh.model
        occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(1, 0, 0, 1, 1, 1))])
        occ.synchronize()
        model.addPhysicalGroup(3, [1], 7, "left block")
        model.addPhysicalGroup(3, [2], 8)
        found = {x: model.getEntitiesInBoundingBox(x - .01, -.01, -.01, x + .01, 1.01, 1.01, 2)[0][1] for x in (0, 1, 2)}
        model.addPhysicalGroup(2, [found[0]], 1, "clamp")
        model.addPhysicalGroup(2, [found[1]], 2, "glue")
        model.addPhysicalGroup(2, [found[2]], 3)
        model.addPhysicalGroup(2, [found[0], found[2]], 4, "ends")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        model.mesh.generate(3)
        for version in (2.2, 4.1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.write(str(folder / f"blocks{version}.msh"))
    return folder


def test_physical_groups_of_gmsh(gmsh_files):
    mesh = from_file(gmsh_files / "blocks4.1.msh")
    assert sorted(mesh.volumes) == ["left block", "volume_8"]
    left = mesh.cells[mesh.volume == mesh.volumes.index("left block")]
    assert tet_volumes(mesh.nodes, left).sum() == pytest.approx(1)
    assert mesh.nodes[left][..., 0].max() == pytest.approx(1)
    for name, x in (("clamp", 0), ("glue", 1)):
        assert mesh.nodes[mesh.surfaces[name]][..., 0] == pytest.approx(x)
        assert np.linalg.norm(area_vectors(mesh.nodes, mesh.surfaces[name]), axis=1).sum() == pytest.approx(1)
    assert np.linalg.norm(area_vectors(mesh.nodes, mesh.surfaces["ends"]), axis=1).sum() == pytest.approx(2)


@pytest.mark.parametrize("ending", [".mesh", ".meshb"])
def test_medit_references(tmp_path, ending):
    mesh = small()
    raw = meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("triangle", mesh.surfaces["xmin"])],
                      cell_data={"medit:ref": [np.repeat([3, 5], 6), np.full(2, 9)]})
    raw.write(tmp_path / f"a{ending}")
    again = from_file(tmp_path / f"a{ending}")
    assert again.volumes == ["volume_3", "volume_5"] and (again.volume == np.repeat([0, 1], 6)).all()
    assert (again.surfaces["surface_9"] == mesh.surfaces["xmin"]).all()


def test_unreferenced_nodes_are_dropped_and_files_without_groups_are_one_volume(tmp_path):
    mesh = small()
    meshio.Mesh(np.r_[[[9.0, 9, 9]], mesh.nodes], [("tetra", mesh.cells + 1)]).write(tmp_path / "a.vtu")
    again = from_file(tmp_path / "a.vtu")
    assert again.volumes == ["volume_1"] and len(again.nodes) == len(mesh.nodes)
    assert (again.cells == mesh.cells).all()


def test_missing_file(tmp_path):
    problem = one_problem(from_file, tmp_path / "none.msh")
    assert problem.path == ("mesh", "file") and "no such file" in problem.found


@pytest.mark.parametrize("name, content", [("a.msh", b"$MeshFormat\nnonsense"), ("a.xyz", b"1 2 3"), ("a.vtu", b"<a/>"),
                                           ("a.mesh", b""), ("a.inp", b"\x00\xff\x00")])
def test_unreadable_file(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    problem = one_problem(from_file, tmp_path / name)
    assert problem.path == ("mesh", "file") and name in problem.found
    assert any(words in problem.found for words in ("cannot be read", "no tetrahedra", "its content is not", "data above the first card"))
    assert capfd.readouterr() == ("", "")


def test_file_without_tets(tmp_path):
    meshio.Mesh(small().nodes, [("triangle", small().surfaces["xmin"])]).write(tmp_path / "a.vtu")
    problem = one_problem(from_file, tmp_path / "a.vtu")
    assert "no tetrahedra (it has triangle)" in problem.found and "mesh the volume" in problem.cure


def test_tets_of_twenty_nodes(tmp_path):
    meshio.Mesh(np.random.default_rng(0).random((20, 3)), [("tetra20", np.arange(20)[None])]).write(
        tmp_path / "a.msh", file_format="gmsh22")
    problem = one_problem(from_file, tmp_path / "a.msh")
    assert "higher order (tetra20)" in problem.found and "linear" in problem.cure


def test_other_solid_elements(tmp_path):
    mesh = small()
    meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("hexahedron", np.arange(8)[None])]).write(tmp_path / "a.vtu")
    assert "1 of 1 hexahedra are too distorted" in one_problem(from_file, tmp_path / "a.vtu").found
    meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("hexahedron64", np.arange(64)[None] % 8)]).write(
        tmp_path / "a.msh", file_format="gmsh22")
    assert "not known here: hexahedron64" in one_problem(from_file, tmp_path / "a.msh").found


# --- validity -------------------------------------------------------------------------------------------


def altered(cells=None, nodes=None):
    mesh = small()
    return Mesh(mesh.nodes if nodes is None else nodes, mesh.cells if cells is None else cells, mesh.volume,
                mesh.volumes, {}, "a.msh")


def test_mesh_of_the_other_orientation_is_turned():
    mesh, _ = checked(altered(small().cells[:, [1, 0, 2, 3]]))
    assert (tet_volumes(mesh.nodes, mesh.cells) > 0).all()


def test_inverted_tets():
    cells = small().cells.copy()
    cells[[4, 7]] = cells[[4, 7]][:, [1, 0, 2, 3]]
    problem = problems_of(checked, altered(cells))[0]
    assert problem.path == ("mesh",) and "a.msh: 2 inverted of 12 tets; the first is cell 4 at (" in problem.found
    assert problem.cure


def test_zero_volume_tets():
    cells = np.r_[small().cells, [[0, 1, 4, 5]]]
    mesh = altered(cells)
    mesh.volume = np.zeros(13, dtype=int)
    found = [p.found for p in problems_of(checked, mesh)]
    assert "a.msh: 1 zero-volume of 13 tets; the first is cell 12 at (0.5, 0, 0.5)" in found


def test_duplicated_tets():
    cells = small().cells
    found = [p.found for p in problems_of(checked, altered(np.r_[cells, cells[:1]]))]
    assert any("same side" in text or "three or more" in text for text in found)


def test_coordinates_that_are_no_numbers():
    nodes = small().nodes.copy()
    nodes[3, 1] = np.nan
    assert "node 3" in one_problem(checked, altered(nodes=nodes)).found


# --- CAD ------------------------------------------------------------------------------------------------


def test_unknown_example_and_missing_model(tmp_path):
    assert "gmsh:as1-tu-203.stp" in one_problem(locate, "gmsh:nothing.stp").expected
    assert "no such file" in one_problem(locate, str(tmp_path / "a.stp")).found


def test_unreadable_model(tmp_path):
    (tmp_path / "a.stp").write_text("nonsense")
    problem = one_problem(make_mesh, SimpleNamespace(step=str(tmp_path / "a.stp"), h=1.0))
    assert problem.path == ("mesh", "step") and "a.stp" in problem.found
    assert not gmsh.isInitialized()


def test_gmsh_leaves_the_signals_as_they_are():
    """It would have a broken pipe kill the program, whose message would then be missing."""
    heard, before = [], signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with session():
            os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM] * 2
    reading, writing = os.pipe()
    os.close(reading)
    with pytest.raises(BrokenPipeError):
        os.write(writing, b"nobody listens")
    os.close(writing)
