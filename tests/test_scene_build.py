"""Partition, interfaces, boundary conditions and loads: what a scene must hold, and what it must refuse."""

from types import SimpleNamespace

import gmsh
import numpy as np
import pytest
from method_case import CLAMP, saved

from orchestrator.config.load import config_from
from orchestrator.config.model import Config
from orchestrator.errors import InputError, Problems
from orchestrator.laws.contact import Contact
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.conditions.rigid import check_held
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.freedom import leave_free
from orchestrator.scene.interfaces.pairs import make_interfaces
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.mesh.faces import faces_of, pieces
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.sources import bricks, joined
from orchestrator.scene.mesh.mesh import Mesh, StandIn, split_numbering
from orchestrator.scene.partition import Partition, make_partition
from orchestrator.scene.shapes import Shape


def config(**changes):
    data = {"name": "test", "mesh": {"box": {"size": [4.0, 1.0, 1.0], "cells": [8, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 1.0, "poisson": 0.3}],
            "boundary": [CLAMP]}
    return Config.model_validate({**data, **changes})


def scene(**changes):
    return build_scene(config(**changes))


def problems(**changes):
    with pytest.raises(InputError) as caught:
        scene(**changes)
    return caught.value.problems


def problem(**changes):
    found = problems(**changes)
    assert len(found) == 1, found
    return found[0]


def cubes(size, labels, names=None):
    """A mesh of unit bricks (whole numbers ``size`` along the axes), one volume per label; -1 leaves a hole."""
    mesh = bricks(np.array(size, dtype=float), np.array(size), "box")
    volume = np.repeat(np.asarray(labels).reshape(-1), 6)
    keep = volume >= 0
    used, cells = np.unique(mesh.cells[keep], return_inverse=True)
    return Mesh(mesh.nodes[used], cells.reshape(-1, 4), volume[keep],
                names or [f"volume_{i}" for i in range(volume.max() + 1)], {}, "bricks")


def interfaces_of(mesh, fixed=None, entries=()):
    faces = faces_of(mesh.cells, len(mesh.nodes))
    found = Problems()
    partition = Partition(mesh.volume, mesh.volumes)
    numbering = split_numbering(mesh.cells, mesh.volume, len(mesh.nodes))
    fixed = np.zeros((len(mesh.nodes), 3), dtype=bool) if fixed is None else fixed
    laws = Laws(list(entries), [*partition.names, *mesh.volumes])
    interfaces, _ = make_interfaces(Parts(mesh, faces, partition, numbering, np.ones(len(mesh.cells)), fixed), laws, found)
    held = SimpleNamespace(fixed=fixed[numbering.nodes], values=np.zeros((1, len(numbering.nodes), 3)))
    return leave_free(mesh, interfaces, partition, numbering, held, list(entries), found), found.found


def test_every_patch_is_known_by_the_names_of_its_parts():
    """Two feet of one part stand on another, whose top a CAD model knows."""
    base, feet = cubes((5, 1, 1), [0] * 5, ["base"]), cubes((5, 1, 1), [0, -1, -1, -1, 0], ["feet"])
    feet.nodes[:, 2] += 1.0
    faces = faces_of(base.cells, len(base.nodes))
    top = faces.triangles[faces.outer][(base.nodes[faces.triangles[faces.outer]][:, :, 2] == 1).all(axis=1)]
    base.surfaces["top"] = top
    base.smooth["top"] = Shape("plane", normals=np.tile([0.0, 0.0, 1.0], (len(top), 3, 1)))
    entries = config(interfaces=[{"between": ["base", "feet"], "law": "contact"}]).interfaces
    found, complaints = interfaces_of(joined([base, feet]), entries=entries)
    assert not complaints and [i.called for i in found] == 2 * [(("base", "base"), ("feet", "feet"))]
    assert [i.law.name for i in found] == ["contact", "contact"]


def area(made, interface):
    return area_vectors(made.nodes[interface.global_nodes], interface.triangles).sum(axis=0)


# --- subdomains and interfaces ----------------------------------------------------------------------------


def test_grid():
    made = scene(mesh={"box": {"size": [3.0, 3.0, 3.0], "cells": [6, 6, 6]}}, subdomains={"grid": [3, 3, 3]})
    assert len(made.subdomains) == 27 and len(made.interfaces) == 54
    assert made.subdomains[5].name == "block 0-1-2"
    assert sum(np.linalg.norm(area(made.mesh, i)) for i in made.interfaces) == pytest.approx(54)


def test_orientation_is_outward_of_the_lower_subdomain():
    made = scene(subdomains={"metis": 6})
    for interface in made.interfaces:
        low, high = interface.subdomains
        assert low < high
        corners = interface.global_nodes[interface.triangles]
        normals = area_vectors(made.mesh.nodes, corners)
        faces = faces_of(made.mesh.cells, len(made.mesh.nodes))
        index = faces.find(corners)
        beside = np.c_[faces.owner[index], faces.neighbour[index]]
        inside = np.where(made.cell_subdomain[beside] == low, beside, -1).max(axis=1)
        centres = made.mesh.nodes[made.mesh.cells[inside]].mean(axis=1)
        outward = made.mesh.nodes[corners].mean(axis=1) - centres
        assert (np.einsum("ij,ij->i", normals, outward) > 0).all()


def test_touching_in_an_edge_or_a_node_is_no_interface():
    # 0 and 3 meet in an edge only.
    found, _ = interfaces_of(cubes([2, 2, 1], [0, 1, 2, 3]))
    assert [i.subdomains for i in found] == [(0, 1), (0, 2), (1, 3), (2, 3)]
    # The diagonal of a 2 × 2 × 2 block: 0 and 7 meet in a node only.
    found, _ = interfaces_of(cubes([2, 2, 2], range(8)))
    assert len(found) == 12 and (0, 7) not in [i.subdomains for i in found]


@pytest.mark.parametrize("count", [3, 16])
def test_metis_parts_are_connected(count):
    made = scene(mesh={"box": {"size": [2.0, 2.0, 2.0], "cells": [8, 8, 8]}}, subdomains={"metis": count})
    faces = faces_of(made.mesh.cells, len(made.mesh.nodes))
    assert pieces(faces, made.cell_subdomain)[0] == count == len(made.subdomains)
    sizes = np.array([len(s.cells) for s in made.subdomains])
    assert sizes.max() < 1.25 * sizes.mean()


def test_numbering_does_not_matter():
    mesh = cubes([3, 2, 2], [0, 0, 1, 1, 0, 2, 2, 1, 3, 3, 3, 2])
    rng = np.random.default_rng(1)
    to, order = rng.permutation(len(mesh.nodes)), rng.permutation(len(mesh.cells))
    nodes = np.empty_like(mesh.nodes)
    nodes[to] = mesh.nodes
    other = Mesh(nodes, to[mesh.cells][order][:, [1, 2, 0, 3]], mesh.volume[order], mesh.volumes, {}, "")

    def described(made):
        return sorted((i.subdomains, sorted(map(tuple, made.nodes[i.global_nodes].tolist())),
                       tuple(np.round(area(made, i), 12) + 0.0)) for i in interfaces_of(made)[0])

    assert described(mesh) == described(other)


def test_clamped_patch_is_left_out_and_partly_free_nodes_are_marked():
    mesh = cubes([2, 1, 1], [0, 1])
    fixed = np.zeros((12, 3), dtype=bool)
    fixed[mesh.nodes[:, 0] == 1, :2] = True
    (interface,), _ = interfaces_of(mesh, fixed)
    assert (interface.free == [False, False, True]).all()
    fixed[mesh.nodes[:, 0] == 1] = True
    assert interfaces_of(mesh, fixed)[0] == []


def entry(*between, **more):
    return Contact.Parameters(between=list(between), law="contact", **more)


def test_laws_the_last_match_wins_in_either_order():
    mesh = cubes([4, 1, 1], [0, 1, 2, 3], ["plate", "bolt_1", "bolt_2", "nut"])
    entries = [entry("*", "*", friction=1.0), entry("bolt*", "*", friction=2.0), entry("bolt*", "plate", friction=3.0)]
    found, wrong = interfaces_of(mesh, entries=entries)
    assert [(i.name, i.law.friction) for i in found] == [
        ("plate | bolt_1", 3.0), ("bolt_1 | bolt_2", 2.0), ("bolt_2 | nut", 2.0)]
    assert not wrong


def test_contact_where_everything_is_prescribed():
    """A law that no node is free to follow is a mistake in the boundary conditions."""
    mesh = cubes([3, 1, 1], [0, 1, 2], ["plate", "bolt", "nut"])
    held = np.isclose(mesh.nodes[:, :1], mesh.nodes[interfaces_of(mesh)[0][0].global_nodes[0], 0])
    entries = [entry("plate", "bolt", friction=0.1)]
    found, (problem,) = interfaces_of(mesh, np.repeat(held, 3, axis=1), entries)
    assert [i.name for i in found] == ["bolt | nut"]
    assert problem.path == ("interfaces", 0, "law") and "prescribe every node on both sides" in problem.found


def test_interface_that_matches_no_pair():
    mesh = cubes([3, 1, 1], [0, 1, 2], ["plate", "bolt", "nut"])
    entries = [entry("bollt", "plate"), entry("plate", "nut")]
    _, (unknown, apart) = interfaces_of(mesh, entries=entries)
    assert unknown.path == ("interfaces", 0, "between") and "'bollt' matches no subdomain" in unknown.found
    assert "did you mean bolt" in unknown.cure
    assert apart.path == ("interfaces", 1, "between") and "share no face" in apart.found
    assert "plate | bolt" in apart.cure


@pytest.mark.long
def test_the_real_assembly():
    made = scene(mesh={"step": "gmsh:as1-tu-203.stp", "h": 8.0}, subdomains="groups",
                 boundary=[{"on": "plate:*", "displacement": [0.0, 0.0, 0.0]}],
                 interfaces=[{"between": ["*", "*"]}, {"between": ["bolt*", "plate"]}])
    assert len(made.subdomains) == 18 and len(made.interfaces) == 32
    assert not any("patch" in i.name for i in made.interfaces)
    names = [s.name for s in made.subdomains]
    assert {"plate", "rod", "l-bracket_1", "l-bracket_2", "bolt_6", "nut_8"} <= set(names)
    assert "plate:1" in made.mesh.surfaces and not gmsh.isInitialized()


# --- boundary conditions and loads ------------------------------------------------------------------------


def test_loads_equal_their_resultants():
    made = scene(histories={"ramp": [1.0, -2.0]}, loads=[{"on": "*", "body_force": [0.0, 0.0, -3.0]}], boundary=[
        CLAMP, {"on": "xmax", "traction": [5.0, 1.0, 0.0], "history": "ramp"}, {"on": "zmax", "pressure": 7.0}])
    wanted = np.array([[5, 1, -12 - 28], [-10, -2, -12 - 28]])
    assert made.loads.sum(axis=1) == pytest.approx(wanted, rel=1e-13, abs=1e-12)
    together = np.zeros_like(made.loads)
    for sub in made.subdomains:
        np.add.at(together, (slice(None), sub.nodes), sub.loads)
    assert together == pytest.approx(made.loads, abs=1e-13)
    # Each slice carries its own weight and pressure, the last also the traction.
    assert [s.loads[0].sum(axis=0)[2] for s in made.subdomains] == pytest.approx([-10] * 4)
    assert [s.loads[0].sum(axis=0)[0] for s in made.subdomains] == pytest.approx([0, 0, 0, 5], abs=1e-12)


def test_materials_the_last_match_wins(tmp_path):
    source = saved(cubes([3, 1, 1], [0, 1, 2]), tmp_path / "a.mesh")
    made = scene(mesh=source, subdomains="groups", materials=[
        {"young": 1.0, "poisson": 0.3}, {"young": 2.0, "poisson": 0.3, "on": ["volume_[23]"]},
        {"young": 3.0, "poisson": 0.3, "on": "volume_3"}])
    assert [s.material.tolist() for s in made.subdomains] == [[0] * 6, [1] * 6, [2] * 6]
    unknown, without = problems(mesh=source, subdomains="groups", materials=[
        {"young": 1.0, "poisson": 0.3, "on": "volume_1"}, {"young": 1.0, "poisson": 0.3, "on": "volme_2"}])
    assert unknown.path == ("materials", 1, "on") and "did you mean volume_2" in unknown.cure
    assert without.found == "no material for volume_2, volume_3"


# --- rigid motions ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary, words", [
    ([], ["box can still move as a rigid body: every translation and every rotation"]),
    ([{"on": "xmin", "displacement": [0.0, 0.0, None]}], ["rigid body: translation along z"]),
    ([{"on": "xmin", "displacement": [0.0, None, None]}],
     ["translation along z, translation along y", "rotation about the x axis"]),
    ([{"on": {"box": [[0.0, 0.0, 0.0], [0.0, 0.5, 0.5]]}, "displacement": [0.0, 0.0, 0.0]}], None),
    ([{"on": "xmin", "displacement": [0.0, None, None]}, {"on": "zmin", "displacement": [None, None, 0.0]}],
     ["rigid body: translation along y"]),
])
def test_structure_that_can_still_move(boundary, words):
    if words is None:
        assert scene(boundary=boundary).fixed.any()
        return
    wrong = problem(boundary=boundary)
    assert wrong.path == ("boundary",)
    assert all(word in wrong.found for word in words), wrong.found


