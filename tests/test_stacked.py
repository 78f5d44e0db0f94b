"""What is done for all subdomains at once is what would be done one by one."""

import numpy as np
import pytest
from method_case import box_of, config, prepared

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.errors import BlackBoxError
from orchestrator.scene.build import build_scene

CUBES = {"mesh": {"box": {"size": [3, 2, 2], "cells": [6, 4, 4]}}, "subdomains": {"grid": [3, 2, 2]},
         "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                      {"on": {"plane": "x", "at": 3}, "traction": [[10, 0, 5], [0, 10, 1]]}]}
METIS = {**CUBES, "subdomains": {"metis": 5}}


@pytest.fixture(scope="module", params=[
    (CUBES, True, "symmetric"), (CUBES, False, "symmetric"), (METIS, True, "symmetric"),
    (CUBES, True, "auto"), (METIS, True, "auto")],
                ids=["congruent", "each by itself", "different", "by nodes", "different by nodes"])
def case(request):
    """A decomposition with few kinds of subdomains, with as many as there are, and with different shapes."""
    data, congruent, kind = request.param
    made = config(**data, method={"skip": {"congruent": congruent}, "sole": {"kind": kind}})
    scene = build_scene(made)
    with SharedModels(box_of(made), True, workers=1, steps=scene.steps) as blackbox:
        yield prepared(made, scene, blackbox)


def test_answers(case):
    space, blackbox = case.space, case.blackbox
    forces = np.random.default_rng(0).standard_normal((3, len(space.global_dof)))
    forces[1, space.boundary[2]] = 0.0
    for changed in (slice(0), slice(0, 1), slice(2, 3)):  # rows remembered, one new, another one
        forces[changed] *= 2
        found = blackbox.all_traces(forces, space.boundary)
        for model, part in zip(blackbox.model_of.tolist(), space.boundary):
            alone = blackbox.inner.traces({model: np.ascontiguousarray(forces[:, part])})[model]
            assert np.abs(found[:, part] - alone).max(initial=0.0) <= 1e-13 * np.abs(found).max()


def test_soles_by_products(case):
    direction, space = case.stage.direction, case.space
    whole = space.scatter @ direction.k @ space.scatter.T
    u = np.random.default_rng(0).standard_normal((2, len(space.global_dof)))
    wanted = (whole @ u.T).T
    assert np.abs(direction.robin(u) - wanted).max() <= 1e-13 * np.abs(wanted).max()
    for some in (range(len(space.boundary)), [2, 0], []):
        blocks = direction.robin_blocks(some)
        assert len(blocks) == len(some)
        for e, found in zip(some, blocks):
            block = whole[space.boundary[e], space.boundary[e]]
            assert found.shape == block.shape and abs(found - block).max() <= 1e-13 * abs(block).max()


def test_macro_problem(case):
    """V and the macro matrix against one answer of the black box per macro unknown."""
    macro, space = case.stage.macro, case.space
    G, each = macro.force(np.eye(macro.size)).T, macro.fields if space.by_nodes else macro.C
    C = each @ np.eye(macro.size)
    forces = (space.scatter @ G).T
    V = BlackBox.all_traces(case.blackbox, forces, space.boundary)
    alpha = np.random.default_rng(0).standard_normal((2, macro.size))
    assert np.abs(macro.displacement(alpha) - alpha @ V).max() <= 1e-12 * np.abs(V).max()
    matrix = C.T @ G - forces @ V.T
    f = (C @ np.linalg.solve(C.T @ C, matrix @ alpha.T)).T
    assert np.abs(macro.multiplier(f, f) - alpha).max() <= 1e-9
    wanted = np.abs(f @ C).max(), (np.abs(f) @ np.abs(C)).max()
    assert np.allclose(macro.imbalance(f), wanted)
    assert macro.number.tolist() == list(range(macro.size)) and not macro.shared.any()


def test_guard_finds_the_one_that_is_wrong(case, monkeypatch):
    space, guarded = case.space, case.stage.blackbox
    forces = np.random.default_rng(0).standard_normal((2, len(space.global_dof)))
    guarded.all_traces(forces, space.boundary)
    wrong = space.boundary[3]
    sound = type(guarded.inner).all_traces

    def falsified(self, forces, parts):
        answers = sound(self, forces, parts)
        answers[1, wrong] *= -1
        return answers

    monkeypatch.setattr(type(guarded.inner), "all_traces", falsified)
    with pytest.raises(BlackBoxError) as caught:
        guarded.all_traces(2 * forces, space.boundary)
    assert caught.value.subdomain == case.own[3].name
