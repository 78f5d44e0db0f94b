"""Bolts: tightened by a force, then locked, one after another; against CalculiX, and against equilibrium."""


import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method.coarse.load_step import LoadStep
from orchestrator.method.interface.pairs import History
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.kit.calculix_whole import displacements

PULL = 300.0
FLAT, OBLIQUE = {"plane": "z", "at": 1.5}, {"plane": [0.1, 0, 1], "at": [0.5, 0.5, 1.4]}


def bar(element: str = "P1", cut: object = None, **changes) -> dict:
    """A bar between walls, tightened, then loaded from beside and heated no more."""
    return {"name": "bar", "mesh": {"box": {"size": [1, 1, 3], "cells": [2, 2, 4]}},
            "subdomains": {"slices": {"axis": "z", "count": 1}}, "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}, {"on": "zmax", "displacement": [0, 0, 0]},
                         {"on": "xmax", "traction": [3, 2, 5], "history": "late"}],
            "histories": {"late": [0, 1], "first": [1, 1]},
            "bolts": [{"on": "*", "cut": cut or FLAT, "force": PULL, "history": "first"}],
            "blackbox": {**IN_PROCESS, "element": element}, "method": {"tolerance": {"error": 1e-9}}, **changes}


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.long
def test_a_bolt_is_what_calculix_has_for_a_pre_tension_section(element, tmp_path):
    solution = solve(config_from(bar(element)))
    assert solution.converged
    scene, (told,) = solution.scene, solution.summary["bolts"]
    assert told["state"] == ["tightened", "locked"] and told["axis"] == [0, 0, 1]
    assert told["force"][0] == pytest.approx(PULL, rel=1e-8)
    assert told["shortening"][1] == pytest.approx(told["shortening"][0], rel=1e-9) and told["shortening"][0] > 0
    exact = displacements(scene, tmp_path, [[PULL, None]])
    off = np.abs(exact - solution.displacement)[:, np.setdiff1d(np.arange(len(scene.mesh.nodes)), scene.bolts[0].interface.global_nodes)]
    assert off.max() < 1e-6 * np.abs(exact).max()


def test_the_coarse_problem_knows_that_a_bolts_pairs_answer_together(monkeypatch):
    """Newton's matrix is the derivative of the imbalance, also where ∂f̂/∂F couples all pairs of a cut."""
    from orchestrator.method.coarse.problem import CoarseProblem

    seen = {}
    original = CoarseProblem.solve
    monkeypatch.setattr(CoarseProblem, "solve", lambda self, *a, **k: (None if seen else seen.update(
        problem=self, pairs=self.fields.pairs)) or original(self, *a, **k))
    solve(config_from(bar()))
    problem, pairs, rng = seen["problem"], seen["pairs"], np.random.default_rng(3)
    F0, before = 100 * rng.normal(size=(3, len(pairs))), 1e-3 * rng.normal(size=(3, len(pairs)))
    resultant, y, change = (rng.normal(size=(2, 12)) for _ in range(3))
    for number in (0, 1):  # tightened, locked
        step = LoadStep(problem.bodies, number, F0, resultant, History(before))
        step.residual(y)
        matrix = problem.bodies.pattern.matrix(step.matrix()).toarray()
        found = (step.residual(y + change) - step.residual(y - change)) / 2
        assert matrix @ change.ravel() == pytest.approx(found.ravel(), abs=1e-6 * np.abs(found).max())


@pytest.mark.long
def test_what_slides_off_a_bolt_that_is_held_is_told():
    """Both halves of the bolt are held, so that no rigid motion reaches its cut."""
    solution = solve(config_from({
        "name": "off", "parts": [boxed("bolt"), boxed("block", at=[0, 0, 1])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "friction": 0.1}],
        "boundary": [*({"on": f"bolt/{face}", "displacement": [0, 0, 0]} for face in ("xmin", "xmax")),
                     {"on": "block/zmax", "traction": [8, 0, -10]}],
        "bolts": [{"on": "bolt", "cut": {"plane": "x", "at": 0.5}, "force": 10.0}], "blackbox": IN_PROCESS}))
    assert solution.stop_reason == "limit load" and solution.summary["limit_load"][0]["motions"][0]["body"] == "block"


