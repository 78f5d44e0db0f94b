"""A stiffness matrix from a file, with a table of its nodes and its loads.

Tables of nodes, faces and nodal forces beside a stiffness matrix.
"""

from __future__ import annotations

import gzip
from collections.abc import Container, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.config.mesh import MatrixPart, ProgramPart
from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.linalg import PLACED, WRITTEN
from orchestrator.scene.conditions.rigid import motions
from orchestrator.scene.foreign.condensed import check_modulus, condense, Condensed, judged
from orchestrator.scene.foreign.joints import CUT, cut_in_triangles, Joints, read_joints
from orchestrator.scene.foreign.surfaces import bare, check_surface, holes, of_plane
from orchestrator.scene.mesh.checks import check_memory
from orchestrator.scene.mesh.readers.inp_model import place
from orchestrator.scene.number_table import NumberTable


def joints(part: MatrixPart, path: KeyPath, name: str) -> Joints:
    """The nodes that faces are on, in the order of the matrix; of a flat joint without faces all
    nodes.
    """
    ids, points = nodes(part.nodes, (*path, "nodes"))
    return between(part, ids, points, ["joint"] * len(ids), path, name)


def between(part: MatrixPart | ProgramPart, ids: np.ndarray, points: np.ndarray, labels: list[str],
            path: KeyPath, name: str) -> Joints:
    """Joints of a part's nodes (n,) at points (n, 3), with the joint's name of each: between the
    faces of its table, or of a flat one
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
        raise wrong(path, "neither facets nor outward" if len(names) == 1
                    else f"{len(names)} joints without facets",
                    "the faces that it meets others on",
                    "add facets: a file with the ids of each face's nodes; or, of one flat "
                    "joint, outward: [0, 0, 1], its normal out of the part")
    kept = np.unique(np.concatenate([table.ravel() for table in faces])) if isinstance(
        part, MatrixPart) else np.arange(len(ids))
    place = np.zeros(len(ids), dtype=int)
    place[kept] = np.arange(len(kept))
    quadratic = any(table.shape[1] in (6, 8) for table in faces)
    triangles, owner, face = cut_in_triangles([place[table] for table in faces], points[kept], path,
                                              f"'{name}'")
    if part.facets is not None:
        check_surface(ids[kept], points[kept], triangles, (*path, "facets"), name)
        others = np.delete(points, kept[np.unique(triangles)], axis=0)
        remarks = bare(points[kept], triangles, others, name) or \
            holes(points[kept], triangles, quadratic, name)
    of_face = [own[table] for table in faces]
    mixed = next((ids[table[i, 0]] for table, labels in zip(faces, of_face)
                  for i in np.flatnonzero((labels != labels[:, :1]).any(axis=1))), None)
    if mixed is not None:
        raise wrong((*path, "facets"),
                    f"a face at node {mixed} of '{name}' between nodes of two joints",
                    "faces whose nodes are of one joint",
                    "name the joints of the nodes accordingly")
    joint = np.concatenate([labels[:, 0] for labels in of_face])[owner]
    left = np.zeros((6, 0)) if part.held is True else np.eye(6)
    return Joints(ids[kept], points[kept], triangles, joint, names,
                  np.zeros((len(kept), 3), dtype=bool), left,
                  quadratic, np.zeros_like(face) if part.facets is None else face, remarks)


def nodes(file: str, path: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """(n,) ids and (n, 3) coordinates, in the file's order.

    Raises InputError: lines that are not four numbers, ids that come twice, nodes at one place
    """
    table = NumberTable(file, path, "id, x, y, z")
    return checked_nodes(table.rows, file, path, table.lines)


def checked_nodes(rows: list[list[float]], file: str, path: KeyPath,
                  lines: Sequence[int] = range(1, 1 << 62)) -> tuple[np.ndarray, np.ndarray]:
    """Nodes from the numbers of lines, checked; default: of the file's first lines."""
    def bad(line: int, found: str, expected: str, cure: str = "mend the line") -> InputError:
        return wrong(path, f"{file}:{line}: {found}", expected, cure)

    for line, row in zip(lines, rows):
        if len(row) != 4 or row[0] != int(row[0]):
            raise bad(line, f"{len(row)} numbers: {row[:5]}", "id, x, y, z for each node")
    table = np.array(rows)
    ids, points = table[:, 0].astype(int), table[:, 1:]
    order = np.argsort(ids, kind="stable")
    twice = np.flatnonzero(np.diff(ids[order]) == 0)
    if len(twice):
        again = order[twice[0] + 1]
        raise bad(lines[again], f"node {ids[again]} a second time", "each node once",
                   "leave one of the lines out")
    order = np.lexsort(points.T)
    same = np.flatnonzero((np.diff(points[order], axis=0) == 0).all(axis=1))
    if len(same):
        one, two = ids[order[same[0]]], ids[order[same[0] + 1]]
        raise bad(lines[order[same[0] + 1]], f"nodes {one} and {two} at one place",
                   "nodes that are apart",
                   "merge them in the model, or leave one of them out of the joint")
    return ids, points


