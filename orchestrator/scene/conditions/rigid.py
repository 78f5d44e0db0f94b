"""Rigid motions: which of them boundary conditions leave, and in plain words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.errors import Problems, SHOWN, some
from orchestrator.scene.mesh.faces import by_label, components, Faces, pieces
from orchestrator.scene.mesh.geometry import format_point, unit
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.linalg import svd, WRITTEN

RIGID = 6  # motions of a rigid body
# Motions that move the prescribed components by less than this share of the body's size count as
# free.
HELD = 1e-8
# Beyond these, small perturbations do not hold: a rotation in radians (1 − cos is half a per cent
# there), and a
# displacement over the body's size.
ROTATION = DISPLACEMENT = 0.1
# How bodies that are meshed apart are made one.
JOINED = (
    "join it to them by an entry of interfaces, {between: auto, law: perfect}, which bonds faces "
    "that do not match as well")
MERGE = ('merge the nodes (pyvista: grid.clean(); gmsh: "Coherence Mesh", '
         "model.mesh.removeDuplicateNodes())")


@dataclass(frozen=True)
class Hinge:
    """Hinge that joins two bodies in points alone: an edge or a corner that they share, or few
    points of an interface.

    cells : one of either body
    points : (n, 3) where they move alike
    cure : how to have them joined wholly
    """

    cells: tuple[int, int]
    points: np.ndarray
    cure: str


def motions(nodes: np.ndarray) -> np.ndarray:
    """The six rigid motions (3n, 6) of nodes (n, 3): translations x, y, z, rotations about the
    centre.

    Rotations are divided by the body's size, so that all columns have entries of order one.
    """
    return motions_about(nodes, nodes.mean(axis=0), size_of(nodes)).reshape(-1, 6)


def motions_about(nodes: np.ndarray, centre: np.ndarray, size: float) -> np.ndarray:
    """Rigid motions (n, 3, 6), rotations about any ``centre`` (3,) and divided by any ``size``, a
    length.
    """
    arm = (nodes - centre) / size
    columns = np.zeros((len(nodes), 3, 6))
    columns[:, range(3), range(3)] = 1.0
    for axis in range(3):  # the axis' unit vector × arm
        after, last = (axis + 1) % 3, (axis + 2) % 3
        columns[:, after, 3 + axis], columns[:, last, 3 + axis] = -arm[:, last], arm[:, after]
    return columns


def size_of(nodes: np.ndarray) -> float:
    """Length scale of a body: the largest distance of a node (n, 3) from the centre, 1 for a
    point.
    """
    return float(np.sqrt(((nodes - nodes.mean(axis=0)) ** 2).sum(axis=1).max())) or 1.0


def left_over(nodes: np.ndarray, fixed: np.ndarray, kept: np.ndarray | None = None) -> np.ndarray:
    """Combinations (6, r) of the columns of ``motions`` that leave all fixed components at rest.

    nodes : (n, 3); fixed : (n, 3) bool
    kept : (q, 6) what else must rest, of a translation of the origin and a rotation about it; none
    """
    if not fixed.any() and kept is None:
        return np.eye(6)
    held = motions(nodes)[fixed.reshape(-1)]
    if kept is not None:
        centre, size = nodes.mean(axis=0), size_of(nodes)
        # (3, 6), what our columns move the origin by
        of_origin = motions_about(np.zeros((1, 3)), centre, size)[0]
        rows = kept[:, :3] @ of_origin
        rows[:, 3:] += kept[:, 3:] / size
        held = np.vstack([held, unit(rows)])
    return null_space(held)


def rigid_modes(nodes: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Orthonormal rigid motions (3n, r) that vanish on the fixed components; r = 6 when nothing is
    fixed.

    nodes : (n, 3) coordinates; fixed : (n, 3) bool
    """
    modes = np.linalg.qr(motions(nodes) @ left_over(nodes, fixed))[0]
    # Exact zeros where prescribed, whatever the rounding.
    modes[fixed.reshape(-1)] = 0.0
    return modes


