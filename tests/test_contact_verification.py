"""Contact against what shares no code with the method: a monolithic solver, closed forms, and invariances."""

import numpy as np
import pytest
from contact_case import BOTTOM, CASES, PATH, TOP, contact, contacts, converged, monolithic, start_from, two_boxes, written
from quick import late, quick
from benchmarks.monolithic import SLIP, STICK

from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.conditions.rigid import rigid_modes

YOUNG = 200e3
ROLLERS = [{"on": {"plane": axis, "at": 0.0}, "displacement": [0.0 if axis == a else None for a in "xyz"]} for axis in "xyz"]


# --- the monolithic solver --------------------------------------------------------------------------------

PROBLEMS = [("two blocks", mu) for mu in (0.0, 0.1, 0.3, 0.5)] \
    + [(name, mu) for name in ("eight cubes", "ten grains") for mu in (0.0, 0.1, 0.3)]
MORE = [("two blocks", 0.1), ("two blocks", 0.3), ("two blocks", 0.5), ("eight cubes", 0.0), ("eight cubes", 0.1),
        ("ten grains", 0.0), ("ten grains", 0.1), ("ten grains", 0.3)]


def reactions(one_piece, t, step):
    """Force on every boundary entry of a displacement."""
    nodal = one_piece.reactions(t, step.parts, step.force)
    return np.array([nodal[entry.nodes].sum(axis=0) * (entry.prescribed.fixed if entry.prescribed else False)
                     for entry in one_piece.scene.boundary])


def distance(scene, one, two, loose=False):
    """Largest difference of two displacements; if bodies are loose, apart from their rigid motions."""
    largest = 0.0
    for s, a, b in zip(scene.subdomains, one, two):
        difference = (a - b).ravel()
        if loose:
            rigid = rigid_modes(scene.mesh.nodes[s.nodes], s.fixed)
            difference = difference - rigid @ (rigid.T @ difference)
        largest = max(largest, np.abs(difference).max())
    return largest


def assert_agrees(made, loose):
    """Ours solves the independent formulation, and what that finds on its own from a cold start is the same."""
    solved = converged(made)
    scene, one_piece = solved.scene, monolithic(solved)
    ours = np.array(solved.summary["reactions"]).transpose(1, 0, 2)
    for start in (start_from(solved), None):
        for t, step in enumerate(one_piece.solve(start)):
            assert step.converged, f"the monolithic solver stops at {step.residual:.1e}"
            assert start is None or step.started <= 1e-9, f"ours leaves {step.started:.1e} in its equations"
            parts = [u[t] for u in solved.parts]
            largest = max(np.abs(u).max() for u in parts)
            assert distance(scene, parts, step.parts, loose and start is None) <= 1e-6 * largest
            theirs = reactions(one_piece, t, step)
            held = [entry.kind == "displacement" for entry in scene.boundary]
            assert np.abs(ours[t] - theirs)[held].max() <= 1e-6 * np.abs(theirs).max()


@pytest.mark.parametrize("name, friction", [late(*p) if p in MORE else p for p in PROBLEMS])
def test_monolithic_solver_agrees(name, friction):
    """Pressed, sheared, unloaded; grains that come loose stand where either solver leaves them."""
    assert_agrees(contact(friction, **CASES[name]), loose=name == "ten grains")


@pytest.mark.parametrize("friction", [0.1, 0.3])
@pytest.mark.long
def test_monolithic_solver_agrees_on_rollers(friction):
    """Interfaces that meet planes of symmetry at an angle: their nodes there are prescribed in part."""
    press = {"on": TOP, "displacement": [[None, None, z] for z in (-0.002, -0.004, -0.001)]}
    grains = {"mesh": {"polycrystal": {"grains": 6, "size": 1.0, "h": 0.25, "seed": 1}}, "subdomains": "groups"}
    assert_agrees(contact(friction, **grains, boundary=[*ROLLERS, press]), loose=True)