def faces_of(file: str, ids: np.ndarray, path: KeyPath) -> list[np.ndarray]:
    """Tables (f, 3, 4, 6 or 8) int of places in ``ids``."""
    place = {int(number): i for i, number in enumerate(ids)}
    found: dict[int, list[list[int]]] = {}
    table = NumberTable(file, path, "ids of the nodes of a face")
    for line, row in zip(table.lines, table.rows):
        if len(row) not in CUT:
            table.fail(line, f"a face of {len(row)} nodes", "faces of 3, 4, 6 or 8 nodes")
        _check_known(table, line, row, place)
        found.setdefault(len(row), []).append([place[int(number)] for number in row])
    return [np.array(faces) for faces in found.values()]


def forces_of(file: str, ids: np.ndarray, path: KeyPath) -> np.ndarray:
    """(3n, cases) nodal forces, of a table of lines id, fx, fy, fz, and three more for each further
    load step; in any order, 0 on
    nodes that it leaves out.

    Raises InputError: lines of other lengths, nodes that are not in the table ``ids`` (n,), nodes
    that come twice
    """
    table = NumberTable(file, path, "id, fx, fy, fz")
    place, width, seen = {int(number): i for i, number in enumerate(ids)}, len(table.rows[0]), set()
    forces = np.zeros((len(ids), max(width - 1, 0)))
    for line, row in zip(table.lines, table.rows):
        if len(row) != width or width < 4 or (width - 1) % 3:
            table.fail(line, f"{len(row)} numbers: {row[:5]}",
                       "id, fx, fy, fz, and three more for each further load step")
        _check_known(table, line, row[:1], place)
        if row[0] in seen:
            table.fail(line, f"node {row[0]:g} a second time", "each node once",
                       "add its forces up")
        seen.add(row[0])
        forces[place[int(row[0])]] = row[1:]
    return forces.reshape(len(ids), -1, 3).transpose(0, 2, 1).reshape(3 * len(ids), -1)


def _check_known(table: NumberTable, line: int, numbers: list[float], known: Container) -> None:
    if unknown := [number for number in numbers if number not in known]:
        table.fail(line, f"node {unknown[0]:g}, which is not in the table of nodes",
                   "nodes of that table")


ENTRY = 24  # bytes: two places and a value
SAMPLE = 2000  # entries whose digits are counted
FULL = 15  # digits from which a double is written as it is, but for its last bits


def condensed(part: MatrixPart, path: KeyPath, name: str, steps: int,
              young: float | None) -> Condensed:
    """Return the part on its joints.

    path : of its entry in the YAML; name : of the part
    steps : load steps; young : a representative modulus, None: not known
    Raises InputError: files that cannot be read, a matrix that can be no stiffness of these nodes
    """
    joints = read_joints(part, path, name)
    ids, points = nodes(part.nodes, (*path, "nodes"))
    K = _matrix(part.stiffness, (*path, "stiffness"), name)
    if K.shape != (3 * len(ids),) * 2:
        raise wrong((*path, "stiffness"),
                    f"'{name}': a matrix of {K.shape[0]} × {K.shape[1]} for {len(ids)} nodes",
                    f"{3 * len(ids)} rows and columns: three dofs, ux uy uz, for each node "
                    "of the table", "write the table of just the matrix's nodes, in its order; "
                    "condense rotations of shells and beams out of it")
    loads = np.zeros((1, K.shape[0])) if part.loads is None else _loads(
        part, ids, steps, path, name)
    apart, size = abs(K - K.T).max(), np.abs(K.data).max(initial=0.0)
    if apart > WRITTEN * size:
        raise wrong((*path, "stiffness"),
                    f"'{name}': a stiffness that is not symmetric: |K − Kᵀ| is {apart / size:.1e} "
                    "|K|", "a symmetric one",
                    "write both halves, or the lower one with 'symmetric' in the file's head")
    dofs = (3 * place(ids, joints.ids)[:, None] + np.arange(3)).ravel()
    rounding = _rounding(Path(part.stiffness))
    _check_places(K, points, ids, rounding, (*path, "nodes"), name)
    S, b, error = condense(K, loads, dofs, path, name, rounding)
    made = judged(joints, S, b, (*path, "stiffness"), name, error)
    check_modulus(made, young, (*path, "stiffness"), name)
    return made


