"""A small made-up run for the tests of the results: box of tets, displacement, history, summary."""

import itertools

import numpy as np

from orchestrator.method.events import HISTORY_COLUMNS, Iteration
from orchestrator.results.fields.fields import Fields
from orchestrator.scene.model import Material, Mesh

STEEL = Material(200e3, 0.3)


def box_mesh(counts=(6, 2, 2), size=(3.0, 1.0, 1.0)) -> Mesh:
    """Kuhn's six tets in every cell of a grid."""
    axes = [np.linspace(0, s, k + 1) for s, k in zip(size, counts)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(nodes)).reshape([k + 1 for k in counts])
    cells = []
    for order in itertools.permutations(range(3)):
        corner, path = np.zeros(3, int), []
        for axis in (None, *order):
            if axis is not None:
                corner[axis] += 1
            path.append(index[tuple(slice(o, k + o) for o, k in zip(corner, counts))].ravel())
        tets = np.stack(path, axis=1)
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        cells.append(tets[:, [0, 2, 1, 3]] if odd else tets)
    cells = np.concatenate(cells)
    return Mesh(nodes, cells, np.zeros(len(cells), int), ["box"], source="box")


def lame(mesh: Mesh, material: Material = STEEL) -> np.ndarray:
    return np.tile(material.lame, (len(mesh.cells), 1))


def slices(mesh: Mesh, count: int = 3) -> np.ndarray:
    x = mesh.nodes[mesh.cells, 0].mean(axis=1)
    return np.minimum((count * x / mesh.nodes[:, 0].max()).astype(int), count - 1)


def bending(mesh: Mesh, steps: int = 2) -> np.ndarray:
    x, _, z = mesh.nodes.T
    once = 1e-3 * np.stack([x + 0.3 * x * z, 0 * x, -0.3 * x**2], axis=1)
    return np.linspace(1 / steps, 1, steps)[:, None, None] * once


def fields(mesh: Mesh | None = None) -> Fields:
    mesh = mesh or box_mesh()
    return Fields(mesh.nodes, mesh.cells, slices(mesh), lame(mesh), bending(mesh))


def iteration(i: int, **changes) -> Iteration:
    values = dict(iteration=i, sweeps=float(i + 5), seconds=0.1 * i, indicator=100.0**-i,
                  displacement_jump=10.0**-i / 3, force_imbalance=10.0**-i / 7, residual=10.0**-i,
                  error_bound=np.float64(2 * 10.0**-i) if i > 2 else np.nan, counts={"open": 0, "stick": i, "slip": 2},
                  target=("error_bound", 1e-6), state=np.full((4, 2), float(i)))
    return Iteration(**values | changes)


def history(count: int = 7) -> dict[str, np.ndarray]:
    rows = [iteration(i).row for i in range(1, count + 1)]
    return {name: np.array([row[name] for row in rows]) for name in HISTORY_COLUMNS}


def summary(**changes) -> dict[str, object]:
    return dict(
        name="made_up", converged=True, stop_reason="converged", iterations=7,
        sweeps={"setup": 5, "iterations": 7, "total": 12}, indicator=np.float64(1e-14), error_bound=2e-7,
        true_error=9e-8, residuals={"equilibrium": 1e-9}, dofs=np.int64(189), subdomains=3, interfaces=2,
        interface_nodes=18, load_steps=2, energy=np.array([0.25, 1.0]),
        reactions=[[[-1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]], status_counts=None,
        timing={"total": 2.0, "mesh": 0.1, "soles": 0.1, "macro": 0.2, "linear_stage": 0.9, "local_stage": 0.01,
                "acceleration": 0.01, "bound": 0.2, "output": 0.3,
                "blackbox": {"start": 0.3, "assemble": 0.2, "factorise": 0.2, "solve": 0.6}},
        versions={"python": "3"}, memory_peak_mb=100.0,
        config={"name": "made_up", "method": {"tolerance": {"error": 1e-6}}, "blackbox": {"code": "freefem"}},
    ) | changes