def test_perfect_and_contact_interfaces_meet():
    """Two layers of four glued blocks each: contact and perfect interfaces share cross points."""
    laws = [{"law": "perfect"}, {"between": ["block *-0", "block *-1"], "law": "contact", "friction": 0.3}]
    made = contact(law=laws, **CASES["eight cubes"])
    solved = converged(made)
    assert sorted({i.law.name for i in solved.scene.interfaces}) == ["contact", "perfect"]
    for t, step in enumerate(monolithic(solved).solve()):
        assert step.converged
        difference = max(np.abs(u[t] - other).max() for u, other in zip(solved.parts, step.parts))
        assert difference <= 1e-6 * max(np.abs(u).max() for u in step.parts)


# --- closed forms -----------------------------------------------------------------------------------------


def test_press_fit():
    """ν = 0, both ends held, pressed into each other by δ: p = E δ / L everywhere, strains uniform."""
    made = contact(0.2, gap=-0.001, poisson=0.0, boundary=[BOTTOM, {"on": TOP, "displacement": [0, 0, 0]}])
    solved = converged(made)
    c, pressure = contacts(solved), YOUNG * 0.001
    assert c.pressure == pytest.approx(pressure, rel=1e-8) and np.all(c.status == STICK)
    assert np.abs(c.shear).max() < 1e-8 * pressure
    assert c.opening == pytest.approx(0, abs=1e-11)
    assert np.array(solved.summary["reactions"])[:, 0] == pytest.approx(
        np.array([[0, 0, pressure], [0, 0, -pressure]]), abs=1e-7 * pressure)
    z = solved.scene.mesh.nodes[:, 2]
    for s, u in zip(solved.scene.subdomains, solved.parts):
        own = z[s.nodes]
        exact = -0.001 * own if own.max() < 0.6 else 0.001 * (1 - own)
        assert u[0, :, 2] == pytest.approx(exact, abs=1e-11) and np.abs(u[0, :, :2]).max() < 1e-11


@pytest.mark.parametrize("friction", quick([0.0, 0.3], 0.3))
def test_uniform_compression_is_that_of_one_body(friction):
    """On rollers the contact carries the bonded body's uniform stress, with or without friction."""
    press = {"on": TOP, "displacement": [[None, None, -0.001], [None, None, -0.003], [None, None, -0.002]]}
    solved = converged(contact(friction, boundary=[*ROLLERS, press]))
    for t, strain in enumerate((0.001, 0.003, 0.002)):
        for s, u in zip(solved.scene.subdomains, solved.parts):
            exact = solved.scene.mesh.nodes[s.nodes] * strain * np.array([0.3, 0.3, -1.0])
            assert u[t] == pytest.approx(exact, abs=1e-8 * strain)
        assert contacts(solved).pressure[t] == pytest.approx(YOUNG * strain, rel=1e-7)


def test_patch_of_an_irregular_contact(tmp_path):
    """A pressure on top of an irregular mesh reaches the bottom unchanged; every node carries its area's share."""
    rollers = [{**entry, "on": name} for entry, name in zip(ROLLERS, ("x", "y", "bottom"))]
    made = contact(0.1, mesh=written(tmp_path / "boxes.msh", two_boxes(0.2)), subdomains="groups",
                   boundary=[*rollers, {"on": "top", "pressure": 50.0}])
    solved = converged(made)
    c = contacts(solved)
    assert np.ptp(c.area) > 0.5 * c.area.mean(), "the mesh is irregular"
    assert c.pressure == pytest.approx(50.0, rel=1e-8) and np.abs(c.shear).max() < 50e-8
    for s, u in zip(solved.scene.subdomains, solved.parts):
        exact = solved.scene.mesh.nodes[s.nodes] * 50 / YOUNG * np.array([0.3, 0.3, -1.0])
        assert u[0] == pytest.approx(exact, abs=1e-8 * 50 / YOUNG)


def test_frictionless_contact_transmits_no_shear():
    solved = converged(contact(0.0))
    force = np.array(solved.summary["reactions"])
    assert np.abs(contacts(solved).shear).max() < 1e-9 * contacts(solved).pressure.max()
    assert np.abs(solved.iterated.local.force[:, :2]).max() == 0
    assert np.abs(force[..., :2]).max() < 1e-9 * np.abs(force).max()
    assert not np.any(solved.iterated.local.status == STICK)


