"""Displacements and forces that an accuracy is asked of: their values, and their errors by dual problems."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from orchestrator.errors import Refusal
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.dual import solve_duals
from orchestrator.method.delivery.flux import Carrier, Measured
from orchestrator.method.delivery.recovery import of_all
from orchestrator.method.delivery.wanted import RESULTANT, Wanted
from orchestrator.method.stopping.element_problems import estimator_of
from orchestrator.method.stopping.quantity import Quantity, errors
from orchestrator.scene.conditions.probes import Section
from orchestrator.scene.copies import Copies
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


def check_sections(scene: Scene, asked: Collection[str]) -> None:
    """Check that what probes of a whole scene mean does not hang on its mesh: a section goes between tets, and what acts on the body between
    these and the plane counts or not, mesh by mesh.

    Raises Refusal: a plane that cuts faces which are held, loaded, or between bodies that may part; a surface at whose rim others act
    """
    copies, acted = Copies.of(scene), scene.fixed.any(axis=1)
    for faces in (entry.triangles for entry in scene.boundary):
        acted[faces] = True
    for i in scene.interfaces:
        if not i.law.perfect:
            for side in (0, 1):
                acted[scene.side_nodes(i, side)] = True
    for p in scene.probes:
        if p.name in asked and isinstance(p, Section):
            behind, front = (copies.label[copies.cells[layer.tets]] for layer in Carrier(p, copies).layers)
            if acted[copies.node[np.isin(copies.label, np.intersect1d(behind, front))]].any():
                raise Refusal("section that ends where something acts", name=p.name)
        elif p.name in asked and p.quantity == RESULTANT and (others := Carrier(p, copies).rims()):
            raise Refusal("accuracy beside a rim", name=p.name, interface=scene.interfaces[others[0].interface].name)


def unit_answers(d: Decomposition, delivered: Delivered, wanted: Wanted, method, watch: Stopwatch) -> np.ndarray | None:
    """(quantities · T, N, 3) answers z to loads whose work is the length of a quantity, at the nodes of one subdomain after another; on
    rank 0, which has all of them. Every rank calls this.

    wanted : of a whole scene
    method : ``method`` of the configuration
    Raises Refusal: see ``solve_duals``
    """
    team, steps = d.space.team, d.scene.steps
    measured = wanted.probes | wanted.forces
    directions = team.share(None if team.rank else {
        name: value / np.maximum(np.linalg.norm(value, axis=1), np.finfo(float).tiny)[:, None]
        for name, value in _values(delivered, wanted).items()})
    rows = [_loads(s.index, len(s.nodes), steps, measured, directions) for s in d.own]
    found = of_all(d, solve_duals(d, delivered.iterated, rows, np.tile(np.arange(steps), len(measured)), method, watch))
    return None if team.rank else np.concatenate(found, axis=1)


def quantities(scene: Scene, delivered: Delivered, wanted: Wanted, answers: np.ndarray, asked: Mapping[str, float]) -> list[Quantity]:
    """Quantities asked of a whole scene, on rank 0.

    answers : of ``unit_answers``
    asked : name of a probe → accuracy
    """
    copies, estimator, bound = Copies.of(scene), estimator_of(scene), delivered.iterated.bound
    moved, size, found = np.concatenate(delivered.continuous, axis=1), float(np.sqrt(max(bound.energy.max(), 0.0))), []
    measured = wanted.probes | wanted.forces
    for duals, (name, value) in zip(answers.reshape(len(measured), scene.steps, -1, 3), _values(delivered, wanted).items()):
        jump, length = None, np.linalg.norm(value, axis=1)
        if name in wanted.forces:
            carrier = Carrier(next(p for p in scene.probes if p.name == name), copies)
            jump = carrier.tets, np.einsum("tc,cknx->tknx", value / np.maximum(length, np.finfo(float).tiny)[:, None], carrier.lifted())
        cells, norms = errors(estimator, moved, duals, jump)
        found.append(Quantity(name, asked[name], length, _most(measured[name], delivered.continuous), cells, bound.relative * size * norms))
    return found


def _values(delivered: Delivered, wanted: Wanted) -> dict[str, np.ndarray]:
    """Name → (T, 3) what is asked of displacements, or of those in balance."""
    return {name: probe.of(delivered.parts if name in wanted.forces else delivered.continuous)[:, :3]
            for name, probe in (wanted.probes | wanted.forces).items()}


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
