"""Other codes than FreeFEM: what they answer alone, and mixed in one run."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from blackbox_case import assemble, box, difference, forces, settings
from quick import quick

from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.load import config_from, load_config
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

ROOT = Path(__file__).parents[1]
TEMPLATE = str(ROOT / "orchestrator" / "blackbox" / "codes" / "template.py")
CODES = {"calculix": {"code": "calculix", "transport": "file"}, "scikit-fem": {"code": "scikit-fem"},
         "template": {"code": TEMPLATE}}


@pytest.mark.parametrize("name", quick(CODES, "calculix"))
def test_numbers_are_freefems(name):
    """Stiffness, fields and traces to 1e-12: CalculiX reads 14 digits, and gives its doubles away unrounded."""
    models = [box((3, 2, 2), "a"), box((2, 2, 3), "b", seed=1)]
    some = {i: forces(m) for i, m in enumerate(models)}
    every = {i: np.random.default_rng(i).standard_normal((2, m.fixed.size)) for i, m in enumerate(models)}
    answers = []
    for changes in ({}, CODES[name]):
        with make_blackbox(settings(**changes)) as blackbox:
            blackbox.load(models)
            answers.append((blackbox.fields(every), blackbox.traces(some), dict(enumerate(blackbox.stiffness(models)))))
            assert blackbox.usage.clock()["solve"] > 0 and blackbox.usage.memory_peak_mb() > 10
    for expected, found in zip(*answers):
        for i in range(len(models)):
            assert difference(found[i], expected[i]) < 1e-12
    assert difference(answers[1][2][0], assemble(models[0])) < 1e-12


@pytest.mark.long
def test_a_failure_of_one_code_ends_all(tmp_path):
    """The error names the subdomain; no process of any code goes on."""
    path = tmp_path / "moody.py"
    path.write_text("from orchestrator.blackbox.codes import template\n\nclass Solver(template.Solver):\n"
                    "    def solve(self, prepared, forces):\n        assert len(forces) != 2, 'not two'\n"
                    "        return super().solve(prepared, forces)\n")
    models = [box(name="calm"), box(name="moody")]
    models[1].code = 1
    with make_blackbox([settings(), settings(code=f"{path}:Solver")]) as blackbox:
        blackbox.load(models)
        pids = blackbox.usage.pids()
        with pytest.raises(BlackBoxError, match="not two") as caught:
            blackbox.traces({i: forces(m, 2) for i, m in enumerate(models)})
        assert caught.value.subdomain == "moody" and "exception" in caught.value.exit_code_meaning
        assert len(pids) == 2 and blackbox.usage.pids() == []
        with pytest.raises(BlackBoxError, match="ended after a failure|is closed"):
            blackbox.traces({0: forces(models[0])})


WRONG = {  # the blackbox section, key path, words of the message
    "unknown code": ([{"code": "abaqus"}], ("blackbox", 0, "code"), "or your own solver: solver.py"),
    "pipe with calculix": ({"code": "calculix", "transport": "pipe"}, ("blackbox", "transport"), "ends after every run"),
    "two elements": ([{"code": "freefem"}, {"code": "freefem", "element": "P2", "on": "slice 1"}],
                     ("blackbox", 1, "element"), "the same element"),
    "no entry": ([], ("blackbox",), "or a list of such"),
    "unknown key": ([{"cod": "freefem"}], ("blackbox", 0, "cod"), "did you mean 'code'?"),
    "on nothing": ([{"code": "freefem"}, {"code": "calculix", "on": "slise 1"}], ("blackbox", 1, "on"), "did you mean slice"),
    "subdomains left": ([{"code": "freefem", "on": "slice 1"}], ("blackbox",), "no entry for slice 0, slice 2"),
    "P2 in calculix": ({"code": "calculix", "element": "P2"}, ("blackbox", "element"), "expected: P1"),
    "no such file": ([{"code": "freefem"}, {"code": "mine.py", "on": "slice 1"}], ("blackbox", 1, "code"), "template.py"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_sections(name):
    section, path, words = WRONG[name]
    data = {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
            "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [1, 0, 0]}], "blackbox": section}
    with pytest.raises(InputError) as caught:
        config = config_from(data)
        solve(config, build_scene(config))
    (problem,) = caught.value.problems
    assert problem.path == path and words in str(problem), problem


def test_a_solver_beside_the_yaml_file(tmp_path):
    """Found there, wherever the program is started."""
    shutil.copy(TEMPLATE, tmp_path / "mine.py")
    (tmp_path / "bar.yaml").write_text((ROOT / "configs" / "two_codes.yaml").read_text().replace("calculix", "mine.py:Solver"))
    assert load_config(tmp_path / "bar.yaml").config.codes[1].code == f"{tmp_path}/mine.py:Solver"