FLAT = {"mesh": {"box": {"size": [4, 4, 2], "cells": [6, 6, 2]}}, "subdomains": {"grid": [1, 1, 2]},
        "materials": [{"young": YOUNG, "poisson": 0.3}]}


def slider(force, friction=0.2, **changes):
    """A flat block pressed by 100 on a block that is held, its top pulled by a traction ``force``."""
    top = {"plane": "z", "at": 2.0}
    return contact(friction, **{**FLAT, "boundary": [BOTTOM, {"on": top, "pressure": 100.0},
                                                     {"on": top, "traction": [force, 0.0, 0.0]}], **changes})


@pytest.mark.parametrize("share", quick([0.5, 0.98, 0.999], 0.98, 0.999))
def test_block_holds_below_the_threshold(share):
    """T < μN: friction balances the pull exactly; well below, some of it sticks."""
    c = contacts(converged(slider(share * 20.0)))
    assert share > 0.99 or np.any(c.status == STICK)
    total = c.force.sum(axis=1)[0]
    assert total == pytest.approx([share * 20.0 * 16, 0.0, -1600.0], abs=1e-6)


def test_block_slides_above_the_threshold():
    """T > μN has no equilibrium: nothing sticks, and the run says that it does not converge."""
    made = slider(1.001 * 20.0, method={"tolerance": {"error": 1e-6}, "max_iterations": 60})
    outcome = solve(made, build_scene(made)).iterated
    assert not outcome.converged and np.all(outcome.local.status == SLIP)


def test_sliding_block_is_pulled_by_friction_alone():
    """The top displaced further and further: T grows to μN, then stays there exactly, in every node."""
    top = {"plane": "z", "at": 2.0}
    pull = [[x, 0.0, None] for x in (1e-5, 1e-4, 5e-4, 5e-3, 5e-3 - 1e-5)]
    made = contact(0.2, **FLAT, boundary=[BOTTOM, {"on": top, "pressure": 100.0}, {"on": top, "displacement": pull}])
    c = contacts(converged(made))
    pulled = c.force.sum(axis=1)
    assert pulled[:, 2] == pytest.approx(-1600.0, rel=1e-8)
    sticking = (c.status == STICK).sum(axis=1)
    assert np.all(pulled[:2, 0] < 0.99 * 320) and np.all(sticking[:2] > 0) and sticking[3] == 0
    assert np.all(np.diff(pulled[:4, 0]) > 0)
    size = np.linalg.norm(c.shear[3], axis=1)
    assert size == pytest.approx(0.2 * c.pressure[3], rel=1e-8)
    assert (size * c.area).sum() == pytest.approx(320.0, rel=1e-9)
    assert pulled[3, 0] == pytest.approx(320.0, rel=1e-4), "directions differ a little, as the blocks bulge"
    assert sticking[4] > 0, "turning back, it sticks again"


def test_imposed_jump_is_exact():
    """What hangs on the jump moves by it beside the bonded body's solution, without further strain."""
    jump, free = np.array([0.001, -0.002, 0.003]), [BOTTOM, {"on": TOP, "traction": [5.0, 0.0, -20.0]}]
    bonded = converged(contact(law=[{"law": "perfect"}], boundary=free))
    for between, sign in ((["block 0-0-0", "block 0-0-1"], 1.0), (["block 0-0-1", "block 0-0-0"], -1.0)):
        solved = converged(contact(law=[{"between": between, "law": "jump", "jump": jump.tolist()}], boundary=free))
        for there, moved, amount in zip(bonded.parts, solved.parts, (0.0, sign)):
            assert moved - there == pytest.approx(np.broadcast_to(amount * jump, there.shape), abs=1e-10)


