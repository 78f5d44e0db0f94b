"""A run that stops says what to do; that it helps is tried."""

import re
from pathlib import Path

import pytest
from boxes import boxed
from contact_case import contact
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
def test_a_tolerance_below_rounding():
    """The one that is named is met."""
    _, advice = stopped(bonded(tolerance={"error": 1.0000001e-11}), "stagnated at rounding")
    named = float(re.search(r"method\.tolerance\.error=([0-9.e-]+)", advice[0])[1])
    assert 1.0000001e-11 < named < 1e-8 and solve(bonded(tolerance={"error": named})).converged


def test_nothing_to_say_after_convergence():
    assert solve(bonded()).summary["advice"] == []


@pytest.mark.parametrize("reason", CAUSES)
def test_documented(reason):
    text = (Path(__file__).parents[1] / "docs" / "running.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith(f"| `{reason}"))
    cures = row.split("|")[3]
    assert len(cures) > 50 and "`" in cures


def test_every_stop_has_its_causes():
    assert set(re.findall("^- ``(.+?)``", ending.__doc__, re.MULTILINE)) == {"converged", *CAUSES} - {"guard", "check"}


def test_what_flies_off_is_no_fault_of_the_code():
    """A block beside a thin plate, pushed off it: so far away that rounding breaks guards, the run still says why it has stopped."""
    flung = {"name": "t", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
             "parts": [boxed("plate", [1, 3, 0.1], [1, 3, 1]), boxed("block", [3, 3, 3], [3, 3, 3], [-3, 0, -0.3])],
             "interfaces": [{"law": "contact", "friction": 0.1}], "loads": [{"on": "block", "body_force": [0, -20, 20]}],
             "boundary": [{"on": "plate/zmin", "displacement": [0, 0, 0]}, {"on": "plate/ymin", "traction": [0, -100, 200]}]}
    solution, advice = stopped(config_from(flung), "limit load")
    assert any("block" in text and "hold" in text for text in advice), advice