def test_rotation_about_a_hinge_is_named():
    mesh = bricks(np.array([2.0, 1.0, 1.0]), np.array([2, 1, 1]), "box")
    fixed = np.repeat(((mesh.nodes[:, 0] == 2) & (mesh.nodes[:, 2] == 1))[:, None], 3, axis=1)
    found = Problems()
    check_held(mesh, faces_of(mesh.cells, len(mesh.nodes)), fixed, found)
    assert "rigid body: rotation about the y axis through (2, 0.5, 1)" in found.found[0].found


def test_parts_whose_faces_do_not_match_are_said_to_touch(tmp_path):
    """The other part is mirrored: its nodes coincide with the first one's, its diagonals cross them."""
    one = bricks(np.ones(3), np.array([1, 1, 1]), "box")
    mesh = Mesh(np.r_[one.nodes, one.nodes * [1, -1, 1] + [1, 1, 0]], np.r_[one.cells, one.cells[:, [1, 0, 2, 3]] + 8],
                np.repeat([0, 1], 6), ["a", "b"], {}, "")
    wrong = problem(mesh=saved(mesh, tmp_path / "a.mesh"), subdomains="groups")
    assert wrong.path == ("boundary",) and "volume_2 (one of 2 separate bodies" in wrong.found
    assert "4 of its nodes coincide" in wrong.cure and "merge" in wrong.cure
    assert "{between: auto, law: perfect}" in wrong.cure
    joined = scene(mesh=saved(mesh, tmp_path / "a.mesh"), subdomains="groups", interfaces=[{"between": "auto", "law": "perfect"}])
    assert len(joined.interfaces) == 1


