"""The estimate of ten-node tets by a problem in each: zero where they hold the solution, else near the truth."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from test_discretisation import bent, hanging, layered

from orchestrator.config.load import config_from
from orchestrator.method.stopping.element_problems import ElementProblems
from orchestrator.scene.build import build_scene
from orchestrator.solving import solve

P2 = {"output": {"figures": False}, "blackbox": {**IN_PROCESS, "element": "P2"}}


def solved(problem):
    config = config_from({"name": "t", **problem, **P2})
    return solve(config, build_scene(config))


def test_nothing_where_elements_hold_the_solution():
    run = solved(hanging(2, tolerance=1e-9))  # quadratic, under its weight: without the body force all would be error
    assert run.scene.body_force is not None and ElementProblems.of(run.scene)(run.sides).relative < 1e-7
    run.scene.body_force = None
    assert ElementProblems.of(run.scene)(run.sides).relative > 1e-2
    for law in ("perfect", "contact"):  # side by side, each stretched as it likes: no leap is taken across what may open
        run = solved(layered(law, 1e-9))
        assert ElementProblems.of(run.scene)(run.sides).relative < 1e-6


@pytest.mark.long
def test_near_the_truth():
    """Bending, and the edges of a clamped end, where stresses have no limit."""
    coarse, fine = (solved(bent(h, 1e-7)) for h in (5.0, 2.5))
    finest = 2 * solved(bent(5 / 3, 1e-6)).summary["energy"][0]
    energies = [2 * run.summary["energy"][0] for run in (coarse, fine)]
    for run, energy in zip((coarse, fine), energies):
        found = ElementProblems.of(run.scene)(run.sides)
        assert 0.7 < found.relative / np.sqrt(1 - energy / finest) < 1.7  # the finest mesh has an error too
        assert np.sqrt((found.cells**2).sum()) == pytest.approx(found.relative)
