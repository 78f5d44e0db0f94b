"""Leaps between bonded sides of ten-node tets that do not match are in the estimate."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS

from benchmarks.kit.apart import apart
from orchestrator.config.load import config_from
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.method.stopping.discretisation import leaping, leaps
from orchestrator.scene.build import build_scene
from orchestrator.solving import solve


def lap(low: list, high: list) -> dict:
    """Two plates that overlap by half, and are pulled apart; the lower one is ten times as stiff."""
    parts = [boxed(name, [20, 5, 3], cells, material={"young": young, "poisson": 0.3})
             for name, cells, young in (("low", low, 200e3), ("high", high, 20e3))]
    parts[1]["move"] = {"translate": [10, 0, 3]}
    return {"name": "lap", "parts": parts, "subdomains": "groups", "interfaces": [{"between": "auto", "law": "perfect"}],
            "boundary": [{"on": "low/xmin", "displacement": [0, 0, 0]}, {"on": "high/xmax", "traction": [10, 0, 0]}],
            "blackbox": {**IN_PROCESS, "element": "P2"}, "output": {"figures": False}, "method": {"tolerance": {"error": 1e-4}}}


def test_a_leap_that_is_the_same_everywhere():
    """η² = Σ A π/h c² E'₁E'₂/(E'₁ + E'₂), whatever the overlaps; no leap of a linear field."""
    scene = build_scene(config_from(lap([8, 2, 1], [7, 3, 1])))
    (interface,) = leaping(scene)
    leap, area = np.array([1.0, 2.0, 2.0]), (20 / 7 * 5 / 3 / 2 if scene.subdomains[interface.subdomains[0]].name == "high" else 3.125)
    at = [np.tile(side * leap, (1, len(nodes), 1)) for side, nodes in enumerate(interface.nodes)]
    cells, found = leaps(scene, interface, lambda i, side: at[side])
    modulus = 1 / (0.91 / 200e3 + 0.91 / 20e3)
    assert found.sum() == pytest.approx(50 * np.pi / np.sqrt(4 / np.sqrt(3) * area) * modulus * 9, rel=1e-9)
    assert np.array_equal(np.unique(cells), np.unique(interface.cells[:, 0]))
    linear = [(scene.side_points(interface, side) @ [[1, 2, 3], [0, 1, 0], [2, 0, 1]])[None] for side in (0, 1)]
    assert leaps(scene, interface, lambda i, side: linear[side])[1].max() < 1e-12 * found.max()


@pytest.mark.long
@pytest.mark.parametrize("low, high", [([8, 2, 2], [11, 3, 2]), ([12, 3, 2], [16, 4, 3])])
def test_what_they_add_is_true(low, high):
    finest = solve(config_from(lap([24, 6, 5], [24, 6, 5])))
    found = solve(config_from(lap(low, high)))
    estimates = [estimator_of(one.scene)(one.sides) for one in (found, finest)]
    true = np.hypot(apart(found, finest), estimates[1].relative)
    told, without = estimates[0].relative, np.sqrt(estimates[0].relative**2 - estimates[0].leaps[0])
    assert without < 0.8 * true < told < 1.1 * true
