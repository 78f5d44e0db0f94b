"""What a rank is given of a scene: its subdomains, their interfaces, what of the neighbours meets these, and no more."""

import pickle

import numpy as np
import pytest
from ranks_case import CASES
from threads import among

from orchestrator.config.load import config_from
from orchestrator.method.setup import Part
from orchestrator.parallel.placement import ranks_of
from orchestrator.parallel.team import ALONE
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
    rank_of = ranks_of(scene, 4)
    size = len(pickle.dumps(Part.of(scene)))

    def shares(team):
        part = Part.handed_out(scene, rank_of, team)
        part.space.link.team, part.meeting = ALONE, None
        return len(pickle.dumps(part)) / size, len(part.scene.mesh.cells) / len(scene.mesh.cells)

    for share in np.ravel(among(4, shares)):
        assert share < 1 / 4 + 1 / 8


@pytest.mark.parametrize("case", ["perfect", "contact", "parts in contact"])
def test_ranks_number_traces_as_one_does(case):
    scene = build_scene(config_from({"name": "cut", **CASES[case]}))
    rank_of, one = np.arange(len(scene.subdomains)) % 3, Part.of(scene)

    def of_rank(team):
        part = Part.handed_out(scene, rank_of, team)
        space, link, number = part.space, part.space.link, part.scene.number
        whole, mine = one.space, rank_of[one.space.owner] == team.rank
        assert np.array_equal(link.number, np.flatnonzero(mine)) and link.total == whole.size
        for name, at in (("dof", link.number), ("global_dof", link.boundary_number)):
            ours = getattr(space, name)
            assert np.array_equal(3 * number[ours // 3] + ours % 3, getattr(whole, name)[at])
        assert np.array_equal(space.gather < 0, whole.gather[mine] < 0)
        there = space.gather >= 0
        assert np.array_equal(link.boundary_number[space.gather[there]], whole.gather[mine][there])
        assert np.array_equal(space.labels[space.label], whole.labels[whole.label[link.boundary_number]])
        ghosts, = space.extended(link.number[None].astype(float))
        assert np.array_equal(rank_of[whole.owner[ghosts[0].astype(int)]] == team.rank, np.arange(len(ghosts[0])) < space.size)
        known, met = (set(zip(*(x[side].tolist() for side in ("one", "two")))) for x in (
            {side: ghosts[0][getattr(space.transfer, side)] for side in ("one", "two")},
            {side: getattr(whole.transfer, side)[mine[whole.transfer.one] | mine[whole.transfer.two]] for side in ("one", "two")}))
        assert known == met or not whole.transfer.picks
        for body, (centre, size, motions) in one.carried.frames.items():
            ours = part.carried.frames[body]
            assert all(np.allclose(x, y, rtol=1e-12, atol=1e-12 * np.abs(motions).max()) for x, y in zip(ours, (centre, size, motions)))
        return link.number

    numbers = among(3, of_rank)
    assert np.array_equal(np.sort(np.concatenate(numbers)), np.arange(one.space.size))
