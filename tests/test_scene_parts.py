"""What a rank is given of a scene: its subdomains, their interfaces, what of the neighbours meets these, and no more."""

import pickle

import numpy as np
import pytest
from ranks_case import CASES

from orchestrator.config.load import config_from
from orchestrator.method.setup import Part
from orchestrator.parallel.placement import ranks_of
from orchestrator.scene.build import build_scene
from orchestrator.scene.part import overview, part_of
from orchestrator.scene.soles.make import make_soles
from benchmarks.problems.cases import cube


@pytest.fixture(scope="module", params=["perfect", "contact", "contact on ten nodes"])
def cut(request):
    config = config_from({"name": "cut", **CASES[request.param]})
    scene = build_scene(config)
    rank_of, known = ranks_of(scene, 3), overview(scene)
    return config, scene, rank_of, [part_of(scene, np.flatnonzero(rank_of == rank), known) for rank in range(3)]


def test_own_subdomains_are_whole_and_on_one_rank(cut):
    _, scene, rank_of, parts = cut
    for s, rank in zip(scene.subdomains, rank_of):
        own = parts[rank].subdomains[s.index]
        assert (parts[rank].number[own.nodes] == s.nodes).all() and (own.connectivity == s.connectivity).all()
        assert (parts[rank].mesh.nodes[own.nodes] == scene.mesh.nodes[s.nodes]).all()
        assert (parts[rank].cell_material[own.cells] == scene.cell_material[s.cells]).all()
        assert (own.loads == s.loads).all() and (own.prescribed == s.prescribed).all() and (own.fixed == s.fixed).all()
        for part in parts:
            assert (part.mesh.cells[part.subdomains[s.index].cells] ==
                    part.subdomains[s.index].nodes[part.subdomains[s.index].connectivity]).all()


def test_interfaces_meet_as_in_the_whole(cut):
    _, scene, rank_of, parts = cut
    for rank, part in enumerate(parts):
        for i, own in zip(scene.interfaces, part.interfaces):
            assert own.name == i.name and own.subdomains == i.subdomains and type(own.law) is type(i.law)
            if rank not in rank_of[list(i.subdomains)]:
                assert not len(own.global_nodes) and not len(own.triangles) and not len(own.free)
                continue
            assert (own.free == i.free).all() and (own.triangles == i.triangles).all()
            for side in (0, 1):
                assert (part.side_points(own, side) == scene.side_points(i, side)).all()
                assert (part.cell_subdomain[own.cells[:, side]] == i.subdomains[side]).all()


def test_soles_are_those_of_the_whole(cut):
    config, scene, rank_of, parts = cut
    for kind in ("symmetric", "overlap"):
        settings = config.method.sole.model_copy(update={"kind": kind})
        whole = make_soles(scene, settings)
        for rank, part in enumerate(parts):
            touched = [rank in rank_of[list(i.subdomains)] for i in scene.interfaces]
            for pair, own in zip(whole, make_soles(part, settings, wanted=touched)):
                for one, other in zip(pair, own or ()):
                    assert np.allclose(one.points, other.points, rtol=0, atol=1e-14)
                    assert np.allclose(one.young, other.young, rtol=1e-14) and (one.cells == other.cells).all()


def test_faces_of_loads_are_on_one_rank(cut):
    _, scene, _, parts = cut
    for index, entry in enumerate(scene.boundary):
        assert sum(len(part.boundary[index].triangles) for part in parts) == len(entry.triangles)


def test_a_rank_holds_little_more_than_its_share():
    """Of the neighbours a layer of cells: a quarter of 4 × 4 × 4 cubes of 5³ bricks is 16 of them and 16 to 24 layers."""
    scene = build_scene(config_from({"name": "cut", **cube(4, 5)}))
    rank_of, known, whole = ranks_of(scene, 4), overview(scene), Part.of_all(scene)
    size = len(pickle.dumps(whole))
    for rank in range(4):
        piece = part_of(scene, np.flatnonzero(rank_of == rank), known)
        given = Part(piece, whole.space.part(rank_of, rank, piece.number), whole.carried)
        assert len(pickle.dumps(given)) < (1 / 4 + 1 / 8) * size
        assert len(piece.mesh.cells) < (1 / 4 + 1 / 8) * len(scene.mesh.cells)
