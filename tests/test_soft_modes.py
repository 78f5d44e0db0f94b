"""Where affine macro functions fail: soles of the neighbours' own elements, soft modes, and when they are chosen."""

import numpy as np
import pytest
import scipy.linalg as la
from in_process import IN_PROCESS
from method_case import box_of, config, method, prepared, saved
from quick import quick

from orchestrator.method.linear.soft_modes import SOFT, soft_modes
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.soles.overlap import OWN

SOFT_AND_STIFF = [{"young": 200.0, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "volume_2"}]


def mixed(path, cells=(8, 4, 2), **changes):
    """The bar of 2 × 2 × 1 parts with every tet soft or 1000 times stiffer, at random."""
    mesh = bricks(np.array([4.0, 2.0, 1.0]), np.array(cells), "box")
    mesh.volume = np.random.default_rng(1).integers(0, 2, len(mesh.cells))
    mesh.volumes = ["volume_1", "volume_2"]
    return {"mesh": saved(mesh, path), "subdomains": {"grid": [2, 2, 1]}, "materials": SOFT_AND_STIFF, **changes}


def flat(**changes):
    """Parts 20 times wider than thick."""
    return {"mesh": {"box": {"size": [4.0, 2.0, 0.1], "cells": [8, 4, 4]}}, "subdomains": {"grid": [4, 2, 2]},
            **changes}


def spectra(made, wanted=True):
    """Per subdomain with interfaces C and the soles' k on its boundary dofs; its soft modes if wanted, their sweeps."""
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        parts = {e: s.stop - s.start for e, s in enumerate(d.space.boundary) if s.stop > s.start}
        compliance = blackbox.traces({e: np.eye(n) for e, n in parts.items()})
        modes, sweeps = soft_modes(d.stage.direction, blackbox, np.full(len(scene.subdomains), wanted))
    robin = (d.space.scatter @ d.stage.direction.k @ d.space.scatter.T).tocsr()
    return {e: ((c + c.T) / 2, robin[s, s].toarray()) for e, c in compliance.items()
            for s in [d.space.boundary[e]]}, modes, sweeps


@pytest.mark.parametrize("element", quick(["P1", "P2"], "P1"))
def test_no_subdomain_is_stiffer_than_the_overlap_allows(tmp_path, element):
    ratio = 0.5
    sole = {"kind": "overlap", "modulus_ratio": ratio}
    made = config(**mixed(tmp_path / "mixed.mesh", (4, 2, 1), **method(sole, macro={"basis": "affine"})),
                  blackbox={**IN_PROCESS, "element": element})
    pairs, _, _ = spectra(made, wanted=False)
    for compliance, k in pairs.values():
        stiffness = np.linalg.inv(compliance) - k
        worst = la.eigh(stiffness, k, eigvals_only=True)[-1]
        assert worst <= 2 / (OWN * ratio) * (1 + 1e-6)  # two interfaces meet in the elements along the middle line


def test_soft_modes_are_those_of_the_dense_problem():
    made = config(**flat(**method({"kind": "overlap"}, macro={"basis": "affine"})))
    pairs, modes, sweeps = spectra(made)
    found = 0
    for e, (compliance, k) in pairs.items():
        value, vector = la.eigh(k @ compliance @ k, k)
        soft = vector[:, value > 1 / (1 + SOFT)]
        left = soft - modes[e] @ (modes[e].T @ (k @ soft))
        assert modes[e].shape[1] == soft.shape[1]
        assert np.sqrt(np.sum(left * (k @ left), axis=0)).max() < 0.2
        found += soft.shape[1]
    assert found > 0 and 0 < sweeps < max(len(k) for _, k in pairs.values())
