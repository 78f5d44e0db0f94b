"""Slender bodies in contact: the coarse contact problem moves them in their own softest modes."""

import numpy as np
import pytest
from contact_case import CASES, contact, monolithic
from method_case import decomposed
from quick import quick_sets

from benchmarks.problems.cantilevers import beams, tip
from orchestrator.config.model import Config
from orchestrator.method.coarse.correction import AFFINE
from orchestrator.method.linear.soft_modes import SOFT
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


def least(d):
    """Per body, the least eigenvalue θ = 1/(1 + σ) of its fields, which are orthonormal in k, and how many are soft."""
    U, V, W = d.coarse.response.U, d.coarse.response.V, d.coarse.response.W
    theta = [np.linalg.eigvalsh(W[:, part] @ V[:, part].T) for part in d.coarse.parts]
    for part in d.coarse.parts:
        assert U[:, part] @ V[:, part].T == pytest.approx(np.diag(1.0 * U[:, part].any(axis=1)), abs=1e-8)
    return np.array([[x[-AFFINE], np.sum(x > 1 / (1 + SOFT))] for x in theta])


def test_whose_modes_they_are():
    """Blocks keep their affine fields, a beam has as many of its own: softer ones."""
    for case in ("two blocks", "eight cubes"):
        config = contact(0.3, **CASES[case])
        ours, affine = (decomposed(c).coarse.response.U for c in (config, with_coarse(config, "affine")))
        assert np.array_equal(ours, affine)
    ours, affine = least(decomposed(made(20))), least(decomposed(made(20, coarse="affine")))
    assert (ours[:, 0] > affine[:, 0]).all() and (ours[:, 1] > affine[:, 1] + 2).all()


def with_coarse(config, kind):
    data = config.complete()
    return Config.model_validate({**data, "method": {**data["method"], "coarse": kind}})
