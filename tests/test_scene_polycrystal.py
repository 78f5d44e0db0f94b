"""Polycrystals: what grains, interfaces and meshes must be, what is mended, and which seeds are passed over."""

from dataclasses import replace
from functools import lru_cache

import gmsh
import numpy as np
import pytest
from quick import late

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.scene.mesh.grains import polycrystal
from orchestrator.scene.mesh.grains.polyhedra import narrowest
from orchestrator.scene.mesh.faces import pieces
from orchestrator.scene.mesh.geometry import area_vectors, dihedral_range, roundness, tet_volumes
from orchestrator.scene.mesh.grains.grain_meshes import grain_mesh
from orchestrator.scene.mesh.sources import bricks, make_mesh
from benchmarks.problems.soundness import is_ball, unsound

pytestmark = pytest.mark.xdist_group("polycrystals")  # meshes are made once for many tests
ONE = np.ones(3)
# Of these, gmsh makes tets that are too flat or too sharp.
BAD = [(6, 0.25, 14), (15, 0.16, 16), (27, 0.1, 16), (27, 0.1, 17), (64, 0.08, 4)]


def config(scale=1.0, **entry):
    entry = {"grains": 15, "size": 1.0, "h": 0.16} | entry
    return config_from({
        "name": "test", "mesh": {"polycrystal": entry, "scale": scale},
        "subdomains": "groups", "materials": [{"young": 1.0, "poisson": 0.3}],
        "boundary": [{"on": "zmin", "displacement": [0.0, 0.0, 0.0]}]})


def made(**entry):
    """Mesh and faces."""
    return make_mesh(config(**entry).mesh)


@lru_cache
def known(grains=15, h=0.16, lloyd=0):
    return made(grains=grains, h=h, lloyd=lloyd)


CASES = [(10, 0.094, 0), (15, 0.16, 0), (15, 0.16, 10), late(40, 0.08, 0)]


@pytest.mark.parametrize("grains, h, lloyd", CASES)
def test_grains_fill_the_box_and_share_their_faces(grains, h, lloyd):
    mesh, faces = known(grains, h, lloyd)
    volumes = tet_volumes(mesh.nodes, mesh.cells)
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(1, rel=1e-12)
    assert mesh.volumes == [f"grain_{i + 1}" for i in range(grains)]
    assert np.array_equal(np.unique(mesh.volume), np.arange(grains))
    # Grains hold together by faces; and whatever has no neighbour lies on the box.
    assert pieces(faces, mesh.volume)[0] == grains
    outer = mesh.nodes[faces.triangles[faces.outer]]
    assert np.any(np.all((outer == 0) | (outer == 1), axis=1), axis=1).all()
    assert np.linalg.norm(area_vectors(mesh.nodes, faces.triangles[faces.outer]), axis=1).sum() == pytest.approx(6)


@pytest.mark.parametrize("grains, h, seed", BAD)
@pytest.mark.long
def test_bad_tets_are_mended_where_they_are(grains, h, seed, monkeypatch):
    raw = []
    monkeypatch.setattr(polycrystal, "grain_mesh", lambda *given: raw.append(grain_mesh(*given)) or raw[-1])
    mesh, faces = made(grains=grains, h=h, seed=seed)
    [raw] = raw
    assert mesh.source == f"polycrystal of {grains} grains, seed {seed}"
    [remark] = mesh.remarks
    assert remark.startswith(f"{mesh.source}: mended where tets were bad: ")
    sharp, blunt = dihedral_range(mesh.nodes, mesh.cells)
    assert roundness(mesh.nodes, mesh.cells).min() >= 0.05 and sharp >= 4 and blunt <= 176
    assert not unsound(mesh, ONE)
    volumes = tet_volumes(mesh.nodes, mesh.cells)
    # What was not bad stays: most nodes, and the grains' sizes but for where faces bend.
    assert np.array_equal(mesh.cells, raw.cells)
    assert (mesh.nodes == raw.points).all(axis=1).sum() > 0.99 * len(raw.points) - 5
    one, other = np.bincount(mesh.volume, volumes), np.bincount(raw.grain, tet_volumes(raw.points, raw.cells))
    if "bend" in remark:
        assert np.abs(one - other).max() < h**3
    else:
        assert one == pytest.approx(other, rel=1e-12)


def test_soundness_sees_what_is_wrong():
    mesh, faces = known()
    assert not unsound(mesh, ONE) and unsound(mesh, ONE * 1.001)
    halves = replace(mesh, volume=np.where(mesh.volume == 1, 0, mesh.volume))
    assert any("no balls: " in text and "grain_2" in text for text in unsound(halves, ONE))
    moved = replace(mesh, nodes=np.where(mesh.nodes == 1, 1 - 1e-9, mesh.nodes))
    assert "gaps" in unsound(moved, ONE)
    ring = bricks(ONE, np.array([3, 3, 1]), "ring")
    middle = np.all(np.abs(ring.nodes[ring.cells].mean(axis=1)[:, :2] - 0.5) < 1 / 6, axis=1)
    assert is_ball(ring.cells) and not is_ball(ring.cells[~middle])


def test_seeds_run_out(monkeypatch):
    def fails(dimension):
        raise Exception("overlapping facets")

    monkeypatch.setattr(gmsh.model.mesh, "generate", fails)
    with pytest.raises(InputError) as caught:
        made(grains=2, h=0.4)
    [problem] = caught.value.problems
    assert problem.path == ("mesh", "polycrystal") and "seeds 7 to 16" in problem.found and "smaller h" in problem.cure


def test_failure_of_the_mesher_passes_the_seed_over(monkeypatch):
    generate, calls = gmsh.model.mesh.generate, []

    def fail_once(dimension):
        calls.append(dimension)
        if len(calls) == 1:
            raise Exception("overlapping facets")
        generate(dimension)

    monkeypatch.setattr(gmsh.model.mesh, "generate", fail_once)
    mesh, _ = made(grains=2, h=0.4)
    assert mesh.source == "polycrystal of 2 grains, seed 8"
    assert mesh.remarks == [f"{mesh.source}: passed over seed 7: gmsh: overlapping facets"]
    assert not gmsh.isInitialized()


@pytest.mark.parametrize("h, words", [(0.6, "0.14 or less"), (0.001, "or more")])
def test_element_size_out_of_range(h, words):
    with pytest.raises(InputError) as caught:
        made(h=h)
    [problem] = caught.value.problems
    assert problem.path == ("mesh", "polycrystal", "h") and words in problem.cure


@pytest.mark.parametrize("grains", [1, 2, 3])
def test_few_grains(grains):
    mesh, _ = made(grains=grains, h=0.3)
    assert len(mesh.volumes) == grains and tet_volumes(mesh.nodes, mesh.cells).sum() == pytest.approx(1)


def test_bodies_that_are_folded_open_or_inside_out():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tet = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    body = np.zeros(4, dtype=int)
    assert np.degrees(narrowest(points, tet, body)) == pytest.approx([45])
    assert narrowest(points, tet[:3], body[:3]) is None and narrowest(points, tet[:, ::-1], body) is None
    twice = np.concatenate([points, points + 5])
    two = np.concatenate([tet, tet + 4])
    assert np.degrees(narrowest(twice, two, np.repeat([3, 9], 4))) == pytest.approx([45, 45])
    assert narrowest(twice, two, np.zeros(8, dtype=int)) is None