def check_held(mesh: Mesh, faces: Faces, fixed: np.ndarray, problems: Problems,
               links: Sequence[np.ndarray] = (), grounds: Sequence[tuple[int, np.ndarray]] = (),
               hinges: Sequence[Hinge] = ()) -> None:
    """Adds a problem per piece of the mesh that can still move as a rigid body, with its motions
    and parts.

    links : (k, 2) int each, cells that an interface connects although they share no face; they
        hold each other
    grounds : a cell each, and what a ground keeps its body from, see ``left_over``
    hinges : what joins bodies in single points
    """
    count, piece = pieces(faces, np.zeros(len(mesh.cells), int))
    pairs = np.concatenate([np.empty((0, 2), int), *links])
    count, joined = components(*piece[pairs].T, count)
    piece = joined[piece]
    cells = by_label(piece)
    own = [np.unique(mesh.cells[chosen]) for chosen in cells]
    hint = _touching(mesh, own) if count > 1 else None
    kept = [[rows for cell, rows in grounds if piece[cell] == i] for i in range(count)]
    left = [left_over(mesh.nodes[nodes], fixed[nodes], np.concatenate(rows) if rows else None)
            for nodes, rows in zip(own, kept)]
    hinges = [hinge for hinge in hinges if piece[hinge.cells[0]] != piece[hinge.cells[1]]]
    _hold_by_hinges([mesh.nodes[nodes] for nodes in own], left, hinges,
                    [tuple(piece[list(hinge.cells)]) for hinge in hinges])
    named = [[mesh.volumes[v] for v in np.unique(mesh.volume[chosen])] for chosen in cells]
    for i, (nodes, free) in enumerate(zip(own, left)):
        if free.shape[1] == 0:
            continue
        points = mesh.nodes[nodes]
        parts = named[i]
        where = (
            "" if count == 1
            else f" (one of {count} separate bodies, centre {format_point(points.mean(axis=0))})")
        shown = some(parts, 6)
        cure = "prescribe more displacement components, on faces that do not lie on one line"
        said = list(dict.fromkeys(hinge.cure for hinge in hinges if i in piece[list(hinge.cells)]))
        if said:
            cure = "; ".join([cure, *said[:SHOWN]])
        elif hint is not None and hint[i] and set(parts) <= {
                v for j, names in enumerate(named) if j != i for v in names}:
            cure = (f"{hint[i]} of its nodes coincide with nodes of another piece of the same "
                    "volume that are numbered separately: nothing joins the pieces, and "
                    f"interfaces join different volumes alone: {MERGE}; or, where the pieces are "
                    "bodies of their own, give each a volume, and join them by an entry of "
                    f"interfaces; otherwise {cure}")
        elif hint is not None and hint[i]:
            cure = (
                f"{hint[i]} of its nodes coincide with nodes of other bodies that are numbered "
                "separately, but their faces do not match: if the parts are meant to "
                "touch, " + JOINED
                + ", or merge them; otherwise " + cure)
        elif hint is not None:
            cure += (
                f"; if it is meant to touch others, {JOINED}; or let contact with gap: geometry "
                "hold it, which reaches over gaps")
        problems.add(("boundary",),
                     f"{shown}{where} can still move as a rigid body: {describe(free, points)}",
                     "boundary conditions that hold every body", cure)


def _hold_by_hinges(nodes: list[np.ndarray], left: list[np.ndarray], hinges: Sequence[Hinge],
                    bodies: Sequence[tuple[int, int]]) -> None:
    """Takes from the motions ``left`` of bodies, in place, what hinges stop: in their points,
    bodies on both sides move alike.

    nodes : (n, 3) of each body; bodies : the two of each hinge
    """
    if not hinges:
        return
    _, label = components(*np.array(bodies, int).T, len(nodes))
    for chain in np.unique(label[np.array(bodies).ravel()]):
        chosen = np.flatnonzero(label == chain)
        ends = np.cumsum([0] + [left[i].shape[1] for i in chosen])
        if not ends[-1]:
            continue
        columns = {i: slice(a, b) for i, a, b in zip(chosen, ends[:-1], ends[1:])}
        rows = [np.zeros((0, ends[-1]))]
        for hinge, pair in zip(hinges, bodies):
            if pair[0] in columns:
                rows.append(np.zeros((3 * len(hinge.points), ends[-1])))
                for i, sign in zip(pair, (1.0, -1.0)):
                    moved = motions_about(hinge.points, nodes[i].mean(axis=0),
                                          size_of(nodes[i])).reshape(-1, 6)
                    rows[-1][:, columns[i]] = sign * moved @ left[i]
        free = null_space(np.concatenate(rows))
        for i in chosen:
            own, values, _ = svd(left[i] @ free[columns[i]], full_matrices=False)
            left[i] = own[:, values > np.sqrt(HELD)]


