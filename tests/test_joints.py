"""Joints of very different load in one scene: each is judged by what it carries itself."""

import numpy as np
from boxes import boxed
from in_process import IN_PROCESS

from orchestrator import config_from, solve

LESS = 1e-3  # what the light joint's top is moved by, over the heavy one's


def piles(tolerance, which=("heavy", "light")):
    """Two piles of two blocks apart from each other: one pressed hard without friction, one pressed and sheared a thousandth of it with friction."""
    place, path = {"heavy": 0.0, "light": 10.0}, {"heavy": [0.0, 0.0, -0.005], "light": [0.004 * LESS, 0.002 * LESS, -0.005 * LESS]}
    parts = [boxed(f"{pile} {side}", [1, 1, 0.5], [4, 4, 2], [0, 0, place[pile] + 0.5 * (side == "top")])
             for pile in which for side in ("base", "top")]
    return config_from({
        "name": "piles", "parts": parts, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "z", "at": place[pile] + height}, "displacement": moved}
                     for pile in which for height, moved in ((0, [0, 0, 0]), (1, path[pile]))],
        "interfaces": [{"between": [f"{pile} base", f"{pile} top"], "law": "contact", "friction": 0.4 * (pile == "light")}
                       for pile in which],
        "blackbox": IN_PROCESS, "method": {"tolerance": tolerance}, "output": {"fields": False, "figures": False}})


def light_force(solved):
    """(T, 3) what the joint with friction carries."""
    which, = (k for k, i in enumerate(solved.scene.interfaces) if i.law.friction)
    return solved.resultants.force[:, which]


def test_a_light_joint_is_judged_by_its_own_forces_beside_a_heavy_one():
    both, alone = solve(piles({"law": 1e-3})), solve(piles({"law": 1e-3}, ["light"]))
    exact = light_force(solve(piles({"law": 1e-9}, ["light"])))
    off = [np.abs(light_force(solved) - exact).max() / np.abs(exact).max() for solved in (both, alone)]
    assert both.converged and both.summary["residuals"]["body_residual"] <= 1e-3 and max(off) <= 1e-3
    assert both.iterations <= 2 * alone.iterations  # the acceleration has the heavy one in view
    # by the forces of all joints together it would have ended before
    met = np.array([event.laws["body_residual"] for event in both.iterated.history]) > 1e-3
    assert met[-2] and both.summary["residuals"]["interface_residual"] < 1e-5
