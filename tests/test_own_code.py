"""What a newcomer writes to add a code: one module and one registry line. Here it is a solver with an option of its own."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from method_case import CLAMP, PULL

from orchestrator.blackbox.codes.python_code import PythonCode
from orchestrator.config.load import config_from
from orchestrator.config.base import Positive
from orchestrator.errors import InputError
from orchestrator.registry import CODES
from orchestrator.run import solve
from orchestrator.scene.build import build_scene


class SoftenedCode(PythonCode):
    """Runs in a process of its own; nothing but this file and the one beside it knows it."""

    solver = f"{Path(__file__).with_name('own_solvers.py')}:Softened"

    class Settings(PythonCode.Settings):
        element: Literal["P1"] = "P1"
        softening: Positive = 1.0


@pytest.fixture
def softened():
    """The registry line, for as long as a test lasts."""
    CODES.add("softened", SoftenedCode)
    yield
    CODES.remove("softened")


def problem(blackbox) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [CLAMP, PULL], "blackbox": blackbox, "method": {"tolerance": {"error": 1e-9}}}


@pytest.mark.long
def test_a_code_with_an_option_of_its_own(softened):
    """Half the stiffness, twice the displacement; the option is in the summary's configuration, which reads back."""
    stiff, soft = (config_from(problem({"code": code, **more, "workers": 1}))
                   for code, more in (("freefem", {}), ("softened", {"softening": 2.0})))
    assert soft.blackbox.softening == 2.0 and config_from(soft.complete()) == soft
    one, two = (solve(config, build_scene(config)) for config in (stiff, soft))
    assert two.summary["converged"] and two.summary["iterations"] == one.summary["iterations"]
    assert np.abs(two.displacement - 2 * one.displacement).max() < 1e-8 * np.abs(two.displacement).max()
    assert two.summary["codes"][0]["code"] == "softened" and two.summary["config"]["blackbox"]["softening"] == 2.0


WRONG = {  # the section, key path, words of the message
    "a misspelt option": ({"code": "softened", "softning": 2.0}, ("blackbox", "softning"), "did you mean 'softening'?"),
    "an option out of range": ([{"code": "freefem"}, {"code": "softened", "softening": 0.0, "on": "slice 1"}],
                               ("blackbox", 1, "softening"), "a number > 0"),
    "an option of another code": ([{"code": "freefem", "softening": 2.0}], ("blackbox", 0, "softening"),
                                  "softening with code: softened only"),
    "an option nobody has": ({"code": "freefem", "hardening": 2.0}, ("blackbox", "hardening"),
                             "one of code, on, element, transport, workers, timeout"),
    "an element it lacks": ({"code": "softened", "element": "P2"}, ("blackbox", "element"), "expected: P1"),
    "a name nobody has": ({"code": "sofened"}, ("blackbox", "code"), "did you mean 'softened'?"),
}


@pytest.mark.parametrize("name", WRONG)
def test_its_entries_are_validated_like_all_others(name, softened):
    section, path, words = WRONG[name]
    with pytest.raises(InputError) as caught:
        config_from(problem(section))
    (found,) = caught.value.problems
    assert found.path == path and words in " ".join(str(found).split()), found


@pytest.mark.parametrize("text, transport, words", [
    ("class Mine:\n    pass", "pipe", "lonely.py has no class Solver, but Mine"), ("x = 3", "file", "lonely.py has no class Solver"),
    ("class Solver:\n    def solve(self): ...", "pipe", "class Solver of lonely.py has no method stiffness, prepare")])
@pytest.mark.long
def test_a_file_without_a_solver(tmp_path, transport, text, words):
    (tmp_path / "lonely.py").write_text(text)
    with pytest.raises(InputError) as caught:
        solve(config_from(problem({"code": str(tmp_path / "lonely.py"), "transport": transport, "workers": 1})))
    assert words in str(caught.value) and "my_solver.py:Mine" in str(caught.value) and "Traceback" not in str(caught.value)
