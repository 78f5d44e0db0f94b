"""Tables of nodes and faces beside a stiffness matrix: numbers in lines, separated by commas or blanks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orchestrator.config.foreign_parts import MatrixPart
from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.conditions.rigid import size_of
from orchestrator.scene.foreign.joints import CUT, Joints, cut_in_triangles
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quality import format_point

# Nodes this near one plane, in units of the joint's extent, are on it.
PLANE = 1e-6
# Triangles between nodes on a plane that are thinner than this share of their longest edge squared lie along its border.
THIN = 1e-6
# Between nodes that are spread evenly triangles are at most this much larger than the smallest at their corners: twice on
# grids without the nodes in the middle of squares, three times on irregular ones. Above the second there is a void.
UNEVEN, VOID = 1.6, 3.5


def joints(part: MatrixPart, path: KeyPath, name: str) -> Joints:
    """The nodes that faces are on, in the order of the matrix; of a flat joint without faces all nodes."""
    (ids, points), remarks = nodes(part.nodes, (*path, "nodes")), []
    if part.facets is not None:
        faces = faces_of(part.facets, ids, (*path, "facets"))
    elif part.outward is not None:
        faces, remarks = of_plane(points, np.array(part.outward), (*path, "outward"), name)
    else:
        raise InputError(Problem(path, "neither facets nor outward", "the faces that it meets others on",
                                 "add facets: a file with the ids of each face's nodes; or, where all nodes lie on one plane, "
                                 "outward: [0, 0, 1], its normal out of the part"))
    used = np.unique(np.concatenate([table.ravel() for table in faces]))
    place = np.zeros(len(ids), dtype=int)
    place[used] = np.arange(len(used))
    triangles, _, face = cut_in_triangles([place[table] for table in faces], points[used], path, f"'{name}'")
    left = np.zeros((6, 0)) if part.held is True else np.eye(6)
    return Joints(ids[used], points[used], triangles, np.zeros(len(triangles), dtype=int), ["joint"],
                  np.zeros((len(used), 3), dtype=bool), left, any(table.shape[1] in (6, 8) for table in faces),
                  np.zeros_like(face) if part.facets is None else face, remarks)


def nodes(file: str, path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """(n,) ids and (n, 3) coordinates, in the file's order.

    Raises
    ------
    InputError : lines that are not four numbers, ids that come twice, nodes at one place
    """
    return checked_nodes(_rows(file, path, "id, x, y, z"), file, path)


def checked_nodes(rows: list[tuple[int, list[float]]], file: str, path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """The same from lines with their numbers."""
    for line, row in rows:
        if len(row) != 4 or row[0] != int(row[0]):
            raise _bad(path, file, line, f"{len(row)} numbers: {row[:5]}", "id, x, y, z for each node")
    table = np.array([row for _, row in rows])
    ids, points = table[:, 0].astype(int), table[:, 1:]
    order = np.argsort(ids, kind="stable")
    twice = np.flatnonzero(np.diff(ids[order]) == 0)
    if len(twice):
        again = order[twice[0] + 1]
        raise _bad(path, file, rows[again][0], f"node {ids[again]} a second time", "each node once", "leave one of the lines out")
    order = np.lexsort(points.T)
    same = np.flatnonzero((np.diff(points[order], axis=0) == 0).all(axis=1))
    if len(same):
        one, two = ids[order[same[0]]], ids[order[same[0] + 1]]
        raise _bad(path, file, rows[order[same[0] + 1]][0], f"nodes {one} and {two} at one place", "nodes that are apart",
                   "merge them in the model, or leave one of them out of the joint")
    return ids, points


def faces_of(file: str, ids: np.ndarray, path: KeyPath) -> list[np.ndarray]:
    """Tables (f, 3, 4, 6 or 8) int of places in ``ids``."""
    place = {int(number): i for i, number in enumerate(ids)}
    found: dict[int, list[list[int]]] = {}
    for line, row in _rows(file, path, "ids of the nodes of a face"):
        if len(row) not in CUT:
            raise _bad(path, file, line, f"a face of {len(row)} nodes", "faces of 3, 4, 6 or 8 nodes")
        unknown = [number for number in row if number not in place]
        if unknown:
            raise _bad(path, file, line, f"node {unknown[0]:g}, which is not in the table of nodes", "nodes of that table")
        found.setdefault(len(row), []).append([place[int(number)] for number in row])
    return [np.array(table) for table in found.values()]


def of_plane(points: np.ndarray, outward: np.ndarray, path: KeyPath, name: str) -> tuple[list[np.ndarray], list[str]]:
    """Triangles (k, 3) between the nodes of a flat joint, outward, and what is to be said of them.

    Raises
    ------
    InputError : nodes off the plane; triangles across what may be a void
    """
    from scipy.spatial import Delaunay  # for joints without faces alone

    normal = outward / (np.linalg.norm(outward) or 1.0)
    off = np.abs((points - points.mean(axis=0)) @ normal).max()
    if not np.linalg.norm(outward) or off > PLANE * size_of(points) or len(points) < 3:
        raise InputError(Problem(path, f"nodes of '{name}' that are up to {off:.3g} off a plane across {outward.tolist()}",
                                 "three nodes or more on one plane", "give the normal of the joint's plane, or facets: a file with "
                                 "the joint's faces"))
    first = np.linalg.svd(normal[None])[2][1:]
    triangles = Delaunay(points @ first.T).simplices.astype(int)
    signed = area_vectors(points, triangles) @ normal
    longest = np.max([np.sum((points[triangles[:, i]] - points[triangles[:, i - 1]]) ** 2, axis=1) for i in range(3)], axis=0)
    there = np.abs(signed) > THIN * longest  # slivers along straight edges are rounding
    triangles[signed < 0] = triangles[signed < 0][:, ::-1]
    triangles, area = triangles[there], np.abs(signed[there])
    least = np.full(len(points), np.inf)
    np.minimum.at(least, triangles, area[:, None])
    beside = area / np.median(least[triangles], axis=1)
    where = points[triangles[beside.argmax()]].mean(axis=0)
    made = f"{area.sum():.4g} of area between the {len(points)} nodes of '{name}'"
    if beside.max() > VOID:
        raise InputError(Problem(path, f"{made}, with a face {beside.max():.2g} times as large as those beside it, at {format_point(where)}: "
                                 "there may be a void", "nodes spread evenly over a joint that fills its convex hull",
                                 "give facets: a file with the joint's faces"))
    large = area[beside > UNEVEN].sum()
    return [triangles], [f"{made} are its joint, up to their convex hull" + (
        f", {large:.4g} of it in faces more than {UNEVEN:g} times as large as those beside them, the largest at {format_point(where)}"
        if large else "") + "; if there is a void, give facets"]


def _rows(file: str, path: KeyPath, what: str) -> list[tuple[int, list[float]]]:
    """Lines with numbers, each with its number; comments (#) and a heading are passed over."""
    found = []
    try:
        lines = Path(file).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(Problem(path, f"{file}: {error.strerror}", "a file that is there")) from error
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            if found:
                raise _bad(path, file, number, f"'{line.strip()}'", what) from None
            continue
        if not np.isfinite(row).all():
            raise _bad(path, file, number, f"'{line.strip()}'", "finite numbers")
        found.append((number, row))
    if not found:
        raise InputError(Problem(path, f"{file}: no numbers", f"lines of {what}"))
    return found


def _bad(path: KeyPath, file: str, line: int, found: str, expected: str, cure: str = "mend the line") -> InputError:
    return InputError(Problem(path, f"{file}:{line}: {found}", expected, cure))