# --- what must be refused -------------------------------------------------------------------------------------


def test_box_that_hits_nothing():
    far = problem(boundary=[CLAMP, {"on": {"box": [[7.0, 0.0, 0.0], [9.0, 1.0, 1.0]]}, "pressure": 1.0}])
    assert "3 away" in far.found and "(4, 1, 1)" in far.expected
    thin = problem(boundary=[CLAMP, {"on": {"box": [[3.9, 0.4, 0.9], [5.0, 0.6, 2.0]]}, "pressure": 1.0}])
    assert "faces reach into it" in thin.found and "enlarge" in thin.cure
    upside = problem(boundary=[CLAMP, {"on": {"box": [[9.0, 0.0, 0.0], [7.0, 1.0, 1.0]]}, "pressure": 1.0}])
    assert "above its second" in upside.found


def test_components_free_at_some_steps_only():
    data = config().model_dump(exclude_none=True)
    with pytest.raises(InputError, match="component x free at some steps only") as caught:
        config_from({**data, "boundary": [CLAMP, {"on": "xmax", "displacement": [[None, 0.0, 0.0], [1.0, 0.0, 0.0]]}]})
    assert [wrong.path for wrong in caught.value.problems] == [("boundary", 1, "displacement")]


def test_disconnected_group(tmp_path):
    source = saved(cubes([1, 1, 5], [0, 1, 1, 1, 0]), tmp_path / "a.mesh")
    wrong = problem(mesh=source, subdomains="groups")
    assert wrong.path == ("subdomains",)
    assert "disconnected subdomain: volume_1 is in 2 pieces (the smallest has 6 tets, at (" in wrong.found
    assert "group of its own" in wrong.cure
    assert len(scene(mesh=source, subdomains={"metis": 4}).subdomains) == 4