def null_space(rows: np.ndarray) -> np.ndarray:
    """(m, r) orthonormal, what rows (n, m) of entries of order one send to zero."""
    # The triangular factor has the singular values of the tall matrix.
    _, values, turned = svd(np.linalg.qr(rows, mode="r") if len(rows) > rows.shape[1] else rows,
                            full_matrices=True)
    values = np.r_[values, np.zeros(rows.shape[1] - len(values))]
    return turned[values <= HELD * np.sqrt(len(rows))].T


def _touching(mesh: Mesh, own: list[np.ndarray]) -> list[int]:
    """Per body, how many of its nodes lie on another node of another body."""
    from scipy.spatial import cKDTree  # for this complaint alone

    nodes = np.concatenate(own)
    body = np.repeat(np.arange(len(own)), [len(o) for o in own])
    reach = WRITTEN * mesh.diagonal
    near = cKDTree(mesh.nodes[nodes]).query_pairs(reach, output_type="ndarray")
    near = near[(body[near[:, 0]] != body[near[:, 1]]) & (nodes[near[:, 0]] != nodes[near[:, 1]])]
    return np.bincount(body[np.unique(near)], minlength=len(own)).tolist()


def describe(free: np.ndarray, nodes: np.ndarray) -> str:
    """Plain words for combinations (6, r) of the rigid motions of nodes (n, 3)."""
    if free.shape[1] == 6:
        return "every translation and every rotation (nothing holds it)"
    centre, size = nodes.mean(axis=0), size_of(nodes)
    # Rotations first: rows reduced to "one rotation each, then pure translations".
    rows = _reduced(np.c_[free.T[:, 3:], free.T[:, :3]])
    words = []
    for row in rows:
        turn, shift = row[:3], row[3:]
        if np.linalg.norm(turn) < 1e-6:
            words.append(f"translation along {_direction(shift)}")
            continue
        # turn/size is the angular velocity; the axis is where the motion vanishes across it.
        through = centre + size * np.cross(turn, shift) / (turn @ turn)
        words.append(
            f"rotation about the {_direction(turn)} axis through "
            f"{format_point(_clean(through, size))}")
    return ", ".join(reversed(words))


def _reduced(rows: np.ndarray) -> np.ndarray:
    """Reduced row echelon form, pivots by size within a column."""
    rows, at = rows.copy(), 0
    for column in range(rows.shape[1]):
        if at == len(rows):
            break
        pivot = at + int(np.argmax(np.abs(rows[at:, column])))
        if abs(rows[pivot, column]) < 1e-6:
            rows[at:, column] = 0.0
            continue
        rows[[at, pivot]] = rows[[pivot, at]]
        rows[at] /= rows[at, column]
        others = np.arange(len(rows)) != at
        rows[others] -= rows[others, column][:, None] * rows[at]
        at += 1
    return rows


def _direction(vector: np.ndarray) -> str:
    along = unit(vector)
    axis = int(np.argmax(np.abs(along)))
    if abs(along[axis]) > 1 - 1e-9:
        return "xyz"[axis]
    return format_point(_clean(np.round(along, 4), 1.0))


def _clean(point: np.ndarray, size: float) -> np.ndarray:
    """Coordinates without the dust of rounding."""
    return np.where(np.abs(point) < 1e-9 * size, 0.0, point)
