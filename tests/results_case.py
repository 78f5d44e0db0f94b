"""A small made-up run for the tests of the results: box of tets, displacement, history, summary."""

import itertools

import numpy as np

from orchestrator.laws.points import table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.events import HISTORY_COLUMNS, Iteration
from orchestrator.results.fields.fields import Fields
from orchestrator.registry import LAWS
from orchestrator.scene.mesh.faces import LOCAL_FACES
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Material

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


def opened(status: dict[int, list[int]] | None = None, steps: int = 2) -> Fields:
    """The bending box cut in two at half its length, the second half moved away; statuses (9 nodes) per load step."""
    mesh = box_mesh()
    part, u = slices(mesh, 2), bending(mesh, steps)
    own = [np.unique(mesh.cells[part == e]) for e in (0, 1)]
    apart = 1e-3 * np.linspace(0, 1, steps)[:, None, None] * np.array([1.0, 0.0, 0.0])
    nodes = np.intersect1d(*own)
    faces = np.concatenate([mesh.cells[part == 0][:, face] for face in LOCAL_FACES])
    faces = faces[np.isin(faces, nodes).all(axis=1)]
    normal, count = np.tile([1.0, 0.0, 0.0], (len(nodes), 1)), len(nodes)
    kinds = table(LAWS.values())
    interfaces = InterfaceFields(
        names=np.array(["a - b"]), laws=np.array(["contact"]), subdomains=np.array([[0, 1]]), offsets=np.array([0, count]),
        nodes=nodes, others=nodes, triangles=np.searchsorted(nodes, faces), owner=np.zeros(len(faces), int), normal=normal,
        area=np.full(count, 1 / count), initial_gap=np.zeros(count), gap=np.tile(apart[:, :, 0], (1, count)),
        slip=np.zeros((steps, count, 3)), pressure=np.outer(np.arange(steps), np.linspace(0, 5, count)),
        friction_traction=np.zeros((steps, count, 3)),
        status=np.array([(status or {}).get(step, [0] * count) for step in range(steps)]),
        kinds=np.array([int(kind) for kind in kinds]), kind_names=np.array([kind.name for kind in kinds]),
        kind_colours=np.array([kind.colour for kind in kinds]), resultant=np.zeros((steps, 1, 3)), areas=np.full((steps, count), 1 / count))
    return Fields(mesh.nodes, mesh.cells, part, lame(mesh), u, [u[:, own[0]], u[:, own[1]] + apart], interfaces)


def iteration(i: int, **changes) -> Iteration:
    known = dict(iteration=i, sweeps=float(i + 5), seconds=0.1 * i, indicator=100.0**-i,
                  displacement_jump=10.0**-i / 3, force_imbalance=10.0**-i / 7, residual=10.0**-i,
                  error_bound=np.float64(2 * 10.0**-i) if i > 2 else np.nan, counts={"open": 0, "stick": i, "slip": 2},
                  target=("error_bound", 1e-6), state=np.full((4, 2), float(i)))
    known |= changes
    own = {name: known.pop(name) for name in ("target", "state", "counts", "laws", "coarse_ends") if name in known}
    return Iteration(known, **own)


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
