"""The paper's figures 7 to 11 in small: a beam in slices, and what strategy and soles do to it."""

from functools import cache

import numpy as np
import orchestrator
import pytest
from helpers import HELD, QUICK, STEEL, on, solved

ETA = 1e-5  # of the paper's indicator, where its figures compare
LAST = {"none": 100, "equilibrium": 60, "continuity": 60}  # iterations


@cache
def history(strategy: str, slices: int = 8, ratio: float = 0.03, thickness: float = 5) -> dict:
    """Return the columns of ``history.csv`` of the paper's method: relaxed, no acceleration."""
    sole = {"kind": "layer", "modulus_ratio": ratio, "thickness": thickness, "allow_extreme": True}
    config = orchestrator.config_from({
        **QUICK, "name": "beam", "mesh": {"beam": {"size": [160, 10, 10], "h": 5}},
        "subdomains": {"slices": {"axis": "x", "count": slices}}, "materials": [STEEL],
        "boundary": [{"on": on("x", 0), "displacement": HELD},
                     {"on": on("x", 160), "traction": [10, 0, 0]}],
        "method": {"sole": sole, "macro": {"strategy": strategy},
                   "search_direction": {"kplus": "full"},
                   "acceleration": "none", "relaxation": 0.8, "tolerance": {"indicator": 1e-30},
                   "max_iterations": LAST[strategy]}})
    return orchestrator.solve(config, reference=True).history


def iterations(column: str, below: float, strategy: str, *settings) -> int:
    """Return the first iteration at which a column of the history is below a value."""
    met = history(strategy, *settings)[column] < below
    return int(np.argmax(met)) + 1 if met.any() else LAST[strategy] + 1


def test_without_a_macro_problem_more_slices_take_more_iterations():
    """Figure 7a: a wave takes as many iterations as there are slices."""
    found = [iterations("indicator", ETA, "none", slices) for slices in (4, 8, 16)]
    assert found[0] * 1.5 < found[1] and found[1] * 1.5 < found[2], found


def test_equilibrium_scales():
    """Figure 7b: as many iterations whatever the number of slices, and far fewer than without."""
    found = [iterations("indicator", ETA, "equilibrium", slices) for slices in (4, 8, 16)]
    assert max(found) - min(found) <= 1, found
    assert max(found) * 2 <= iterations("indicator", ETA, "none", 4)


def test_continuity_does_not_scale():
    """Figure 7c: better than without a macro problem, but more slices take more iterations."""
    found = [iterations("indicator", ETA, "continuity", slices) for slices in (4, 8, 16)]
    assert found[0] * 1.4 < found[1] and found[1] * 1.4 < found[2], found
    assert found[2] * 2 < iterations("indicator", ETA, "none", 16)


@pytest.mark.parametrize("iteration", [1, 2])
def test_stresses_after_an_iteration(iteration):
    """Figures 8 and 9: nearly exact with equilibrium, far from it with continuity."""
    error = {strategy: history(strategy, 16)["true_error"][iteration - 1]
             for strategy in ("none", "equilibrium", "continuity")}
    assert error["equilibrium"] < 0.1 and error["continuity"] > 5 * error["equilibrium"], error
    assert error["continuity"] < error["none"]


SOFT, MIDDLE, STIFF = 0.003, 0.3, 30.0


def test_soles_softer_and_stiffer_with_equilibrium():
    """Figure 10: soft ones leave the jump behind, stiff ones the forces; amid them is a
    compromise."""
    soft, middle, stiff = (history("equilibrium", 8, ratio) for ratio in (SOFT, MIDDLE, STIFF))
    assert soft["displacement_jump"][59] > 1e3 * middle["displacement_jump"][59]
    assert stiff["force_imbalance"][59] > 1e3 * middle["force_imbalance"][59]
    assert soft["displacement_jump"][59] > 0.5 * soft["displacement_jump"][29], "it stagnates"
    assert stiff["displacement_jump"][9] < 0.1 * middle["displacement_jump"][9], "at first"
    assert middle["true_error"][59] < 1e-3 * min(soft["true_error"][59], stiff["true_error"][59])


@pytest.mark.long
def test_soles_softer_and_stiffer_with_continuity():
    """Figure 11: soft ones balance forces and the jump stagnates, stiff ones leave forces
    behind."""
    soft, middle, stiff = (history("continuity", 8, ratio) for ratio in (SOFT, MIDDLE, STIFF))
    assert soft["force_imbalance"][59] < 0.01 * middle["force_imbalance"][59]
    assert stiff["force_imbalance"][59] > 10 * middle["force_imbalance"][59]
    stays = [h["displacement_jump"][59] / h["displacement_jump"][9] for h in (soft, middle)]
    assert stays[0] > 0.5 and stays[1] < 0.1, stays


@pytest.mark.long
def test_thinner_soles_are_stiffer_springs():
    """Where soles are soft, a quarter of the thickness takes less than half the iterations."""
    thick, thin = (iterations("true_error", 1e-2, "equilibrium", 8, 0.03, h) for h in (5, 1.25))
    assert 2 * thin < thick <= LAST["equilibrium"], (thin, thick)


@pytest.mark.long
def test_a_richer_macro_basis_takes_fewer_iterations():
    """Rigid motions in place of translations balance moments too; extension and shear add
    little."""
    problem = {"name": "cubes", "mesh": {"box": {"size": [4, 4, 4], "cells": [8, 8, 8]}},
               "subdomains": {"grid": [4, 2, 2]}, "materials": [STEEL],
               "boundary": [{"on": "xmin", "displacement": HELD},
                            {"on": "xmax", "traction": [10, 0, 10]}]}
    found = {basis: solved(problem,
                           method={"macro": {"basis": basis}, "tolerance": {"error": 1e-6}})
             for basis in ("translations", "rigid", "affine", "quadratic")}
    counts = [one.iterations for one in found.values()]
    assert counts == sorted(counts, reverse=True) and counts[0] > 1.25 * counts[-1], counts
    for one in found.values():  # the basis changes the way, not the end
        assert one.energy == pytest.approx(found["affine"].energy, rel=4e-6)


def test_acceleration_changes_the_way_only():
    """Anderson's and GMRES end where the plain fixed point ends, after fewer iterations."""
    problem = {"name": "beam", "mesh": {"beam": {"size": [160, 10, 10], "h": 5}},
               "subdomains": {"slices": {"axis": "x", "count": 8}}, "materials": [STEEL],
               "boundary": [{"on": on("x", 0), "displacement": HELD},
                            {"on": on("x", 160), "traction": [10, 0, 1]}]}
    plain, *others = (solved(problem, method={"acceleration": name, "tolerance": {"error": 1e-6}})
                      for name in ("none", "anderson", "gmres"))
    for one in others:
        assert one.iterations < plain.iterations
        assert one.energy == pytest.approx(plain.energy, rel=4e-6)
        off = np.abs(one.displacement - plain.displacement).max()
        assert off <= 1e-4 * np.abs(plain.displacement).max()
