"""The guaranteed bound of mesh and iterations together: its stress is in balance to rounding, and no true error is larger."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import late, quick

from benchmarks.kit.apart import apart
from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method.stopping import equilibrated
from orchestrator.method.stopping.mesh_bound import MeshBounds, relative
from orchestrator.method.stopping.stress_element import FACES, TENSOR
from orchestrator.scene.build import build_scene
from orchestrator.solving import solve

HELD = {"on": "zmin", "displacement": [0, 0, 0]}
STEEL = [{"young": 200e3, "poisson": 0.3}]


def block(cells, element="P1", tolerance=1e-6, **more):
    """Two by one by one, of two subdomains."""
    return config_from({"name": "t", "mesh": {"box": {"size": [1, 1, 2], "cells": cells}}, "materials": STEEL,
                        "subdomains": {"slices": {"axis": "z", "count": 2}}, "boundary": [HELD, {"on": "zmax", "traction": [40, 0, 100]}],
                        "method": {"tolerance": {"error": tolerance}}, "output": {"figures": False},
                        "blackbox": {**IN_PROCESS, "element": element}} | more)


def leaps(bounds, moments, body):
    """What is left of balance: divergence in every part of a tet, and leaps of tractions between parts and between tets; relative."""
    balance, scene = bounds.balance, bounds.scene
    sigma = balance.elements.stresses(moments)[..., TENSOR]  # (m, 4, 4, 3, 3)
    corners = balance.points
    nodes = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
    parts = np.hstack([FACES, np.full((4, 1), 4)])
    size, scale = np.abs(sigma).max(), scene.mesh.diagonal
    tractions = np.zeros((len(balance.outer), 3, 3))
    worst = 0.0
    for f, own in enumerate(parts):
        edges = nodes[:, own[1:]] - nodes[:, own[:1]]
        slopes = np.linalg.inv(edges)  # (m, 3, 3), columns of gradients
        divergence = np.einsum("mkij,mjk->mi", sigma[:, f, 1:] - sigma[:, f, :1], slopes)
        worst = max(worst, np.abs(divergence + body).max() * scale / size)
        for g in range(f):
            shared = [p for p in own if p in parts[g]]
            normal = np.cross(nodes[:, shared[1]] - nodes[:, shared[0]], nodes[:, shared[2]] - nodes[:, shared[0]])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            for p in shared:
                leap = sigma[:, f, list(own).index(p)] - sigma[:, g, list(parts[g]).index(p)]
                worst = max(worst, np.abs(np.einsum("mij,mj->mi", leap, normal)).max() / size)
        normal = balance.normals[:, f] / np.linalg.norm(balance.normals[:, f], axis=1, keepdims=True)
        np.add.at(tractions, balance.face[:, f], np.einsum("mkij,mj->mki", sigma[:, f, :3], normal))
    return worst, tractions / size


@pytest.mark.parametrize("largest", [10_000, 40])
def test_in_balance_everywhere(largest, monkeypatch):
    """In every part of every tet, across all faces, and on the surface; with a weight, in one part and in several."""
    monkeypatch.setattr(equilibrated, "LARGEST", largest)
    run = solve(block([2, 2, 4], loads=[{"body_force": [0, -30, 70]}]))
    found, bounds = {}, MeshBounds(run.scene)
    balance = bounds.balance
    kept = type(balance).__call__

    def watched(self, *given):
        found["of"], found["known"], found["given"] = kept(self, *given), *given[2:]
        return found["of"]

    monkeypatch.setattr(type(balance), "__call__", watched)
    bound = bounds(run.sides)
    worst, tractions = leaps(bounds, found["of"].moments, np.array([0, -30, 70]))
    assert bound.unbalanced < 1e-12 and worst < 1e-10
    assert np.abs(tractions[~balance.outer]).max() < 1e-10  # those of both sides cancel
    free = found["known"].all(axis=1) & ~found["given"].any(axis=(1, 2))
    assert free.any() and np.abs(tractions[free]).max() < 1e-10


@pytest.mark.parametrize("element", quick(["P1", "P2"], "P1"))
@pytest.mark.parametrize("more", [late({}), {"loads": [{"body_force": [0, -300, 0]}]},
                                  {"boundary": [HELD, {"on": "zmax", "displacement": [0.01, None, None]}]},
                                  {"boundary": [{"on": "zmin", "displacement": [0, 0, None]},
                                                {"on": "zmax", "displacement": [None, None, 0]}],
                                   "materials": [{"young": 200e3, "poisson": 0.3, "expansion": 1e-5}],
                                   "loads": [{"temperature": {"value": 10, "at": [0, 0, 0], "gradient": [60, 0, 100]}}]}])
def test_no_true_error_is_larger(more, element):
    """Errors of coarse meshes against ten-node tets on a finer one: ‖v − u‖ and the bound, at most 3 times as large."""
    coarse, fine = solve(block([2, 2, 4], element, **more)), solve(block([4, 4, 8], "P2", 1e-4, **more))
    bound = MeshBounds(coarse.scene)(coarse.sides)
    true = apart(coarse, fine)
    assert true <= bound.relative <= 3 * true


TILTED = {"interfaces": [{"law": "contact"}], "boundary": [HELD, {"on": "zmax", "motion": {
    "translate": [0, 0, -0.005], "rotate": {"axis": "y", "degrees": 0.8, "about": [0.5, 0.5, 2]}}}]}


@pytest.mark.long
def test_contact():
    """Half open, without friction; of bonded displacements too, whose nearest stresses would pull; not where bodies are in each other."""
    coarse, fine = solve(block([4, 4, 8], **TILTED)), solve(block([8, 8, 16], **TILTED))
    assert coarse.summary["status_counts"]["open"][0] > 0
    bounds = MeshBounds(coarse.scene)
    true = apart(coarse, fine)
    assert true <= bounds(coarse.sides).relative <= 3 * true
    stuck = solve(block([4, 4, 8], boundary=TILTED["boundary"]))
    assert 0.1 < apart(stuck, fine) <= bounds(stuck.sides).relative
    lower, upper = coarse.sides
    assert bounds([lower, upper * (1 + 1e-6)]).relative == np.inf  # off what is prescribed
    moved = np.where(coarse.scene.subdomains[1].fixed, 0, [0, 0, -1e-3])
    assert bounds([lower, upper + moved]).relative == np.inf  # inside each other


def test_the_largest_share_in_a_ball():
    """Formula of ‖v − u‖ / ‖u‖ against many u on the sphere: v is inside of it where a gap is left."""
    random = np.random.default_rng(0)
    for gap in (0.0, 0.02):
        v, s = np.array([1.0, 0.1, 0]), np.array([1.1, -0.2, 0.3])
        apart2 = np.vdot(v - s, v - s)
        error = np.sqrt(apart2 + 2 * gap)
        directions = random.normal(size=(200_000, 3))
        u = (v + s) / 2 + np.sqrt(error**2 / 2 - apart2 / 4) * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        most = (np.linalg.norm(v - u, axis=1) / np.linalg.norm(u, axis=1)).max()
        told = relative(*(np.array([x]) for x in (error, np.linalg.norm(v), v @ s, gap)))
        assert most <= told <= 1.001 * most


def test_nothing_where_the_mesh_holds_the_solution():
    pulled = {"boundary": [{"on": "zmin", "displacement": [None, None, 0]}, {"on": "xmin", "displacement": [0, None, None]},
                           {"on": "ymin", "displacement": [None, 0, None]}, {"on": "zmax", "traction": [0, 0, 100]}]}
    for element in ("P1", "P2"):
        run = solve(block([2, 2, 4], element, tolerance=1e-9, output={"figures": False, "mesh_bound": True}, **pulled))
        assert run.summary["mesh_bound"] < 1e-7


@pytest.mark.parametrize("more, told", [
    ({"interfaces": [{"law": "contact", "friction": 0.1}]}, "has friction"),
    ({"interfaces": [{"law": "contact"}], "blackbox": {**IN_PROCESS, "element": "P2"}}, "ten-node tets where bodies touch"),
    ({"boundary": [HELD, {"on": "xmin", "hydrostatic": {"level": 1.3, "weight": 1}}]}, "a level runs through"),
    ({"materials": [STEEL[0] | {"density": 1}], "loads": [{"spin": {"rate": 10, "axis": "z"}}]}, "vary within")])
def test_refused(more, told):
    with pytest.raises(InputError, match=told):
        MeshBounds(build_scene(block([2, 2, 4], **more)))
