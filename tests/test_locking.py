"""Four-node tets of nearly incompressible matter lock: the estimated error says so, and so do warnings."""

import json
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from in_process import IN_PROCESS, TemplateSolver
from quick import quick_sets
from yaml_case import call

from orchestrator.blackbox.models import whole_model
from orchestrator.config.load import config_from
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.results.summary.summary import read_summary
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

CUBE = {"size": [10, 10, 10]}
CASES = {  # mesh without its cells, cells per direction of the coarsest, conditions
    "cantilever": ({"size": [40, 10, 10]}, (4, 1, 1), [{"on": "xmin", "displacement": [0, 0, 0]},
                                                       {"on": "xmax", "traction": [0, 0, 10]}]),
    "between plates": (CUBE, (1, 1, 1), [{"on": "zmin", "displacement": [0, 0, 0]},
                                         {"on": "zmax", "displacement": [0, 0, -0.1]}]),
    "loaded corner": (CUBE, (1, 1, 1), [{"on": "zmin", "displacement": [0, 0, 0]},
                                        {"on": {"box": [[0, 0, 10], [5, 5, 10]]}, "pressure": 100.0}]),
    "uniform tension": (CUBE, (1, 1, 1), [{"on": "xmin", "displacement": [0, None, None]},
                                          {"on": "ymin", "displacement": [None, 0, None]},
                                          {"on": "zmin", "displacement": [None, None, 0]},
                                          {"on": "xmax", "traction": [10, 0, 0]}]),
}
# (case, ν) → what the estimate may be over the truth
LIMITS = {("cantilever", 0.3): (0.9, 1.1), ("cantilever", 0.45): (0.9, 1.15), ("cantilever", 0.49): (0.9, 1.2),
          ("cantilever", 0.4999): (0.95, 1.05), ("cantilever", 0.4999999): (0.95, 1.05),
          ("between plates", 0.45): (0.9, 2.3), ("between plates", 0.4999999): (0.95, 1.05),
          ("loaded corner", 0.45): (0.9, 1.2), ("loaded corner", 0.4999999): (0.8, 1.5)}


def problem(case, n, poisson, element="P1"):
    box, cells, boundary = CASES[case]
    return {"name": "t", "mesh": {"box": {**box, "cells": [n * c for c in cells]}},
            "subdomains": {"slices": {"axis": "x", "count": 2}}, "materials": [{"young": 200e3, "poisson": poisson}],
            "boundary": boundary, "blackbox": {**IN_PROCESS, "element": element}}


def exactly_solved(case, n, poisson, element="P1"):
    """The scene, the solution (1, nodes, 3) of its elements in one piece, and ‖u‖²."""
    scene = build_scene(config_from(problem(case, n, poisson, element)))
    stiffness = sp.csc_array(TemplateSolver().stiffness(whole_model(scene)))
    free, u = np.flatnonzero(~scene.fixed.ravel()), scene.prescribed[0].ravel().copy()
    factor = spla.splu(stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
                       options={"SymmetricMode": True})
    u[free] = factor.solve((scene.loads[0].ravel() - stiffness @ u)[free])
    return scene, u.reshape(1, -1, 3), float(u @ (stiffness @ u))


@cache
def estimated(case, n, poisson, element="P1"):
    """The estimate, and ‖u‖²."""
    scene, u, energy = exactly_solved(case, n, poisson, element)
    return estimator_of(scene)([u[:, s.nodes] for s in scene.subdomains]).relative, energy


@pytest.mark.parametrize("case, poisson", quick_sets(LIMITS, *((case, nu) for case, nu in LIMITS if nu == 0.4999999)))
def test_against_a_much_better_solution(case, poisson):
    estimate, energy = estimated(case, 4 if "cantilever" not in case else 2, poisson)
    _, _, exact = exactly_solved(case, 4 if case == "loaded corner" else 3, poisson, "P2")
    truth = min(np.sqrt(abs(exact - energy) / exact), 1.0)
    low, high = LIMITS[case, poisson]
    assert low < estimate / truth < high, (estimate, truth)


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999999])
def test_uniform_stress_is_exact_whatever_the_matter(poisson):
    assert estimated("uniform tension", 2, poisson)[0] < 1e-6


def test_warnings_name_the_cure():
    def warnings(n, poisson, element="P1", case="cantilever"):
        return solve(config_from(problem(case, n, poisson, element))).summary["warnings"]

    locked = warnings(2, 0.4999)
    assert any("lock" in text and "0.4999" in text and "element: P2" in text for text in locked)
    assert any("mesh's own error" in text and "9" in text and "element: P2" in text for text in locked)
    coarse = warnings(2, 0.3)
    assert len(coarse) == 1 and "mesh's own error" in coarse[0] and "halve the element size" in coarse[0]
    assert any("P2" not in text and "halve" in text for text in warnings(1, 0.45, "P2"))
    assert warnings(2, 0.3, case="uniform tension") == []


def test_check_and_summary_say_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "rubber.yaml"
    path.write_text(json.dumps(problem("uniform tension", 2, 0.48) | {"output": {"figures": False}}))
    checked = call("check", path)
    assert checked.exit_code == 0 and "warning: Poisson's ratio 0.48" in checked.output
    done = call("run", path)
    assert done.exit_code == 0 and "Poisson's ratio 0.48" in " ".join(done.output.split()), done.output
    assert "element: P2" in read_summary(tmp_path / "results" / "t")["warnings"][0]
    path.write_text(json.dumps(problem("uniform tension", 2, 0.45)))
    assert "warning" not in call("check", path).output