def test_joints_of_another_programs_part_may_be_apart():
    """Behind them the part hangs together; volumes of ours in pieces are named, and these alone."""
    mesh = bricks(np.array([7.0, 1.0, 1.0]), np.array([7, 1, 1]), "box")
    x = mesh.nodes[mesh.cells].mean(axis=1)[:, 0]
    groups, nodes = SimpleNamespace(groups=True), len(mesh.nodes)
    for ours, theirs in (([2], [0, 4]), ([0, 2], [4, 6])):
        kept = np.isin(x.astype(int), ours + theirs)
        own = np.isin(x[kept].astype(int), theirs).astype(int)
        stand = StandIn(1, 0, nodes, np.zeros((nodes, 3), bool), np.zeros((0, 3), int), 1.0, False)
        made = Mesh(mesh.nodes, mesh.cells[kept], own, ["ours", "theirs"], foreign=[stand])
        if len(ours) == 1:
            assert make_partition(made, faces_of(made.cells, nodes), groups).names == ["ours", "theirs"]
            continue
        with pytest.raises(InputError, match="ours is in 2 pieces") as caught:
            make_partition(made, faces_of(made.cells, nodes), groups)
        assert "theirs is" not in str(caught.value)


def test_disconnected_slice(tmp_path):
    # A U: the slices of its two legs fall apart.
    source = saved(cubes([2, 1, 3], [[0, 0, 0], [0, -1, 0]]), tmp_path / "a.mesh")
    wrong = problem(mesh=source, subdomains={"slices": {"axis": "x", "count": 2}})
    assert "slice 1 is in 2 pieces" in wrong.found and "metis: 2" in wrong.cure


