"""Interfaces of parts that share no faces: coincident nodes, gaps from the geometry, and what does not match."""


import numpy as np
import pytest
from contact_case import contact, contacts, converged, written

from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.interfaces.pairing import REACH, Body, close_bodies
from orchestrator.scene.mesh.structured import bricks
from orchestrator.scene.model import Mesh
from orchestrator.scene.soles.difficulty import difficulty
from orchestrator.scene.soles.make import make_soles

HELD = {"on": "lower zmin", "displacement": [0, 0, 0]}
PATH = [[0.0, 0.0, -0.005], [0.01, 0.0, -0.005], [0.0, 0.002, -0.004]]
MOVED = {"on": "upper zmax", "displacement": PATH}
MEASURED = {"law": "contact", "friction": 0.3, "gap": "geometry"}


def two_parts(move=lambda x: x, cells=(4, 4, 2), upper=(4, 4, 2)) -> Mesh:
    """Two boxes of 1 × 1 × 0.5, one on the other, each with its own nodes; the upper one's are moved."""
    low, top = (bricks(np.array([1.0, 1.0, 0.5]), np.array(c), "box") for c in (cells, upper))
    count = len(low.nodes)
    surfaces = {f"lower {n}": t for n, t in low.surfaces.items()} | {f"upper {n}": t + count for n, t in top.surfaces.items()}
    return Mesh(np.r_[low.nodes, move(top.nodes + [0, 0, 0.5])], np.r_[low.cells, top.cells + count],
                np.repeat([0, 1], [len(low.cells), len(top.cells)]), ["lower", "upper"], surfaces)


def joined(mesh: Mesh) -> Mesh:
    """The same mesh with coincident nodes made one."""
    nodes, new = np.unique(np.round(mesh.nodes, 12), axis=0, return_inverse=True)
    new = new.ravel()
    return Mesh(nodes, new[mesh.cells], mesh.volume, mesh.volumes, {n: new[t] for n, t in mesh.surfaces.items()})


def made(folder, mesh, law, boundary=(HELD, MOVED), **changes):
    name = f"{len(list(folder.iterdir()))}.msh"
    return contact(law=[law], mesh=written(folder / name, mesh), subdomains="groups", boundary=list(boundary), **changes)


def problems(config):
    with pytest.raises(InputError) as caught:
        build_scene(config)
    return caught.value.problems


LAWS = {"perfect": {"law": "perfect"}, "friction": {"law": "contact", "friction": 0.3},
        "press fit": {"law": "contact", "friction": 0.3, "gap": -0.001}, "jump": {"law": "jump", "jump": [0.001, 0, 0.002]}}


@pytest.mark.parametrize("kind", ["springs", "symmetric"])
@pytest.mark.parametrize("name", LAWS)
def test_coincident_nodes_are_as_good_as_shared_ones(name, kind, tmp_path):
    """Whatever the law and the sole: the same displacement of either part, the same forces."""
    sole = {"sole": {"kind": "layer" if kind == "springs" else kind, "contact": kind}}
    method = {"tolerance": {"error": 1e-10}, "max_iterations": 1000, **sole}
    parts = two_parts()
    apart, one = (converged(made(tmp_path, m, LAWS[name], method=method)) for m in (parts, joined(parts)))
    (interface,) = apart.scene.interfaces
    assert len(interface.global_nodes) == 25 and type(interface.law) is type(one.scene.interfaces[0].law)
    for a, b, u, v in zip(apart.scene.subdomains, one.scene.subdomains, apart.parts, one.parts):
        x, y = apart.scene.mesh.nodes[a.nodes], one.scene.mesh.nodes[b.nodes]
        same = np.argmin(np.linalg.norm(x[:, None] - y, axis=2), axis=1)
        assert np.abs(u - v[:, same]).max() <= 1e-8 * 0.01
    force = np.array(one.summary["reactions"])
    assert np.abs(np.array(apart.summary["reactions"]) - force).max() <= 1e-8 * np.abs(force).max()


def test_parts_of_very_different_matter_are_judged_on_their_own_sides(tmp_path):
    """Soft below, stiff above, nodes numbered separately: each first row of cells is of one matter."""
    matter = [{"young": 1.0, "poisson": 0.3}, {"young": 200.0, "poisson": 0.3, "on": "upper"}]
    config = made(tmp_path, two_parts(), LAWS["perfect"], materials=matter, method={})
    scene = build_scene(config)
    assert not difficulty(scene).mixed_moduli.any()
    (one, other), = make_soles(scene, config.method.sole)
    assert one is other and set(one.young) == {50.0}  # half the ratio ½ of the larger modulus on each side


def test_rough_coincidence_does_not_spoil_the_solution(tmp_path):
    """Nodes off by 2e-4 h: each side's sole is on its own nodes, equilibrium holds to the tolerance."""
    config = made(tmp_path, two_parts(lambda x: x + 2e-4 * 0.25 * np.sin(37 * x[:, [1, 2, 0]])), LAWS["friction"])
    rough, plain = solve(config, build_scene(config)), converged(made(tmp_path, two_parts(), LAWS["friction"]))
    assert rough.converged
    force, exact = (np.array(s.summary["reactions"]) for s in (rough, plain))
    assert np.abs(force.sum(axis=0)).max() <= 1e-8 * np.abs(force).max()
    assert np.abs(force - exact).max() <= 1e-3 * np.abs(exact).max()


