"""Other codes than FreeFEM: what they answer alone, and mixed in one run."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from blackbox_case import assemble, box, difference, forces, settings
from method_case import CUBES, solved

from orchestrator.blackbox.registry import make_blackbox
from orchestrator.errors import BlackBoxError, InputError

ROOT = Path(__file__).parents[1]
TEMPLATE = str(ROOT / "orchestrator" / "blackbox" / "template.py")
CODES = {"calculix": {"code": "calculix", "transport": "file"}, "scikit-fem": {"code": "scikit-fem"},
         "template": {"code": TEMPLATE}}


@pytest.mark.parametrize("name", CODES)
def test_numbers_are_freefems(name):
    """Stiffness, fields and traces to 1e-12: CalculiX reads 14 digits, and gives its doubles away unrounded."""
    models = [box((3, 2, 2), "a"), box((2, 2, 3), "b", seed=1)]
    some = {i: forces(m) for i, m in enumerate(models)}
    every = {i: np.random.default_rng(i).standard_normal((2, m.fixed.size)) for i, m in enumerate(models)}
    answers = []
    for changes in ({}, CODES[name]):
        with make_blackbox(settings(workers=2, **changes)) as blackbox:
            blackbox.load(models)
            answers.append((blackbox.fields(every), blackbox.traces(some), dict(enumerate(blackbox.stiffness(models)))))
            assert blackbox.clock()["solve"] > 0 and blackbox.memory_peak_mb() > 10
    for expected, found in zip(*answers):
        for i in range(len(models)):
            assert difference(found[i], expected[i]) < 1e-12
    assert difference(answers[1][2][0], assemble(models[0])) < 1e-12


@pytest.mark.parametrize("code", ["freefem", "calculix"])
def test_the_compliance_takes_the_place_of_runs(code):
    """Asked again and again, a code that ends after every run is asked for its compliance, once; answers stay."""
    model = box((3, 3, 3), "cube")
    with make_blackbox(settings()) as blackbox:
        blackbox.load([model])
        first = blackbox.traces({0: forces(model)})[0]
    with make_blackbox(settings(code=code, transport="file")) as blackbox:
        blackbox.load([model])
        assert blackbox.codes()[0]["compliances"] == []
        for _ in range(200):
            again = blackbox.traces({0: forces(model)})[0]
            if noted := blackbox.codes()[0]["compliances"]:
                break
        assert noted[0]["subdomain"] == "cube" and noted[0]["unit_loads"] == len(model.trace)
        assert difference(again, first) < 1e-11
        spent = blackbox.clock()
        blackbox.traces({0: forces(model)})
        assert blackbox.clock() == spent, "no further run"


MIXED = [{"code": "freefem"}, {"code": "calculix", "on": "block 1-*"}, {"code": "scikit-fem", "on": ["block 0-1-*"]},
         {"code": "freefem", "transport": "file", "on": "block 0-1-1"}]


def test_codes_and_transports_are_mixed_freely():
    """Four ways at once in one structure: the same iterations and displacements as with FreeFEM alone."""
    changes = dict(**CUBES, boundary=[{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                                      {"on": {"plane": "x", "at": 4}, "traction": [10.0, 1.0, -2.0]}])
    alone, mixed = (solved(reference=False, **changes, blackbox=b) for b in ({}, MIXED))
    assert mixed.outcome.iterations == alone.outcome.iterations
    assert difference(mixed.displacement, alone.displacement) < 1e-11
    used = {(c["code"], c["transport"]): c for c in mixed.summary["codes"]}
    assert set(used) == {("freefem", "pipe"), ("calculix", "file"), ("scikit-fem", "pipe"), ("freefem", "file")}
    assert sorted(e for c in used.values() for e in c["subdomains"]) == list(range(16))
    assert all(c["seconds"]["total"] > 0 for c in used.values())
    assert mixed.summary["versions"]["calculix"] and mixed.summary["versions"]["scikit-fem"]
