"""A run that stops says what to do; that it helps is tried."""

import re
from pathlib import Path

import pytest
from boxes import boxed
from contact_case import BOTTOM, TOP, contact
from in_process import IN_PROCESS
from method_case import CLAMP, CUBES

from orchestrator.config.load import config_from
from orchestrator.method.monitors import ending
from orchestrator.results.summary.advice import CAUSES
from orchestrator.results.summary.lines import summary_rows
from orchestrator.run import solve


def bonded(poisson=0.3, **method):
    return config_from({
        "name": "t", **CUBES, "materials": [{"young": 200e3, "poisson": poisson}], "blackbox": IN_PROCESS,
        "boundary": [CLAMP, {"on": "xmax", "traction": [10.0, 1.0, 0.0]}], "method": method})


def stopped(config, reason):
    solution = solve(config)
    assert not solution.converged and solution.stop_reason == reason
    advice = solution.summary["advice"]
    assert dict(summary_rows(solution.summary))["what to do"] == "\n".join(advice)
    return solution, advice


def test_too_few_iterations():
    _, advice = stopped(bonded(0.48, max_iterations=5), "max_iterations")
    assert "--resume" in advice[0] and any("element: P2" in text for text in advice) and len(advice) == 2, advice


@pytest.mark.long
def test_as_many_more_as_it_says():
    solution, advice = stopped(contact(0.3, error=1e-6, blackbox=IN_PROCESS, method={"max_iterations": 12}), "max_iterations")
    more = int(re.search("about ([0-9]+) more iterations", advice[0])[1])
    needed = solve(contact(0.3, error=1e-6, blackbox=IN_PROCESS)).iterations - solution.iterations
    assert needed / 3 <= more <= 3 * needed
    assert any("increment=1" in text for text in advice)


def test_a_tolerance_below_rounding():
    """The one that is named is met."""
    _, advice = stopped(bonded(tolerance={"error": 1.0000001e-11}), "stagnated at rounding")
    named = float(re.search(r"method\.tolerance\.error=([0-9.e-]+)", advice[0])[1])
    assert 1.0000001e-11 < named < 1e-8 and solve(bonded(tolerance={"error": named})).converged


def test_settings_that_diverge():
    """With the defaults that are named it converges."""
    wrong = {"acceleration": "none", "relaxation": 1.0, "search_direction": {"kplus": "diagonal"}}
    _, advice = stopped(bonded(**wrong, macro={"strategy": "none"}), "diverged")
    assert advice[0].startswith("settings differ")
    for key in ("acceleration=anderson", "relaxation=auto", "macro.strategy=equilibrium", "search_direction.kplus=exchange"):
        assert f"--set method.{key}" in advice[0]
    assert any("not held" in text for text in advice) and any("conformance in-process" in text for text in advice)


@pytest.mark.long
def test_what_contact_adds():
    high = [BOTTOM, {"on": TOP, "displacement": [[0, 0, -5e-3], [2e-2, 0, -5e-3]]}]
    _, advice = stopped(contact(1.5, blackbox=IN_PROCESS, boundary=high, method={"max_iterations": 3}), "max_iterations")
    assert any("friction 1.5" in text and "lower it" in text for text in advice)
    apart = [BOTTOM, {"on": {"plane": "x", "at": 0}, "displacement": [0, None, None]}, {"on": TOP, "traction": [0, 0, 1e-3]}]
    _, advice = stopped(contact(0.3, blackbox=IN_PROCESS, boundary=apart, method={"max_iterations": 2}), "limit load")
    assert any("block 0-0-1" in text and "hold" in text for text in advice)


def test_nothing_to_say_after_convergence():
    assert solve(bonded()).summary["advice"] == []


@pytest.mark.parametrize("reason", CAUSES)
def test_documented(reason):
    text = (Path(__file__).parents[1] / "docs" / "running.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith(f"| `{reason}"))
    cures = row.split("|")[3]
    assert len(cures) > 50 and "`" in cures


def test_every_stop_has_its_causes():
    assert set(re.findall("^- ``(.+?)``", ending.__doc__, re.MULTILINE)) == {"converged", *CAUSES} - {"guard"}


def test_flat_subdomains():
    """Cut as it says, the same plate converges."""
    plate = {"name": "t", "mesh": {"box": {"size": [4, 4, 0.16], "cells": [8, 8, 4]}}, "materials": [{"young": 200e3, "poisson": 0.3}],
             "subdomains": {"grid": [2, 2, 4]}, "blackbox": IN_PROCESS,
             "boundary": [CLAMP, {"on": "xmax", "traction": [10.0, 0.0, 10.0]}], "method": {"max_iterations": 12}}
    _, advice = stopped(config_from(plate), "max_iterations")
    grid = next(re.search(r"\{grid: (\[.*?\])\}", text) for text in advice if "grid" in text)[1]
    assert grid == "[4, 4, 1]"
    assert solve(config_from({**plate, "subdomains": {"grid": [4, 4, 1]}, "method": {"max_iterations": 40}})).converged


def test_what_flies_off_is_no_fault_of_the_code():
    """A block beside a thin plate, pushed off it: so far away that rounding breaks guards, the run still says why it has stopped."""
    flung = {"name": "t", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
             "parts": [boxed("plate", [1, 3, 0.1], [1, 3, 1]), boxed("block", [3, 3, 3], [3, 3, 3], [-3, 0, -0.3])],
             "interfaces": [{"law": "contact", "friction": 0.1}], "loads": [{"on": "block", "body_force": [0, -20, 20]}],
             "boundary": [{"on": "plate/zmin", "displacement": [0, 0, 0]}, {"on": "plate/ymin", "traction": [0, -100, 200]}]}
    solution, advice = stopped(config_from(flung), "limit load")
    assert any("block" in text and "hold" in text for text in advice), advice