WRONG = {
    "no volume": ({"bolts": [{"on": "bolt_7", "force": 1.0}]}, ("bolts", 0, "on"), "no volume is called 'bolt_7'"),
    "no force": ({"bolts": [{"on": "*", "force": 0.0}]}, ("bolts", 0, "force"), "> 0"),
    "a plane beside it": ({"bolts": [{"on": "*", "cut": {"plane": "z", "at": 30.0}, "force": 1.0}]}, ("bolts", 0, "cut"),
                          "reaches from 0 to 3"),
    "nowhere along a direction": ({"bolts": [{"on": "*", "cut": {"plane": [0, 1, 1], "at": 5}, "force": 1.0}]},
                                  ("bolts", 0, "cut", "at"), "5"),
    "no direction": ({"bolts": [{"on": "*", "cut": {"plane": [0, 0, 0], "at": [0, 0, 0]}, "force": 1.0}]}, ("bolts", 0, "cut", "plane"),
                     "direction"),
    "no cylinder": ({"bolts": [{"on": "*", "force": 1.0}], "mesh": {"polycrystal": {"grains": 1, "size": 1.0, "h": 0.6}}},
                    ("bolts", 0, "cut"), ""),
    "an unknown end": ({"bolts": [{"on": "*", "force": 1.0, "then": "free"}]}, ("bolts", 0, "then"), "locked"),
    "no history": ({"bolts": [{"on": "*", "force": 1.0, "history": "none"}]}, ("bolts", 0, "history"), "'none'"),
    "a bolt that pushes": ({"bolts": [{"on": "*", "cut": FLAT, "force": 1.0, "history": "down"}],
                            "histories": {"down": [1, -1], "late": [0, 1]}},
                           ("bolts", 0, "history"), "a bolt pulls"),
    "never tightened": ({"bolts": [{"on": "*", "cut": FLAT, "force": 1.0, "history": "never"}],
                         "histories": {"never": [0, 0], "late": [0, 1]}},
                        ("bolts", 0, "history"), "never tightened"),
    "cut twice": ({"bolts": [{"on": "*", "cut": FLAT, "force": 1.0}] * 2}, ("bolts", 1, "on"), "second entry"),
    "cut along": ({"bolts": [{"on": "*", "cut": {"plane": "z", "at": 1.4}, "force": 1.0}],
                   "subdomains": {"slices": {"axis": "x", "count": 2}}},
                  ("bolts", 0, "cut"), "interfaces"),
    "held at the cut": ({"bolts": [{"on": "*", "cut": FLAT, "force": 1.0}], "boundary": [{"on": "ymin", "displacement": [None, None, 0]},
                        {"on": "zmin", "displacement": [0, 0, 0]}]}, ("boundary",), "along the axis"),
    "history of nothing": ({"bolts": [], "interfaces": [{"law": "perfect", "history": "late"}]}, ("interfaces", 0, "history"),
                           "prescribes nothing"),
    "history without a gap": ({"bolts": [], "interfaces": [{"law": "contact", "history": "late"}]}, ("interfaces", 0, "history"), "gap"),
    "a list and a history": ({"bolts": [],
                              "interfaces": [{"law": "jump", "between": ["a", "b"], "jump": [[0, 0, 0], [0, 0, 1]], "history": "late"}]},
                             ("interfaces", 0, "history"), "one vector per step"),
    "force of a pair that is found": ({"bolts": [], "interfaces": [{"law": "pretension", "between": "auto", "force": 1.0}]},
                                      ("interfaces", 0, "between"), "bolts:"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_bolt_is_told_with_its_place(what):
    changes, path, words = WRONG[what]
    with pytest.raises(InputError) as caught:
        build_scene(config_from(bar(**changes)))
    problem = next(p for p in caught.value.problems if p.path == path)
    assert words in str(problem) and problem.expected and problem.cure
