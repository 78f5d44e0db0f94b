"""The estimated discretisation error against the true one, and the tolerance that follows it."""

import csv
import json
from functools import cache

import meshio
import numpy as np
import pytest
from in_process import FREEFEM, IN_PROCESS
from yaml_case import call

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method.monitors.mesh_error import LEAST
from orchestrator.method.stopping.element_problems import estimator_of
from orchestrator.results.fields.npz import read_npz
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

YOUNG, WEIGHT, LENGTH = 1000.0, 3.0, 4.0
of_the_cantilever = pytest.mark.xdist_group("cantilever")  # which is solved once for several tests


def solved(problem, **more):
    config = config_from({"name": "t", "output": {"figures": False}, "blackbox": IN_PROCESS, **problem, **more})
    return solve(config, build_scene(config))


def hanging(n, subdomains=None, tolerance="auto", young=YOUNG):
    """A bar that hangs by its end: u = (ρg/E)(L x − x²/2), no lateral contraction."""
    return {
        "mesh": {"box": {"size": [LENGTH, 1, 1], "cells": [4 * n, n, n]}},
        "subdomains": subdomains or {"grid": [2, 1, 1]}, "materials": [{"young": young, "poisson": 0.0}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}],
        "loads": [{"body_force": [WEIGHT, 0, 0]}], "method": {"tolerance": {"error": tolerance}},
    }


def bent(h, tolerance="auto", **more):
    return {
        "mesh": {"beam": {"size": [40, 10, 10], "h": h}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 40}, "traction": [0, 0, 10]}],
        "method": {"tolerance": {"error": tolerance}}, **more,
    }


def test_against_an_exact_solution():
    exact = 2 * WEIGHT**2 * LENGTH**3 / (6 * YOUNG)  # ∫ σ²/E over the bar
    estimates, errors = [], []
    for n in (2, 4, 8):
        run = solved(hanging(n, tolerance=1e-8))
        errors.append(np.sqrt(1 - 2 * run.summary["energy"][0] / exact))
        estimates.append(run.summary["discretisation_error"])
    ratio = np.array(estimates) / errors
    assert (0.5 < ratio).all() and (ratio < 2).all()
    orders = np.log2(np.array([estimates, errors])[:, :-1] / np.array([estimates, errors])[:, 1:])
    assert (0.75 < orders).all() and (orders < 1.25).all()


@cache
def cantilever(h, tolerance="auto"):
    return solved(bent(h, tolerance))


@of_the_cantilever
def test_bending():
    coarse, middle, fine = (cantilever(h, 1e-7) for h in (5.0, 2.5, 1.25))
    energies = [2 * r.summary["energy"][0] for r in (coarse, middle, fine)]
    rate = (energies[1] - energies[0]) / (energies[2] - energies[1])
    exact = energies[2] + (energies[2] - energies[1]) / (rate - 1)  # Richardson
    for run, energy in zip((middle, fine), energies[1:]):
        assert 0.5 < run.summary["discretisation_error"] / np.sqrt(1 - energy / exact) < 2


def test_ten_node_tets():
    p2 = {"blackbox": {**FREEFEM, "element": "P2"}}
    runs = [solved(bent(h, 1e-7, **p2)) for h in (10.0, 5.0)]
    exact = 2 * solved(bent(2.5, 1e-4, **p2)).summary["energy"][0]
    for run in runs:
        ratio = run.summary["discretisation_error"] / np.sqrt(1 - 2 * run.summary["energy"][0] / exact)
        assert 0.7 < ratio < 1.5
    hanging_bar = solved({**hanging(2, tolerance=1e-8), **p2})
    assert hanging_bar.summary["discretisation_error"] < 1e-6  # quadratic: these elements hold the solution


@of_the_cantilever
def test_cells_add_up_and_units_do_not_matter():
    run, other = cantilever(2.5), solved({**bent(2.5), "materials": [{"young": 200e9, "poisson": 0.3}]})
    cells = run.fields.discretisation_error
    assert cells.shape == (1, len(run.scene.mesh.cells)) and (cells >= 0).all()
    assert np.sqrt((cells**2).sum()) == pytest.approx(run.summary["discretisation_error"])
    assert other.summary["discretisation_error"] == pytest.approx(run.summary["discretisation_error"], rel=1e-6)


def layered(law, tolerance="auto"):
    """Two layers of different moduli, squeezed: the stress jumps at the interface along the layers only."""
    return {
        "mesh": {"box": {"size": [2, 1, 2], "cells": [4, 2, 4]}}, "subdomains": {"grid": [1, 1, 2]},
        "materials": [{"young": 1000.0, "poisson": 0.3}], "interfaces": [{"law": law}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [None, None, 0]},
                     {"on": {"plane": "x", "at": 0}, "displacement": [0, None, None]},
                     {"on": {"plane": "y", "at": 0}, "displacement": [None, 0, None]},
                     {"on": {"plane": "z", "at": 2}, "displacement": [None, None, -0.01]}],
        "method": {"tolerance": {"error": tolerance}},
    }


