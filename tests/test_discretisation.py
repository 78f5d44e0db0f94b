"""The estimated discretisation error against the true one, and the tolerance that follows it."""

from functools import cache

import numpy as np
import pytest
from in_process import IN_PROCESS

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
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
def test_cells_add_up_and_units_do_not_matter():
    run, other = cantilever(2.5), solved({**bent(2.5), "materials": [{"young": 200e9, "poisson": 0.3}]})
    cells = run.fields.discretisation_error
    assert cells.shape == (1, len(run.scene.mesh.cells)) and (cells >= 0).all()
    assert np.sqrt((cells**2).sum()) == pytest.approx(run.summary["discretisation_error"])
    assert other.summary["discretisation_error"] == pytest.approx(run.summary["discretisation_error"], rel=1e-6)


@of_the_cantilever
def test_stops_at_a_fraction_of_the_estimate():
    fixed, auto = cantilever(2.5, 1e-7), cantilever(2.5)
    estimate, summary = auto.summary["discretisation_error"], auto.summary
    assert estimate == pytest.approx(fixed.summary["discretisation_error"], rel=0.02)
    assert summary["tolerance"] == pytest.approx(0.1 * estimate)
    assert summary["error_bound"] <= summary["tolerance"] and auto.iterations < fixed.iterations
    history = auto.iterated.history
    assert history[-1].discretisation_error == pytest.approx(estimate)
    assert history[-1].target == ("error_bound", summary["tolerance"])
    assert history[-2].error_bound > history[-2].tolerance or np.isnan(history[-2].error_bound)
    estimated = len({e.discretisation_error for e in history if e.discretisation_error == e.discretisation_error})
    assert 1 <= estimated <= 3  # rarely
    tight = solved(bent(2.5, method={"tolerance": {"error": "auto", "fraction": 0.01}}))
    assert tight.summary["error_bound"] <= 0.01 * tight.summary["discretisation_error"]


def test_neither_a_number_nor_auto():
    with pytest.raises(InputError, match="auto"):
        config_from({"name": "t", **bent(5.0, "automatic")})
