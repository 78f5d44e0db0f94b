"""Tables of nodes, faces and nodal forces beside a stiffness matrix."""

from __future__ import annotations

import numpy as np

from orchestrator.config.mesh import MatrixPart, ProgramPart
from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.scene.foreign.surfaces import bare, check_surface, holes, of_plane
from orchestrator.scene.foreign.joints import CUT, Joints, cut_in_triangles
from orchestrator.scene.number_table import Table


def joints(part: MatrixPart, path: KeyPath, name: str) -> Joints:
    """The nodes that faces are on, in the order of the matrix; of a flat joint without faces all nodes."""
    ids, points = nodes(part.nodes, (*path, "nodes"))
    return between(part, ids, points, ["joint"] * len(ids), path, name)


def between(part: MatrixPart | ProgramPart, ids: np.ndarray, points: np.ndarray, labels: list[str], path: KeyPath, name: str) -> Joints:
    """Joints of a part's nodes (n,) at points (n, 3), with the joint's name of each: between the faces of its table, or of a flat one
    between all nodes. A matrix has nodes that are on no joint.

    Raises InputError: no faces, faces of nodes of two joints, faces that are no surface
    """
    names = list(dict.fromkeys(labels))
    own, remarks = np.array([names.index(label) for label in labels]), []
    if part.facets is not None:
        faces = faces_of(part.facets, ids, (*path, "facets"))
    elif part.outward is not None and len(names) == 1:
        faces, remarks = of_plane(points, np.array(part.outward), (*path, "outward"), name)
    else:
        raise wrong(path, "neither facets nor outward" if len(names) == 1 else f"{len(names)} joints without facets",
                    "the faces that it meets others on", "add facets: a file with the ids of each face's nodes; or, of one flat "
                    "joint, outward: [0, 0, 1], its normal out of the part")
    kept = np.unique(np.concatenate([table.ravel() for table in faces])) if isinstance(part, MatrixPart) else np.arange(len(ids))
    place = np.zeros(len(ids), dtype=int)
    place[kept] = np.arange(len(kept))
    quadratic = any(table.shape[1] in (6, 8) for table in faces)
    triangles, owner, face = cut_in_triangles([place[table] for table in faces], points[kept], path, f"'{name}'")
    if part.facets is not None:
        check_surface(ids[kept], points[kept], triangles, (*path, "facets"), name)
        others = np.delete(points, kept[np.unique(triangles)], axis=0)
        remarks = bare(points[kept], triangles, others, name) or \
            holes(points[kept], triangles, quadratic, name)
    of_face = [own[table] for table in faces]
    mixed = next((ids[table[i, 0]] for table, labels in zip(faces, of_face)
                  for i in np.flatnonzero((labels != labels[:, :1]).any(axis=1))), None)
    if mixed is not None:
        raise wrong((*path, "facets"), f"a face at node {mixed} of '{name}' between nodes of two joints",
                    "faces whose nodes are of one joint", "name the joints of the nodes accordingly")
    joint = np.concatenate([labels[:, 0] for labels in of_face])[owner]
    left = np.zeros((6, 0)) if part.held is True else np.eye(6)
    return Joints(ids[kept], points[kept], triangles, joint, names, np.zeros((len(kept), 3), dtype=bool), left,
                  quadratic, np.zeros_like(face) if part.facets is None else face, remarks)


def nodes(file: str, path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """(n,) ids and (n, 3) coordinates, in the file's order.

    Raises InputError: lines that are not four numbers, ids that come twice, nodes at one place
    """
    return checked_nodes(_rows(file, path, "id, x, y, z"), file, path)


def checked_nodes(rows: list[tuple[int, list[float]]], file: str, path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """Nodes from lines with their numbers, checked."""
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


def forces_of(file: str, ids: np.ndarray, path: KeyPath) -> np.ndarray:
    """(3n, cases) nodal forces, of a table of lines id, fx, fy, fz, and three more for each further load step; in any order, 0 on
    nodes that it leaves out.

    Raises InputError: lines of other lengths, nodes that are not in the table ``ids`` (n,), nodes that come twice
    """
    rows, place = _rows(file, path, "id, fx, fy, fz"), {int(number): i for i, number in enumerate(ids)}
    width, seen = len(rows[0][1]), set()
    forces = np.zeros((len(ids), max(width - 1, 0)))
    for line, row in rows:
        if len(row) != width or width < 4 or (width - 1) % 3:
            raise _bad(path, file, line, f"{len(row)} numbers: {row[:5]}", "id, fx, fy, fz, and three more for each further load step")
        if row[0] not in place:
            raise _bad(path, file, line, f"node {row[0]:g}, which is not in the table of nodes", "nodes of that table")
        if row[0] in seen:
            raise _bad(path, file, line, f"node {row[0]:g} a second time", "each node once", "add its forces up")
        seen.add(row[0])
        forces[place[int(row[0])]] = row[1:]
    return forces.reshape(len(ids), -1, 3).transpose(0, 2, 1).reshape(3 * len(ids), -1)


def _rows(file: str, path: KeyPath, what: str) -> list[tuple[int, list[float]]]:
    """Return the lines with numbers, each with its number in the file."""
    table = Table(file, path, what)
    return list(zip(table.lines, table.rows))


def _bad(path: KeyPath, file: str, line: int, found: str, expected: str, cure: str = "mend the line") -> InputError:
    return wrong(path, f"{file}:{line}: {found}", expected, cure)