def test_everything_is_reported_at_once():
    found = problems(subdomains={"metis": 1000}, materials=[{"young": 1.0, "poisson": 0.3, "on": "bix"}],
                     boundary=[{**CLAMP, "on": "xmim"}], loads=[{"on": "bax", "body_force": [0.0, 0.0, 1.0]}])
    assert [p.path for p in found] == [("materials", 0, "on"), ("materials",), ("boundary", 0, "on"), ("subdomains",),
                                       ("loads", 0, "on")]


# --- scenes that are hardly meant so ----------------------------------------------------------------------


@pytest.mark.parametrize("changes, words", [
    ({"boundary": [CLAMP]}, ["nothing loads the scene"]),
    ({"boundary": [CLAMP, {"on": {"plane": "x", "at": 0.0}, "traction": [1, 0, 0]}]}, ["boundary[1], a traction, acts on faces"]),
    ({"boundary": [CLAMP, {"on": {"plane": "x", "at": 0.0}, "pressure": 1.0}]}, ["boundary[1], a pressure, acts on faces"]),
    ({"boundary": [CLAMP, {"on": "xmax", "traction": [1, 0, 0]}], "histories": {"ramp": [0.5, 1.0]}}, ["history 'ramp' has no use"]),
    ({"boundary": [CLAMP, {"on": "xmax", "traction": [1, 0, 0]}]}, []),
    ({"boundary": [CLAMP, {"on": "xmax", "displacement": [1e-3, None, None]}, {"on": "xmax", "traction": [0, 1, 0]}]}, []),
    ({"boundary": [CLAMP], "loads": [{"body_force": [0, 0, -1]}]}, []),
    ({"boundary": [CLAMP], "interfaces": [{"law": "jump", "jump": [1e-3, 0, 0]}]}, []),
    ({"boundary": [CLAMP], "interfaces": [{"law": "pretension", "force": 10.0}]}, []),
    ({"boundary": [CLAMP, {"on": "xmax", "coupling": {"force": [0, 0, 1.0]}}]}, []),
    ({"boundary": [CLAMP, {"on": "xmax", "coupling": {"force": [0, 0, 0]}}]}, ["nothing loads the scene"]),
], ids=["no load", "traction on the clamp", "pressure on the clamp", "history", "pulled", "held along, pushed across", "weight", "jump",
        "pretension", "coupled force", "coupled, no force"])
def test_what_is_hardly_meant(changes, words):
    said = scene_cautions(scene(**changes))
    assert len(said) == len(words) and all(text.startswith(word) for word, text in zip(words, said)), said
