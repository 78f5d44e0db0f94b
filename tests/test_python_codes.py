"""Solvers in Python: a stiffness alone, options, another interpreter, ten-node tets, what they are told of the mesh."""

import os
import subprocess
import venv
from pathlib import Path

import numpy as np
import pytest
from method_case import CLAMP, PULL

from orchestrator.config.load import config_from, load_config
from orchestrator.errors import InputError
from orchestrator.run import solve

BASE = """
import numpy as np
from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.codes.template import Solver as Template
"""
STIFFNESS = BASE + """
class Solver(Adapter):
    own_matter = True
    def __init__(self, softening=1.0, *, scale=1.0):
        self.factor = scale / softening
    def stiffness(self, model):
        return self.factor * Template().stiffness(model)
"""


def problem(blackbox, **changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [CLAMP, PULL], "blackbox": blackbox, "method": {"tolerance": {"error": 1e-9}}, **changes}


def displacement(blackbox, **changes):
    solution = solve(config_from(problem(blackbox, **changes)))
    assert solution.summary["converged"]
    return solution.displacement


def apart(one, other):
    return np.abs(one - other).max() / np.abs(other).max()


@pytest.fixture(scope="module")
def shipped():
    return displacement({"code": "freefem"})


def file(tmp_path, text) -> str:
    (tmp_path / "mine.py").write_text(text)
    return str(tmp_path / "mine.py")


@pytest.mark.long
def test_a_stiffness_alone_is_a_solver_and_takes_options(tmp_path, shipped):
    found = displacement({"code": file(tmp_path, STIFFNESS), "options": {"softening": 4.0, "scale": 2.0}, "workers": 1})
    assert apart(found, 2 * shipped) < 1e-8


@pytest.mark.long
def test_another_interpreter_needs_nothing_of_ours_installed(tmp_path, shipped):
    """One that has numpy and SciPy, but none of the orchestrator's other packages, nor the orchestrator."""
    venv.create(tmp_path / "other", symlinks=True)
    packages = next((tmp_path / "other").glob("lib/python*/site-packages"))
    here = Path(np.__file__).parents[1]
    for name in ("numpy", "numpy.libs", "scipy", "scipy.libs"):
        if (here / name).exists():
            (packages / name).symlink_to(here / name)
    python = tmp_path / "other" / "bin" / "python"
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    for module in ("pydantic", "orchestrator"):
        assert subprocess.run([python, "-c", f"import {module}"], env=alone, cwd=tmp_path, capture_output=True).returncode
    file(tmp_path, STIFFNESS)
    (tmp_path / "bar.yaml").write_text(
        "name: bar\nmesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}}\nsubdomains: {slices: {axis: x, count: 4}}\n"
        "materials: [{young: 200e3, poisson: 0.3}]\nmethod: {tolerance: {error: 1e-9}}\nboundary:\n"
        "  - {on: xmin, displacement: [0, 0, 0]}\n  - {on: xmax, traction: [10, 1, 0]}\n"
        "blackbox: {code: mine.py, python: other/bin/python, workers: 1}\n")
    assert apart(solve(load_config(tmp_path / "bar.yaml").config).displacement, shipped) < 1e-8


@pytest.mark.parametrize("python, words", [
    ("nowhere/python", "nowhere/python, which cannot be run"), ("/bin/false", "an interpreter with numpy, SciPy"),
    ("bare", "No module named 'numpy'")])
def test_interpreters_that_will_not_do_are_told(tmp_path, python, words):
    if python == "bare":
        venv.create(tmp_path / "bare", symlinks=True)
        python = str(tmp_path / "bare" / "bin" / "python")
    with pytest.raises(InputError) as caught:
        displacement({"code": file(tmp_path, STIFFNESS), "python": python, "workers": 1})
    assert words in str(caught.value) and caught.value.problems[0].path == ("blackbox", "python")