def test_measured_gap_is_that_of_a_number(tmp_path):
    """Blocks 0.003 apart: what a gap of 0.003 between touching ones gives."""
    apart = converged(made(tmp_path, two_parts(lambda x: x + [0, 0, 0.003]), MEASURED))
    number = converged(made(tmp_path, two_parts(), {**MEASURED, "gap": 0.003}))
    assert contacts(apart).gap == pytest.approx(0.003, rel=1e-9)
    assert np.array_equal(contacts(apart).status, contacts(number).status)
    for u, v in zip(apart.parts, number.parts):
        assert np.abs(u - v).max() <= 1e-8 * 0.01


def test_gap_between_curved_faces(tmp_path):
    """A wavy lower face of the upper part: the gap is its height, along the mean normal."""
    def wave(x):
        return 0.004 * (1 + np.cos(np.pi * x[:, 0]) * np.cos(np.pi * x[:, 1]))
    scene = build_scene(made(tmp_path, two_parts(lambda x: x + np.c_[0 * x[:, :2], wave(x) * (1 - 2 * (x[:, 2] - 0.5))]),
                             MEASURED))
    (interface,) = scene.interfaces
    assert interface.law.gap == pytest.approx(wave(scene.mesh.nodes[interface.global_nodes]), rel=1e-3, abs=1e-6)
    assert interface.free.all() and np.array_equal(scene.mesh.volume[interface.cells], [[0, 1]] * 32)
    high = scene.side_points(interface, 1)[:, 2]
    assert high == pytest.approx(0.5 + interface.law.gap, rel=1e-4)


def test_bodies_within_reach_are_all_found_in_their_order():
    """Boxes of random size and reach: those that a comparison of each with each finds, in the same order."""
    random = np.random.default_rng(1)
    bodies = []
    for index in range(60):
        low, room = random.uniform(0, [1, 9, 3]), random.uniform(0, 0.4)
        corners = np.stack([low, low + random.uniform(0, 1, 3), low])[None]
        bodies.append(Body(index, index, np.empty((1, 3)), np.empty(1), corners, np.empty((1, 3)), np.array([room])))
    boxes = [(b.corners.min(axis=(0, 1)), b.corners.max(axis=(0, 1)), REACH * b.size[0]) for b in bodies]
    expected = [(i, j) for i, (low, high, room) in enumerate(boxes) for j, (below, above, other) in enumerate(boxes)
                if i < j and np.maximum(low - above, below - high).max() <= max(room, other)]
    assert 20 < len(expected) < 1000
    assert [(a.subdomain, b.subdomain) for a, b in close_bodies(bodies, None)] == expected
    assert not list(close_bodies(bodies[:1], None)) and not list(close_bodies([], None))


def test_a_patch_is_connected(tmp_path):
    """Blocks that touch in two places have two interfaces."""
    notch = two_parts(lambda x: x + np.c_[0 * x[:, :2], np.where((x[:, 2] == 0.5) & (np.abs(x[:, 0] - 0.5) < 0.2), 0.02, 0.0)])
    scene = build_scene(made(tmp_path, notch, LAWS["friction"]))
    assert [(i.name, len(i.global_nodes)) for i in scene.interfaces] == [
        ("lower | upper (patch 1)", 10), ("lower | upper (patch 2)", 10)]


@pytest.mark.parametrize("change, law, words", [
    (lambda x: x + [0, 0, 2.0], MEASURED, ["nearest nodes are 2 apart", "within 0.5"]),
    (lambda x: x + [0, 0, 0.2], {**MEASURED, "within": 0.1}, ["nearest nodes are 0.2 apart", "within 0.1"]),
    (lambda x: x - [0, 0, 0.02], MEASURED, ["penetrate each other", "by up to 0.02"]),
    (lambda x: x + [0.11, 0, 0.01], MEASURED, ["do not match", "miss each other by up to 0.11"]),
], ids=["far", "within", "penetration", "sideways"])
def test_gaps_that_cannot_be_measured(change, law, words, tmp_path):
    found = problems(made(tmp_path, two_parts(change), {"between": ["lower", "upper"], **law}))
    wrong = next(p for p in found if p.path == ("interfaces", 0, "gap"))
    assert all(word in wrong.found + wrong.expected for word in words), str(wrong)


def test_numbered_gap_does_not_reach_out(tmp_path):
    found = problems(made(tmp_path, two_parts(lambda x: x + [0, 0, 0.01]),
                          {"between": ["lower", "upper"], "law": "contact", "gap": 0.01}))
    wrong = next(p for p in found if p.path[0] == "interfaces")
    assert wrong.path == ("interfaces", 0, "between")
    assert "nearest nodes are 0.01 apart" in wrong.found and "coincide within 0.00025" in wrong.found


def test_what_nothing_holds(tmp_path):
    """A part is held through its pair; without the pair it is named."""
    pushed = {"on": "upper zmax", "pressure": 1.0}
    build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, pushed)))
    (wrong,) = problems(made(tmp_path, two_parts(lambda x: x + [0, 0, 0.01]), LAWS["friction"], (HELD, pushed)))
    assert wrong.path == ("boundary",) and wrong.found.startswith("upper (one of 2 separate bodies")


def test_pairs_prescribed_on_one_side_only(tmp_path):
    side = {"on": "lower xmin", "displacement": [0, None, None]}
    (interface,) = build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, side, MOVED))).interfaces
    assert interface.free.all(), "the other side is free"
    both = {"on": {"plane": "x", "at": 0.0}, "displacement": [0, None, None]}
    scene = build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, both)))
    assert (~scene.interfaces[0].free[:, 0]).sum() == 5 and scene.interfaces[0].free[:, 1:].all()
