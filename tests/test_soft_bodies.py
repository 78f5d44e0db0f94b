"""Slender bodies in contact: the coarse contact problem moves them in their own softest modes."""

import pytest
from contact_case import monolithic
from quick import quick_sets

from benchmarks.problems.cantilevers import beams, tip
from orchestrator.config.model import Config
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from in_process import IN_PROCESS


def made(length, friction=0.5, element="P1", **method):
    problem = beams(length, friction, element, across=1)
    return Config.model_validate({**problem, "blackbox": {**IN_PROCESS, "element": element}, "method": {**problem["method"], **method}})


@pytest.mark.parametrize("length, friction, element", quick_sets([
    (5, 0.5, "P1"), (20, 0.0, "P1"), (20, 0.5, "P1"), (40, 0.5, "P1"), (10, 0.5, "P2"), (20, 0.5, "P2")], (5, 0.5, "P1"), (20, 0.5, "P1")))
def test_clamped_beams_on_each_other(length, friction, element):
    solved = solve(config := made(length, friction, element), build_scene(config))
    assert solved.converged and solved.iterations <= 40
    whole = monolithic(solved).solve()[-1]
    assert tip([u[-1] for u in solved.parts], solved.scene) == pytest.approx(tip(whole.parts, solved.scene), rel=1e-2)
