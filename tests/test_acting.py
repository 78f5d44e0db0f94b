"""Forces and moments on a surface, rigid motions, liquids, weight and rotation: resultants, and closed forms."""

import numpy as np
import pytest

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

ELEMENTS = ("P1", "P2")


def problem(boundary, loads=(), element="P1", mesh=None, **changes) -> dict:
    return {"name": "bar", "mesh": mesh or {"box": {"size": [4, 1, 2], "cells": [4, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": 2}},
            "materials": [{"young": 200e3, "poisson": 0.0, "density": 7.85e-9}], "boundary": boundary, "loads": list(loads),
            "blackbox": {"code": "freefem", "element": element}, "method": {"tolerance": {"error": 1e-10}}, **changes}


HELD = {"on": "xmin", "displacement": [0, 0, 0]}
OBLIQUE = {"force": [3.0, -2.0, 5.0], "moment": [1.0, 4.0, -6.0], "about": [7.0, 1.5, -2.0]}


def acting(data):
    """Force and moment about the origin, per load step, of all that acts on the mesh."""
    scene = build_scene(config_from(data))
    return scene.loads.sum(axis=1), np.cross(scene.mesh.nodes, scene.loads).sum(axis=1)


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("on", ["xmax", "zmin", "y*", "*"])
def test_a_force_and_a_moment_act_as_a_whole(element, on):
    data = problem([HELD, {"on": on, "resultant": OBLIQUE, "history": "twice"}], element=element,
                   histories={"twice": [1.0, -2.0]})
    force, moment = acting(data)
    wanted = np.array(OBLIQUE["force"])
    about = np.array(OBLIQUE["moment"]) + np.cross(OBLIQUE["about"], wanted)
    assert np.allclose(force, np.outer([1, -2], wanted), rtol=0, atol=1e-12)
    assert np.allclose(moment, np.outer([1, -2], about), rtol=0, atol=1e-11)


def test_a_turning_bar_is_stretched_as_theory_says():
    """ν = 0, axis through its free end's opposite: u(L) = ρ ω² L³ / (3 E), which P2 has at the nodes."""
    data = problem([{"on": "xmin", "displacement": [0, 0, 0]}], [{"spin": {"axis": "z", "rate": 1000.0, "about": [0, 0.5, 1]}}],
                   "P2", mesh={"box": {"size": [4, 1, 2], "cells": [8, 1, 1]}})
    solution = solve(config_from(data))
    u = solution.displacement[0]
    end = np.isclose(solution.scene.mesh.nodes[:, 0], 4.0)
    # the forces across the axis widen it: they have no part in the mean of u_x where ν = 0
    assert np.isclose(u[end, 0].mean(), 7.85e-9 * 1e6 * 4**3 / (3 * 200e3), rtol=2e-3)


@pytest.mark.parametrize("element", ELEMENTS)
def test_a_rigid_motion_of_two_sides_moves_all_without_stress(element):
    motion = {"translate": [0.1, 0, -0.2], "rotate": {"axis": [1, 1, 0], "degrees": 0.3, "about": [1, 2, 3]}}
    data = problem([{"on": side, "motion": motion, "history": "half"} for side in ("xmin", "xmax")], element=element,
                   histories={"half": [0.5, 1.0]})
    solution = solve(config_from(data))
    angle = np.radians(0.3) * np.array([1, 1, 0]) / np.sqrt(2)
    exact = np.array([0.1, 0, -0.2]) + np.cross(angle, solution.scene.mesh.nodes - [1, 2, 3])
    assert np.abs(solution.displacement - np.array([0.5, 1.0])[:, None, None] * exact).max() < 1e-9
    assert np.abs(solution.reactions).max() < 1e-8 * 200e3 * np.abs(exact).max()


def test_motions_that_contradict_a_support_are_told():
    motion = {"on": "zmin", "motion": {"rotate": {"axis": "x", "degrees": 1.0}}}
    with pytest.raises(InputError, match=r"boundary\[0\] and boundary\[1\] contradict each other"):
        build_scene(config_from(problem([HELD, motion])))


WRONG = {
    "no density": (problem([HELD], [{"gravity": [0, 0, -9.81]}], materials=[{"young": 1.0, "poisson": 0.3}]),
                   ("loads", 0, "gravity"), "materials[0]"),
    "two kinds of load": (problem([HELD], [{"gravity": [0, 0, -9.81], "body_force": [0, 0, 1.0]}]), ("loads", 0, "body_force"),
                          "together"),
    "nothing": (problem([HELD, {"on": "xmax", "resultant": {"about": [0, 0, 0]}}]), ("boundary", 1, "resultant"), "neither"),
    "no axis": (problem([HELD], [{"spin": {"axis": [0, 0, 0], "rate": 1.0}}]), ("loads", 0, "spin", "axis"), "direction"),
    "a misspelt key": (problem([HELD, {"on": "xmax", "resultant": {"forces": [0, 0, 1.0]}}]),
                       ("boundary", 1, "resultant", "forces"), "force"),
    "a pressure without a place": (problem([HELD, {"on": "xmax", "pressure": {"gradient": [0, 0, 1.0]}}]),
                                   ("boundary", 1, "pressure", "at"), ""),
    "a traction and a motion": (problem([{**HELD, "motion": {"translate": [0, 0, 1.0]}}]), ("boundary", 0, "motion"),
                                "together"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_told_with_its_place(what):
    data, path, words = WRONG[what]
    with pytest.raises(InputError) as caught:
        build_scene(config_from(data))
    assert caught.value.problems[0].path == path and words in str(caught.value.problems[0])
