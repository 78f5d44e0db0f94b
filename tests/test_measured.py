"""What an estimate tells, measured by the solutions on two meshes, against an exact solution."""

import math
from dataclasses import replace

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import quick
from test_discretisation import LENGTH, WEIGHT, YOUNG, hanging, solved

from orchestrator.accuracy.measured import energies, explained, told
from orchestrator.accuracy.passes import Passes
from orchestrator.config.load import config_from
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.run import solve
from orchestrator.scene.body import Meshed
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.size_map import SizeMap, WHOLE, edge_lengths


def weighed(run):
    estimator = estimator_of(run.scene)
    found = estimator(run.sides)
    return energies(run, estimator, found), found.relative, estimator


def halved(problem, times, element="P1"):
    """Solved on a mesh whose tets have been halved until they are so many times smaller than the smallest was."""
    config = config_from({"name": "t", "output": {"figures": False}, **problem, "blackbox": {**IN_PROCESS, "element": element}})
    mesh = build_scene(config).mesh
    corners = mesh.cells[:, :4]
    sizes = SizeMap(mesh.nodes, corners, np.full(len(mesh.nodes), edge_lengths(mesh.nodes, corners).min() / times))
    return solve(config, build_scene(config, meshed=Meshed({0: {WHOLE: sizes}})))


def test_against_an_exact_solution():
    """Of a bar that hangs: an estimate that tells too little is raised to near the truth, by what two meshes tell."""
    exact = 2 * WEIGHT**2 * LENGTH**3 / (6 * YOUNG)  # ∫ σ²/E
    (coarse, _, _), (fine, error, estimator) = (weighed(solved(hanging(n, tolerance=1e-6))) for n in (2, 3))
    assert fine.solved.apart(coarse.solved, estimator) is None  # neither contains the other: by energies
    assert coarse.potential > fine.potential > -exact
    true = math.sqrt((fine.potential + exact) / exact)
    assert 0.9 < error / true < 1.2 and told(coarse, fine, estimator) == 1  # as much as there is, or more: never lowered
    less = [replace(one, estimated=0.36 * one.estimated) for one in (coarse, fine)]
    share = told(*less, estimator)
    assert share < 1 and 0.8 < 0.6 * error / share / true < 1.3
    assert told(fine, coarse, estimator) is None and told(None, fine, estimator) is None
    shaken = replace(fine, volume=0.9 * fine.volume)  # bodies that change with the mesh
    lighter = replace(fine, loads=[0.9 * x for x in fine.loads])
    assert told(coarse, shaken, estimator) is None and told(coarse, lighter, estimator) is None and explained(coarse, fine)
    assert not explained(replace(coarse, energy=4 * fine.energy), fine)


@pytest.mark.parametrize("element", quick(["P1", "P2"], "P1"))
def test_a_mesh_that_contains_the_other(element, tmp_path):
    """The distance of both solutions is that of their energies."""
    problem = hanging(1, tolerance=1e-7)
    problem["boundary"].append({"on": {"plane": "x", "at": LENGTH}, "traction": [0, 0, 1]})
    (coarse, _, _), (fine, _, estimator) = (weighed(halved(problem, times, element)) for times in (1, 2))
    apart = fine.solved.apart(coarse.solved, estimator)
    assert apart == pytest.approx(coarse.potential - fine.potential, rel=1e-6) and apart > 1e-3 * fine.energy
    Passes(before=coarse).write(tmp_path)
    kept = Passes.read(tmp_path).before
    assert told(kept, fine, estimator) == told(coarse, fine, estimator) and kept.step == coarse.step
