"""Displacements and forces that an accuracy is asked of: their values, and their errors by dual problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.dual import solve_duals
from orchestrator.method.delivery.flux import lifted
from orchestrator.method.delivery.measured import Measured
from orchestrator.method.delivery.wanted import Wanted
from orchestrator.method.stopping.element_problems import ElementProblems
from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.method.stopping.quantity import Quantity, errors
from orchestrator.scene.copies import Copies
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


def estimator_of(scene: Scene) -> Estimator:
    """Of ten-node tets by a problem in each, of four-node ones by recovered stresses."""
    return (ElementProblems if scene.mesh.cells.shape[1] == 10 else Estimator).of(scene)


def quantities(d: Decomposition, delivered: Delivered, asked: Mapping[str, float], method, watch: Stopwatch) -> list[Quantity]:
    """What is asked of a whole scene on one rank.

    asked : name of a probe → accuracy
    method : ``method`` of the configuration
    Raises Refusal: see ``solve_duals``
    """
    scene, wanted = d.scene, Wanted.of(d.scene, list(asked), (), np.zeros(3))
    measured = wanted.probes | wanted.forces
    values = {name: probe.of(delivered.parts if name in wanted.forces else delivered.continuous)[:, :3] for name, probe in measured.items()}
    directions = {name: value / np.maximum(np.linalg.norm(value, axis=1), np.finfo(float).tiny)[:, None] for name, value in values.items()}
    rows = [_loads(s.index, len(s.nodes), scene.steps, measured, directions) for s in scene.subdomains]
    duals = np.concatenate(solve_duals(d, delivered.iterated, rows, np.tile(np.arange(scene.steps), len(measured)), method, watch), axis=1)
    copies, estimator, bound = Copies.of(scene), estimator_of(scene), delivered.iterated.bound
    moved, size, found = np.concatenate(delivered.continuous, axis=1), float(np.sqrt(max(bound.energy.max(), 0.0))), []
    for k, (name, probe) in enumerate(measured.items()):
        jump, n = None, directions[name]
        if name in wanted.forces:
            tets, chi = lifted(next(p for p in scene.probes if p.name == name), copies)
            jump = tets, np.einsum("tc,cknx->tknx", n, chi)
        cells, norms = errors(estimator, moved, duals[k * scene.steps: (k + 1) * scene.steps], jump)
        found.append(Quantity(name, asked[name], np.linalg.norm(values[name], axis=1), _most(probe, delivered.continuous), cells,
                              bound.relative * size * norms))
    return found


def _loads(index: int, nodes: int, steps: int, measured: Mapping[str, Measured], directions: Mapping[str, np.ndarray]) -> np.ndarray:
    """(quantities · T, n_E, 3) loads on a subdomain whose work is the length of a quantity at a load step."""
    result = np.zeros((len(measured), steps, nodes, 3))
    for row, (name, probe) in zip(result, measured.items()):
        if index in probe.weights:
            at, weight = probe.weights[index]
            np.add.at(row, (slice(None), at), np.einsum("tc,cni->tni", directions[name], weight[:3]))
    return result.reshape(-1, nodes, 3)


def _most(probe: Measured, parts: Sequence[np.ndarray]) -> np.ndarray:
    """(T,) what it would be if nothing cancelled."""
    all_of = np.abs(probe.given[:, :3]).sum(axis=1)
    for e, (nodes, weight) in probe.weights.items():
        all_of = all_of + np.einsum("cni,tni->t", np.abs(weight[:3]), np.abs(parts[e][:, nodes]))
    return all_of
