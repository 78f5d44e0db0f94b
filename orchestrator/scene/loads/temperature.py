"""``temperature``: thermal strain of matter that expands, as strain without stress and as nodal
forces.

With ε₀ = α ΔT 1, linear on every tet from its corners, σ = C (ε − ε₀) and the forces are

    f = ∫ Bᵀ C ε₀ = ∫ (3λ + 2μ) α ΔT ∇φ

exact for four-node tets (constant gradients) and for ten-node ones (linear ones: a rule of four
points). They are in balance by themselves on every tet.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Name, Part, Vector, either
from orchestrator.errors import InputError, KeyPath, Problem, Problems
from orchestrator.linalg import PLACED, WRITTEN
from orchestrator.scene.elasticity import lame
from orchestrator.scene.loads.base import VolumePlace, Kind, Strain
from orchestrator.scene.mesh.geometry import format_point, shape_gradients, summed, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import TET_EDGES, TET_POINTS, quadratic_slopes
from orchestrator.scene.number_table import NumberTable

# A row of a file belongs to the node that is that near, over the mesh's diagonal: files have six
# digits or more. But not where
# that is more than a share of the shortest edge there: then the row of the next node of a thin part
# is as near.
SAME_PLACE, OF_EDGE = 1e-5, 0.1


class TemperatureField(Part):
    """A temperature that varies: linearly in space, or as a file says node by node."""

    value: float = Field(0.0, description="at the point `at`")
    at: Vector | None = Field(None, description="a point; comes with `gradient`")
    gradient: Vector | None = Field(None, description="change per length along x, y and z")
    file: Name | None = Field(None, description=(
        "text file relative to the YAML file, in place of the others: rows x y z T, a row for "
        "every node, or a column of temperatures for each load step"))


class Temperature(Kind):
    takes = either(TemperatureField, float,
                   lambda value: isinstance(value, (dict, TemperatureField)),
                   "a number, or {at: [0, 0, 10], gradient: [0, 0, 2.5]}, or {file: warm.csv}")
    meaning = (
        "temperature above the one without stress, by the materials' expansion: a number, {value, "
        "at, gradient} or {file}")
    files = ("file",)

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        if not isinstance(value, dict):
            return
        given = [key for key in TemperatureField.model_fields if value.get(key) is not None]
        if given != ["file"] and set(given) not in ({"at", "gradient"},
                                                    {"value", "at", "gradient"}):
            yield Problem(path, " and ".join(given) or "nothing",
                          "a file alone, or at and gradient together, with a value or without",
                          "write a number where it is the same everywhere, {at: [x, y, z], "
                          "gradient: [a, b, c]} or {file: warm.csv}")

    @classmethod
    def made(cls, value: Any, where: VolumePlace) -> Strain | None:
        alpha = where.of_matter("expansion",
                                "add expansion: to the material, strain per temperature (steel: "
                                "1.2e-5 per kelvin)")
        if alpha is None:
            return None
        if not len(where.cells):  # with a problem, or on other ranks
            return Strain(np.zeros((len(where.factors), 0, 4)))
        corners = where.mesh.cells[where.cells, :4]
        nodes = np.unique(corners)
        warmth = _at_nodes(where.mesh, nodes, value, where.factors, where.path, where.problems)
        return None if warmth is None else Strain(alpha[:, None]
                                                  * warmth[:, np.searchsorted(nodes, corners)])


def _at_nodes(mesh: Mesh, nodes: np.ndarray, given: Any, times: np.ndarray, path: KeyPath,
              problems: Problems) -> np.ndarray | None:
    """(steps, k) temperatures of nodes (k,); None with a problem."""
    if isinstance(given, float | int):
        return np.outer(times, np.full(len(nodes), float(given)))
    points = mesh.nodes[nodes]
    if given.file is None:
        return np.outer(times, given.value + (points - given.at) @ given.gradient)
    size = mesh.diagonal
    reach = np.minimum(SAME_PLACE * size, OF_EDGE * _shortest_edges(mesh)[nodes])
    return _of_file(Path(given.file), points, reach, size, times, (*path, "file"), problems)


def _shortest_edges(mesh: Mesh) -> np.ndarray:
    """(n,) length of the shortest edge at each node, infinite where there is none."""
    result = np.full(len(mesh.nodes), np.inf)
    for edge in TET_EDGES:
        ends = mesh.cells[:, edge].T
        length = np.linalg.norm(np.diff(mesh.nodes[ends], axis=0)[0], axis=1)
        for end in ends:
            np.minimum.at(result, end, length)
    return result


def _of_file(path: Path, points: np.ndarray, reach: np.ndarray, size: float, times: np.ndarray,
             key: KeyPath,
             problems: Problems) -> np.ndarray | None:
    """(steps, k) from the rows x y z T of a file, or x y z T₁ T₂ … with one column per load
    step.
    """
    expected = (
        f"rows of numbers x y z T, or x y z and {len(times)} temperatures, one per load step; # "
        "begins a comment")
    try:
        table = NumberTable(path, key, expected)
        lines, rows = table.lines, table.array()
    except InputError as error:
        problems.found += error.problems
        return None
    if rows.shape[1] not in (4, 3 + len(times)):
        problems.add(key, f"{path}: {rows.shape[1]} columns in {len(rows)} rows", expected,
                     "write such a file, for instance with numpy.savetxt")
        return None
    from scipy.spatial import cKDTree  # temperatures from files alone need it

    tree = cKDTree(rows[:, :3])
    distance, nearest = tree.query(points)
    far = distance > reach
    if far.any():
        worst = int(np.where(far, distance, 0.0).argmax())
        problems.add(key,
                     f"{path}: no row for {far.sum()} of {len(points)} nodes; the one at "
                     f"{format_point(points[worst])} is {distance[worst]:.3g} from the nearest row",
                     f"a row for every node of the volumes, within {reach[worst]:.2g}",
                     "write the nodes' own coordinates, in the mesh's unit of length, after scale "
                     "and move")
        return None
    # rows that are as near, but for the digits that coordinates are written with: any of them may
    # be meant
    near = tree.query_ball_point(points, 2 * distance + PLACED * size)
    counts = np.fromiter(map(len, near), int, len(near))
    start, chosen = np.r_[0, counts.cumsum()[:-1]], np.concatenate(near).astype(int)
    spread = np.abs(rows[chosen, 3:] - rows[np.repeat(nearest, counts), 3:]).max(axis=1)
    if spread.max(initial=0.0) > WRITTEN * np.abs(rows[:, 3:]).max():
        worst = int(spread.argmax())
        at = int(np.searchsorted(start, worst, side="right")) - 1
        column = 3 + int(np.abs(rows[chosen[worst], 3:] - rows[nearest[at], 3:]).argmax())
        one, other = sorted((nearest[at], chosen[worst]))
        problems.add(key,
                     f"{path}: two temperatures at {format_point(points[at])}: "
                     f"{rows[one, column]:.6g} on line {lines[one]} and "
                     f"{rows[other, column]:.6g} on line {lines[other]}",
                     "one temperature at each place",
                     "where bodies of different temperature touch, write a file for each of them, "
                     "and an entry of loads with on: and that file")
        return None
    return times[:, None] * rows[nearest, 3:].T


def thermal_loads(mesh: Mesh, strain: np.ndarray, materials: Sequence[Any],
                  cell_material: np.ndarray, at: np.ndarray,
                  loads: np.ndarray) -> None:
    """Adds the forces of thermal strain (steps, m, 4) to ``loads`` (steps, N, 3), at the cells'
    nodes ``at`` (m, 4 or 10).
    """
    cells = np.flatnonzero(strain.any(axis=(0, 2)))
    gradients, volume = shape_gradients(mesh.nodes, mesh.cells[cells])
    first, second = np.array([lame(m.young, m.poisson) for m in materials])[cell_material[cells]].T
    stiff = (3 * first + 2 * second) * volume
    at = at[cells]
    for step, own in enumerate(strain[:, cells]):
        if mesh.cells.shape[1] == 4:
            forces = (stiff * own.mean(axis=1))[:, None, None] * gradients
        else:
            forces = sum(np.einsum("k,ab,kbx->kax", stiff / 4 * (own @ p), quadratic_slopes(p),
                                   gradients) for p in TET_POINTS[10])
        loads[step] += summed(at, forces, loads.shape[1])


def strained_energy(mesh: Mesh, strain: np.ndarray, lames: np.ndarray) -> np.ndarray:
    """(steps,) ½ ∫ ε₀ : C ε₀, what matter would store if nothing moved.

    strain : (steps, m, 4); lames : (m, 2) λ and μ of each cell
    """
    square = np.einsum("tma,ab,tmb->tm", strain, (1 + np.eye(4)) / 20, strain)  # mean over the tet
    return square @ (1.5 * (3 * lames[:, 0] + 2 * lames[:, 1])
                     * np.abs(tet_volumes(mesh.nodes, mesh.cells)))
