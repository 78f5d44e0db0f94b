"""Search directions: how far apart k⁻ and k⁺ are, and the relaxation that follows."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from in_process import IN_PROCESS

from orchestrator.blackbox.models import sole_models
from orchestrator.blackbox.shared import assembled
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.load import config_from
from orchestrator.method.increments import iterate
from orchestrator.method.setup import RankPart, make_soles_of, prepare
from orchestrator.scene.build import build_scene
from orchestrator.scene.soles.make import make_soles
from orchestrator.timing import Stopwatch

BAR = {
    "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
    "materials": [{"young": 200e3, "poisson": 0.3}],
    "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}],
}


@pytest.fixture
def prepared():
    """prepare(interfaces, **method) → decomposition, method; the black box lives as long as the test."""
    pools = []

    def make(interfaces, **method):
        config = config_from({**BAR, "interfaces": interfaces, "method": method, "blackbox": IN_PROCESS})
        scene = build_scene(config)
        pools.append(make_blackbox(config.blackbox))
        part = RankPart.of(scene, config.method)
        soles = make_soles_of(part, config.method)
        return prepare(part, soles, config.method, pools[-1], Stopwatch()), config.method

    yield make
    for pool in pools:
        pool.close()


def test_eigenvalues_against_a_dense_solver(prepared):
    """λ(k⁻, diag k⁻) to the one per cent that is promised."""
    d, _ = prepared([], sole={"kind": "layer"}, search_direction={"kplus": "diagonal"})
    k = d.stage.direction.k.toarray()
    exact = la.eigvalsh(k, np.diag(np.diag(k)))
    assert np.allclose(d.local.conditioning(), (exact[0], exact[-1]), rtol=0.02)


def test_plain_fixed_point_finds_a_stable_relaxation(prepared):
    """Diagonal k⁺ grows without bound at the paper's 0.8 on this mesh; with ``relaxation: auto`` it shrinks."""
    options = dict(acceleration="none", search_direction={"kplus": "diagonal"}, max_iterations=120,
                   tolerance={"error": 1e-9})
    sizes = {}
    for relaxation in ("auto", 0.8):
        d, method = prepared([], relaxation=relaxation, **options)
        history = iterate(d, method, [], Stopwatch()).history
        sizes[relaxation] = history[-1].indicator / history[4].indicator
    assert sizes["auto"] < 0.05
    assert sizes[0.8] > 1


def test_stiffness_of_a_sole_does_not_depend_on_what_else_is_asked_for():
    """Bit for bit, in the hands of the real code: other ranks have other soles."""
    config = config_from({"name": "grains", "mesh": {"polycrystal": {"grains": 6, "size": 1, "h": 0.4, "seed": 7}},
                          "subdomains": "groups", "materials": BAR["materials"], "interfaces": [{"law": "contact"}],
                          "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}]})
    scene = build_scene(config)
    models = [model for model, _ in sole_models(scene, make_soles(scene, config.method.sole))]
    some = range(1, len(models), 3)
    with make_blackbox(config.blackbox) as blackbox:
        together = assembled(models, blackbox, False)
        apart = assembled([models[i] for i in some], blackbox, False)
    assert len(models) > len(some) > 2
    for i, alone in zip(some, apart):
        assert np.array_equal(together[i].toarray(), alone.toarray())