def _check_places(K: sp.csr_array, points: np.ndarray, ids: np.ndarray, rounding: float,
                  path: KeyPath, name: str) -> None:
    """Raises InputError where nodes (n, 3) are not where the matrix (3n, 3n) has them. In the rows
    of a node without a support beside it,
    K vanishes on all rigid motions, held or not. Where it vanishes on translations and not on
    rotations, the node or one that it is
    connected with is elsewhere."""
    R = motions(points)
    terms = sp.csr_array((np.abs(K.data), K.indices, K.indptr), K.shape) @ np.abs(R)
    left = np.abs(K @ R) / np.where(terms > 0, terms, 1.0)
    of_node = left.reshape(len(points), 3, 6).max(axis=1)
    bad = (of_node[:, :3].max(axis=1) <= max(PLACED, 10 * rounding)) & (
        of_node[:, 3:].max(axis=1) > 100 * max(PLACED, 10 * rounding))
    if bad.any():
        worst = np.where(bad, of_node[:, 3:].max(axis=1), 0).argmax()
        raise wrong(path,
                    f"'{name}': at {bad.sum()} of {len(points)} nodes rotations cost force, and "
                    f"translations do not, most at node {ids[worst]}",
                    "a stiffness that vanishes on rigid motions of the nodes that the table "
                    "gives, but beside supports",
                    "the table of nodes is in another order than the matrix, nodes are exchanged "
                    "or in other units than the model was, or displacements are turned: write it "
                    "in the matrix's own order and axes")


def _matrix(file: str, path: KeyPath, name: str) -> sp.csr_array:
    from scipy.io import mminfo, mmread  # such parts alone need it

    try:
        rows, columns, entries, *_ = mminfo(file)
        check_memory(ENTRY * max(entries, rows + columns), path,
                     f"{file}, of {rows:,} × {columns:,} with {entries:,} entries",
                     "condense it to the joint")
        K = mmread(file)
    except (OSError, ValueError, TypeError, OverflowError) as error:
        raise wrong(path, f"{file}: {str(error) or type(error).__name__}",
                    "a matrix in MatrixMarket's format",
                    "begin it with %%MatrixMarket matrix coordinate real symmetric") from error
    K = sp.csr_array(K)
    if K.dtype.kind not in "fiu":
        raise wrong(path, f"{file}: entries of type {K.dtype}", "real numbers",
                    "write the matrix of a static analysis")
    K = K.astype(float)
    if not np.isfinite(K.data).all():
        raise wrong(path, f"{file}: entries of '{name}' that are not finite", "numbers",
                    "write the file again")
    return K


def _loads(part: MatrixPart, ids: np.ndarray, steps: int, path: KeyPath, name: str) -> np.ndarray:
    """(1 or steps, 3n) forces on nodes (n,)."""
    columns, size = [], 3 * len(ids)
    for i, file in enumerate(part.loads):
        at = (*path, "loads", i) if len(part.loads) > 1 else (*path, "loads")
        # else MatrixMarket's, or not there
        listed = not file.endswith((".gz", ".bz2")) and Path(file).is_file()
        if listed:
            with Path(file).open(errors="replace") as lines:
                listed = not lines.readline().lower().startswith("%%matrixmarket")
        found = forces_of(file, ids, at) if listed else _matrix(file, at, name).toarray()
        if found.shape[0] != size:
            raise wrong(at, f"{file}: {found.shape[0]} rows",
                        f"{size}, as the stiffness of '{name}' has",
                        "write forces on just the matrix's dofs")
        columns.append(found)
    loads = np.hstack(columns).T
    if len(loads) not in (1, steps):
        raise wrong((*path, "loads"), f"{len(loads)} columns of loads for {steps} load steps",
                    "one column for all load steps, or one for each",
                    "let history multiply a single column")
    return loads


def _rounding(file: Path) -> float:
    """Relative error of entries that have few digits: half a unit in the last place of the leading
    digit 1; 0 with 15 or more.
    """
    most, seen = 0, 0
    with (gzip.open(file, "rt") if file.suffix == ".gz" else file.open(errors="replace")) as lines:
        for line in lines:
            words = line.split()
            if line.startswith("%") or not words or seen == 0:
                seen += not line.startswith("%")
                continue
            mantissa = words[-1].lower().split("e")[0].split("d")[0].lstrip("+-").replace(
                ".", "").lstrip("0")
            most, seen = max(most, len(mantissa)), seen + 1
            if seen > SAMPLE or most >= FULL:
                break
    return 0.0 if most >= FULL or not most else 0.5 * 10.0 ** (1 - most)