def test_true_jumps_are_no_errors():
    scene, bonded, other = (build_scene(config_from({"name": "t", **layered(law)})) for law in ("contact", "perfect", "perfect"))
    # the lower layer is stretched, the upper one is not: stresses differ, each is uniform
    sides = [scene.mesh.nodes[s.nodes][None] * [0.01 * (s.index == 0), 0, 0] for s in scene.subdomains]
    assert estimator_of(scene)(sides).relative < 1e-12
    assert estimator_of(bonded)(sides).relative > 0.1
    other.materials = [other.materials[0], type(other.materials[0])(500.0, 0.3)]
    other.cell_material = other.cell_subdomain
    assert estimator_of(other)(sides).relative < 1e-12


@of_the_cantilever
def test_stops_at_a_fraction_of_the_estimate():
    fixed, auto = cantilever(2.5, 1e-7), cantilever(2.5)
    estimate, summary = auto.summary["discretisation_error"], auto.summary
    assert estimate == pytest.approx(fixed.summary["discretisation_error"], rel=0.02)
    assert summary["tolerance"] == pytest.approx(0.1 * estimate)
    assert summary["error_bound"] <= summary["tolerance"] and auto.iterations < fixed.iterations
    history = auto.iterated.history
    assert np.isnan(history[0].discretisation_error) and history[-1].discretisation_error == pytest.approx(estimate)
    assert history[-1].target == ("error_bound", summary["tolerance"])
    assert history[-2].error_bound > history[-2].tolerance or np.isnan(history[-2].error_bound)
    estimated = len({e.discretisation_error for e in history if e.discretisation_error == e.discretisation_error})
    assert 1 <= estimated <= 3  # rarely
    tight = solved(bent(2.5, method={"tolerance": {"error": "auto", "fraction": 0.01}}))
    assert tight.summary["error_bound"] <= 0.01 * tight.summary["discretisation_error"]


def test_exact_in_the_elements():
    """Uniform tension: nothing to estimate, and the tolerance does not follow it down to rounding."""
    problem = {**layered("perfect"), "subdomains": {"grid": [2, 1, 2]}}
    run = solved(problem)
    assert run.converged and run.summary["tolerance"] == LEAST
    assert run.summary["discretisation_error"] < 1e-6


def contact(tolerance):
    return {
        "mesh": {"box": {"size": [10, 10, 20], "cells": [4, 4, 8]}}, "subdomains": {"grid": [1, 1, 2]},
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "friction": 0.3}],
        "boundary": [{"on": "zmin", "displacement": [0, 0, 0]},
                     {"on": "zmax", "displacement": [[0, 0, -0.01], [0.002, 0, -0.01], [0.006, 0, -0.012]]}],
        "method": {"tolerance": {"error": tolerance}},
    }


def test_contact():
    auto, exact = solved(contact("auto")), solved(contact(1e-9))
    estimate = auto.summary["discretisation_error"]
    assert auto.converged and auto.iterations < exact.iterations
    assert estimate == pytest.approx(exact.summary["discretisation_error"], rel=0.02)
    assert auto.iterated.last.target == ("error_bound", auto.summary["tolerance"])
    estimator = estimator_of(exact.scene)
    size, gap = (max(estimator.energy(sides)) for sides in (
        exact.sides, [a - b for a, b in zip(auto.sides, exact.sides)]))
    assert np.sqrt(gap / size) < 0.1 * estimate


def test_steps_in_batches():
    problem = contact("auto")
    run = solved({**problem, "method": {**problem["method"], "increment": 1}})
    assert run.converged and 0 < run.summary["discretisation_error"] < 1


@pytest.mark.long
def test_files(tmp_path):
    path, output = tmp_path / "bent.yaml", tmp_path / "out"
    path.write_text(json.dumps({"name": "bent", **bent(5.0), "output": {"directory": str(output), "figures": False}}))
    done = call("run", path)
    assert done.exit_code == 0, done.output
    assert "estimated discretisation error" in " ".join(done.stdout.split())
    summary = json.loads((output / "summary.json").read_text())
    with open(output / "history.csv") as file:
        last = list(csv.DictReader(file))[-1]
    assert float(last["tolerance"]) == summary["tolerance"]
    fields = read_npz(output)
    assert np.sqrt((fields.discretisation_error**2).sum()) == pytest.approx(summary["discretisation_error"])
    cells = meshio.read(output / "fields" / "step_0001.vtu").cell_data["discretisation_error"][0]
    assert np.array_equal(cells, fields.discretisation_error[0])
    done = call("report", output)
    assert done.exit_code == 0 and "η_h" in (output / "report.md").read_text()


def test_neither_a_number_nor_auto():
    with pytest.raises(InputError, match="auto"):
        config_from({"name": "t", **bent(5.0, "automatic")})


@pytest.mark.parametrize("end", [{"traction": [0, 0, 10]}, {"displacement": [0, 0, 1]}])
def test_relative_to_the_exact_energy(end):
    """A coarse mesh is too stiff: loads do too little work on it, displacements that are prescribed too much."""
    def run(h, **more):
        problem = bent(h, 1e-7, **more)
        problem["boundary"][1] = {"on": {"plane": "x", "at": 40}, **end}
        return solved(problem)

    coarse, fine = run(5.0), run(5.0, blackbox={**IN_PROCESS, "element": "P2"})
    energy, exact = (estimator_of(r.scene).energy(r.sides)[0] for r in (coarse, fine))
    assert (energy < 0.6 * exact) if "traction" in end else (energy > 1.5 * exact)
    assert 0.8 < coarse.summary["discretisation_error"] / min(np.sqrt(abs(exact - energy) / exact), 1.0) < 1.25
