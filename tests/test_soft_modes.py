"""Where affine macro functions fail: soles of the neighbours' own elements, soft modes, and when they are chosen."""

import numpy as np
import pytest
import scipy.linalg as la
from in_process import IN_PROCESS
from method_case import box_of, config, method, prepared, saved

from orchestrator.method.linear.soft_modes import SOFT, soft_modes
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.soles.overlap import OWN, difficulty
from orchestrator.scene.soles.make import make_soles

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


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_no_subdomain_is_stiffer_than_the_overlap_allows(tmp_path, element):
    ratio = 0.5
    made = config(**mixed(tmp_path / "mixed.mesh", (4, 2, 1), **method({"kind": "overlap", "modulus_ratio": ratio})),
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


def test_what_is_hard(tmp_path):
    assert not difficulty(build_scene(config())).incompressible_or_slender.any()
    even = difficulty(build_scene(config(**mixed(tmp_path / "mixed.mesh", materials=[{"young": 1.0, "poisson": 0.3}]))))
    mixed_up = difficulty(build_scene(config(**mixed(tmp_path / "mixed.mesh"))))
    assert not even.mixed_moduli.any() and mixed_up.mixed_moduli.all() and not mixed_up.incompressible_or_slender.any()
    assert difficulty(build_scene(config(**flat()))).incompressible_or_slender.all()
    for element, poisson, soft in ("P1", 0.499, True), ("P2", 0.499, False), ("P2", 0.4999, True):
        hard = difficulty(build_scene(config(materials=[{"young": 1.0, "poisson": poisson}], blackbox={"element": element})))
        assert hard.incompressible_or_slender.all() and hard.soft.all() == hard.soft.any() == soft


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("poisson", [0.3, 0.499])
def test_copies_of_matter_that_flows_resist_by_the_mean_of_its_moduli(element, poisson):
    """λ' = √(λ μ) where ten-node tets are nearly incompressible; the matter's own everywhere else."""
    made = config(materials=[{"young": 200e3, "poisson": poisson}], blackbox={**IN_PROCESS, "element": element},
                  **method({"kind": "overlap"}))
    for one, _ in make_soles(build_scene(made), made.method.sole):
        ratio = 2 * one.poisson / (1 - 2 * one.poisson)  # λ/μ
        own = 2 * poisson / (1 - 2 * poisson)
        assert np.allclose(ratio, np.sqrt(own) if (element, poisson) == ("P2", 0.499) else own, rtol=1e-9)
