"""Contact against what shares no code with the method: a monolithic solver, closed forms, and invariances."""

import numpy as np
import pytest
from contact_case import BOTTOM, CASES, TOP, contact, contacts, converged, monolithic, start_from
from quick import quick, quick_sets
from benchmarks.monolithic import STICK

from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.conditions.rigid import rigid_modes

YOUNG = 200e3


# --- the monolithic solver --------------------------------------------------------------------------------

PROBLEMS = [("two blocks", mu) for mu in (0.0, 0.1, 0.3, 0.5)] \
    + [(name, mu) for name in ("eight cubes", "ten grains") for mu in (0.0, 0.1, 0.3)]


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


def assert_agrees(made, loose=False):
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


@pytest.mark.parametrize("name, friction", quick_sets(PROBLEMS, ("eight cubes", 0.3)))
def test_monolithic_solver_agrees(name, friction):
    """Pressed, sheared, unloaded; grains that come loose stand where either solver leaves them."""
    assert_agrees(contact(friction, **CASES[name]), loose=name == "ten grains")


def test_an_imposed_jump_agrees_with_one_piece():
    """Three blocks: the lowest two are moved apart, step by step, between a clamped base and a contact with friction."""
    apart = {"law": "jump", "between": ["block 0-0-0", "block 0-0-1"],
             "jump": [[0.0, 0.0, 0.002], [0.004, 0.0, 0.004], [0.004, 0.002, 0.001], [0.0, 0.0, 0.0]]}
    assert_agrees(contact(mesh={"box": {"size": [1, 1, 1], "cells": [3, 3, 6]}}, subdomains={"grid": [1, 1, 3]},
                          law=[{"law": "contact", "friction": 0.3}, apart]))


# --- closed forms -----------------------------------------------------------------------------------------


FLAT = {"mesh": {"box": {"size": [4, 4, 2], "cells": [6, 6, 2]}}, "subdomains": {"grid": [1, 1, 2]},
        "materials": [{"young": YOUNG, "poisson": 0.3}]}


def slider(force, friction=0.2, **changes):
    """A flat block pressed by 100 on a block that is held, its top pulled by a traction ``force``."""
    top = {"plane": "z", "at": 2.0}
    return contact(friction, **{**FLAT, "boundary": [BOTTOM, {"on": top, "pressure": 100.0},
                                                     {"on": top, "traction": [force, 0.0, 0.0]}], **changes})


@pytest.mark.parametrize("share", quick([0.5, 0.98, 0.999], 0.98))
def test_block_holds_below_the_threshold(share):
    """T < μN: friction balances the pull exactly; well below, some of it sticks."""
    c = contacts(converged(slider(share * 20.0)))
    assert share > 0.99 or np.any(c.status == STICK)
    total = c.force.sum(axis=1)[0]
    assert total == pytest.approx([share * 20.0 * 16, 0.0, -1600.0], abs=1e-6)


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
