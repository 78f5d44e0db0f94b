"""Delivered forces of an energy error: every body is in balance, however early the iterations end."""

import numpy as np
import pytest
from quick import quick
from test_certificate import FRICTIONLESS

from orchestrator import build_scene, config_from, solve

ROUGH = 1e-2  # an error far above rounding


@pytest.mark.parametrize("name", quick(["loose grains", "bonded beside", "P2"], "bonded beside"))
def test_bodies_are_in_balance(name):
    """By reactions and by what interfaces carry, to rounding, though iterations end early; nothing pulls, nothing is pressed open."""
    data = FRICTIONLESS[name]().complete()
    config = config_from({**data, "method": {**data["method"], "tolerance": {"error": ROUGH}},
                          "output": {"fields": False, "figures": False}})
    scene = build_scene(config)
    solved = solve(config, scene)
    total = np.zeros((scene.steps, len(scene.subdomains), 3))
    for k, i in enumerate(scene.interfaces):
        for sign, e in zip((1, -1), i.subdomains):
            total[:, e] += sign * solved.resultants.force[:, k]
    held = [s.fixed.any() for s in scene.subdomains]
    size = np.abs(solved.resultants.force).max()
    assert np.abs(total[:, ~np.array(held)]).max(initial=0.0) <= 1e-10 * size
    assert np.abs(total.sum(axis=1) + np.sum(solved.reactions, axis=0)).max() <= 1e-10 * size
    fields = solved.fields.interfaces
    opens = np.isin(fields.interface_of_node, np.flatnonzero(fields.laws == "contact"))
    gap, pressure = fields.gap[:, opens], fields.pressure[:, opens]
    assert pressure.min() >= 0 and gap.min() >= -1e-12 and np.abs(np.minimum(gap / 1e-2, pressure / pressure.max())).max() < 0.1
    assert np.abs(fields.friction_traction[:, opens]).max() <= 1e-12 * pressure.max()
