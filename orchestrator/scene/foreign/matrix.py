"""A stiffness matrix from a file, with a table of its nodes and its loads."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from orchestrator.config.mesh import MatrixPart
from orchestrator.errors import KeyPath, wrong
from orchestrator.scene.conditions.rigid import motions_about, size_of
from orchestrator.scene.foreign.condensed import Condensed, check_modulus, condense, judged
from orchestrator.scene.foreign.joints import read_joints
from orchestrator.scene.foreign.tables import forces_of, nodes
from orchestrator.scene.mesh.checks import check_memory

SYMMETRIC = 1e-6  # relative: what two halves of a symmetric matrix may differ by, six digits, rounded apart
ENTRY = 24  # bytes: two places and a value
SAMPLE = 2000  # entries whose digits are counted
# Of forces in a row, relative: what rigid motions leave where nothing is held.
STILL = 1e-9
FULL = 15  # digits from which a double is written as it is, but for its last bits


def condensed(part: MatrixPart, path: KeyPath, name: str, steps: int, young: float | None) -> Condensed:
    """Return the part on its joints.

    path : of its entry in the YAML; name : of the part
    steps : load steps; young : a representative modulus, None: not known
    Raises InputError: files that cannot be read, a matrix that can be no stiffness of these nodes
    """
    joints = read_joints(part, path, name)
    ids, points = nodes(part.nodes, (*path, "nodes"))
    K = _matrix(part.stiffness, (*path, "stiffness"), name)
    if K.shape != (3 * len(ids),) * 2:
        raise wrong((*path, "stiffness"), f"'{name}': a matrix of {K.shape[0]} × {K.shape[1]} for {len(ids)} nodes",
                         f"{3 * len(ids)} rows and columns: three dofs, ux uy uz, for each node of the table", "write the table of "
                         "just the matrix's nodes, in its order; condense rotations of shells and beams out of it")
    loads = np.zeros((1, K.shape[0])) if part.loads is None else _loads(part, ids, steps, path, name)
    apart, size = abs(K - K.T).max(), np.abs(K.data).max(initial=0.0)
    if apart > SYMMETRIC * size:
        raise wrong((*path, "stiffness"), f"'{name}': a stiffness that is not symmetric: |K − Kᵀ| is {apart / size:.1e} |K|", "a "
                         "symmetric one", "write both halves, or the lower one with 'symmetric' in the file's head")
    order = np.argsort(ids)
    at = order[np.searchsorted(ids[order], joints.ids)]
    dofs = (3 * at[:, None] + np.arange(3)).ravel()
    rounding = _rounding(Path(part.stiffness))
    _check_places(K, points, ids, rounding, (*path, "nodes"), name)
    S, b, error = condense(K, loads, dofs, path, name, rounding)
    made = judged(joints, S, b, (*path, "stiffness"), name, error)
    check_modulus(made, young, (*path, "stiffness"), name)
    return made


def _check_places(K: sp.csr_array, points: np.ndarray, ids: np.ndarray, rounding: float, path: KeyPath, name: str) -> None:
    """Raises InputError where nodes (n, 3) are not where the matrix (3n, 3n) has them. In the rows of a node without a support beside it,
    K vanishes on all rigid motions, held or not. Where it vanishes on translations and not on rotations, the node or one that it is
    connected with is elsewhere."""
    R = motions_about(points, points.mean(axis=0), size_of(points)).reshape(-1, 6)
    terms = sp.csr_array((np.abs(K.data), K.indices, K.indptr), K.shape) @ np.abs(R)
    left = np.abs(K @ R) / np.where(terms > 0, terms, 1.0)
    of_node = left.reshape(len(points), 3, 6).max(axis=1)
    bad = (of_node[:, :3].max(axis=1) <= max(STILL, 10 * rounding)) & (of_node[:, 3:].max(axis=1) > 100 * max(STILL, 10 * rounding))
    if bad.any():
        worst = np.where(bad, of_node[:, 3:].max(axis=1), 0).argmax()
        raise wrong(path, f"'{name}': at {bad.sum()} of {len(points)} nodes rotations cost force, and translations do not, "
                    f"most at node {ids[worst]}", "a stiffness that vanishes on rigid motions of the nodes that the table "
                    "gives, but beside supports", "the table of nodes is in another order than the matrix, nodes are "
                    "exchanged or in other units than the model was, or displacements are turned: write it in the "
                    "matrix's own order and axes")


def _matrix(file: str, path: KeyPath, name: str) -> sp.csr_array:
    try:
        rows, columns, entries, *_ = scipy.io.mminfo(file)
        check_memory(ENTRY * max(entries, rows + columns), path,
                     f"{file}, of {rows:,} × {columns:,} with {entries:,} entries", "condense it to the joint")
        K = scipy.io.mmread(file)
    except (OSError, ValueError, TypeError, OverflowError) as error:
        raise wrong(path, f"{file}: {str(error) or type(error).__name__}", "a matrix in MatrixMarket's format",
                    "begin it with %%MatrixMarket matrix coordinate real symmetric") from error
    K = sp.csr_array(K)
    if K.dtype.kind not in "fiu":
        raise wrong(path, f"{file}: entries of type {K.dtype}", "real numbers", "write the matrix of a static analysis")
    K = K.astype(float)
    if not np.isfinite(K.data).all():
        raise wrong(path, f"{file}: entries of '{name}' that are not finite", "numbers", "write the file again")
    return K


def _loads(part: MatrixPart, ids: np.ndarray, steps: int, path: KeyPath, name: str) -> np.ndarray:
    """(1 or steps, 3n) forces on nodes (n,)."""
    columns, size = [], 3 * len(ids)
    for i, file in enumerate(part.loads):
        at = (*path, "loads", i) if len(part.loads) > 1 else (*path, "loads")
        listed = not file.endswith((".gz", ".bz2")) and Path(file).is_file()  # else MatrixMarket's, or not there
        if listed:
            with Path(file).open(errors="replace") as lines:
                listed = not lines.readline().lower().startswith("%%matrixmarket")
        found = forces_of(file, ids, at) if listed else _matrix(file, at, name).toarray()
        if found.shape[0] != size:
            raise wrong(at, f"{file}: {found.shape[0]} rows", f"{size}, as the stiffness of '{name}' has",
                        "write forces on just the matrix's dofs")
        columns.append(found)
    loads = np.hstack(columns).T
    if len(loads) not in (1, steps):
        raise wrong((*path, "loads"), f"{len(loads)} columns of loads for {steps} load steps",
                    "one column for all load steps, or one for each", "let history multiply a single column")
    return loads


def _rounding(file: Path) -> float:
    """Relative error of entries that have few digits: half a unit in the last place of the leading digit 1; 0 with 15 or more."""
    most, seen = 0, 0
    with (gzip.open(file, "rt") if file.suffix == ".gz" else file.open(errors="replace")) as lines:
        for line in lines:
            words = line.split()
            if line.startswith("%") or not words or seen == 0:
                seen += not line.startswith("%")
                continue
            mantissa = words[-1].lower().split("e")[0].split("d")[0].lstrip("+-").replace(".", "").lstrip("0")
            most, seen = max(most, len(mantissa)), seen + 1
            if seen > SAMPLE or most >= FULL:
                break
    return 0.0 if most >= FULL or not most else 0.5 * 10.0 ** (1 - most)