NOTHING = {
    "pulled apart": contact(0.1, boundary=[BOTTOM, {"on": TOP, "displacement": [0, 0, 0.001]}]),
    "gap stays open": contact(0.1, gap=0.01, boundary=[BOTTOM, {"on": TOP, "displacement": [0, 0, -0.001]}]),
    "moved by a jump": contact(law=[{"law": "jump", "jump": [0.001, -0.002, 0.003]}], boundary=[BOTTOM]),
}


@pytest.mark.parametrize("name", NOTHING)
def test_interfaces_that_carry_nothing(name):
    """No force, no strain: that is a solution like any other."""
    made = NOTHING[name]
    solved = solve(made, build_scene(made))
    assert solved.converged, solved.stop_reason
    for u in solved.parts:
        assert np.abs(u - u[:, :1]).max() < 1e-10


# --- invariances ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def boxes():
    return two_boxes()


def sheared(mesh, top, **changes):
    """Two irregular boxes from a file, held at the bottom, their top moved."""
    return contact(0.3, error=1e-9, mesh=mesh, subdomains="groups", boundary=[
        {"on": "bottom", "displacement": [0, 0, 0]}, {"on": "top", "displacement": np.asarray(top).tolist()}], **changes)


@pytest.fixture(scope="module")
def plain(boxes, tmp_path_factory):
    path = tmp_path_factory.mktemp("boxes")
    return converged(sheared(written(path / "boxes.msh", boxes), PATH))


def same(one, two, turn=np.eye(3), length=1.0, order=None):
    """Statuses, displacement and resultants of ``two`` are those of ``one``, turned, stretched and renumbered."""
    order = np.arange(len(one.scene.mesh.nodes)) if order is None else order
    moved = one.displacement @ turn.T * length
    assert np.abs(two.displacement[:, order] - moved).max() <= 1e-7 * np.abs(moved).max()
    force = np.array(one.summary["reactions"]) @ turn.T
    assert np.abs(np.array(two.summary["reactions"]) - force).max() <= 1e-7 * np.abs(force).max()
    first, second = contacts(one), contacts(two)
    at = np.argmin(np.linalg.norm(first.points @ turn.T * length - second.points[:, None], axis=2), axis=1)
    assert sorted(at) == list(range(len(at))) and np.array_equal(second.status, first.status[:, at])
    for a, b, c in zip(one.scene.subdomains, one.parts, two.parts):
        place = one.scene.mesh.nodes[a.nodes] @ turn.T * length
        there = two.scene.mesh.nodes[two.scene.subdomains[a.index].nodes]
        match = np.argmin(np.linalg.norm(place - there[:, None], axis=2), axis=1)
        assert np.abs(c - (b @ turn.T * length)[:, match]).max() <= 1e-7 * np.abs(moved).max()


def test_rotated_scene(boxes, plain, tmp_path):
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    turned = Mesh(boxes.nodes @ turn.T, boxes.cells, boxes.volume, boxes.volumes, boxes.surfaces)
    same(plain, converged(sheared(written(tmp_path / "turned.msh", turned), PATH @ turn.T)), turn)


def test_renumbered_mesh(boxes, plain, tmp_path):
    generator = np.random.default_rng(5)
    order, shuffled = generator.permutation(len(boxes.nodes)), generator.permutation(len(boxes.cells))
    nodes = np.empty_like(boxes.nodes)
    nodes[order] = boxes.nodes
    renumbered = Mesh(nodes, order[boxes.cells][shuffled], boxes.volume[shuffled], boxes.volumes,
                      {name: order[triangles] for name, triangles in boxes.surfaces.items()})
    same(plain, converged(sheared(written(tmp_path / "renumbered.msh", renumbered), PATH)), order=order)


def test_metres_instead_of_millimetres(boxes, plain, tmp_path):
    mesh = {**written(tmp_path / "boxes.msh", boxes), "scale": 1e-3}
    same(plain, converged(sheared(mesh, 1e-3 * np.array(PATH), materials=[{"young": YOUNG * 1e6, "poisson": 0.3}])),
         length=1e-3)


def test_two_workers_of_freefem(boxes, plain, tmp_path):
    same(plain, converged(sheared(written(tmp_path / "boxes.msh", boxes), PATH, blackbox={"workers": 2})))
