"""The estimate of ten-node tets by a problem in each: zero where they hold the solution, else near the truth."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from test_discretisation import bent

from orchestrator.config.load import config_from
from orchestrator.method.stopping.element_problems import ElementProblems
from orchestrator.scene.build import build_scene
from orchestrator.solving import solve

P2 = {"output": {"figures": False}, "blackbox": {**IN_PROCESS, "element": "P2"}}


def solved(problem):
    config = config_from({"name": "t", **problem, **P2})
    return solve(config, build_scene(config))


def test_a_force_that_varies_within_tets():
    """A block that spins and is not narrower for being longer: ‖u‖² = Σ ∫ (ρω²(L² − x²)/2)²/E over its lengths L."""
    size, young = [4.0, 1.0, 1.0], 1000.0
    held = [{"on": f"{axis}min", "displacement": [0 if k == i else None for k in range(3)]} for i, axis in enumerate("xyz")]
    run = solved({"mesh": {"box": {"size": size, "cells": [6, 2, 2]}}, "subdomains": {"grid": [2, 1, 1]},
                  "materials": [{"young": young, "poisson": 0.0, "density": 1.0}], "loads": [{"spin": {"axis": "z", "rate": 1.0}}],
                  "boundary": held, "method": {"tolerance": {"error": 1e-8}}})
    corners = run.scene.mesh.nodes[run.scene.mesh.cells[:, :4]]
    assert run.scene.body_force[0] == pytest.approx(corners * [1, 1, 0], abs=1e-11)
    exact = sum(length**5 * 2 / 15 / young * 4.0 / length for length in size[:2])
    true = np.sqrt(1 - 2 * run.summary["energy"][0] / exact)
    assert 0.7 < ElementProblems.of(run.scene)(run.sides).relative / true < 1.4


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
