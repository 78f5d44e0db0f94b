"""Reading what CalculiX writes, at full precision.

Its printed displacements have 7 digits. The same numbers stand as binary doubles in the file of Green functions
(``.eig``) and in the restart file (``.rout``), a sequence of Fortran records. The stored matrix (``.sti``) has 14 digits.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import scipy.sparse as sp


class Unreadable(Exception):
    """A file of CalculiX's that is missing, cut short, or not what was expected."""


def matrix(job: Path, dofs: int) -> tuple[sp.csr_array, np.ndarray]:
    """Stored stiffness: the symmetric (active, active) matrix, and the (active,) dofs of its rows."""
    try:
        # node.direction, one a line: not a decimal number
        order = np.loadtxt(job.with_suffix(".dof"), delimiter=".", dtype=np.int64, ndmin=2)
        entries = np.loadtxt(job.with_suffix(".sti"), ndmin=2)
    except (OSError, ValueError) as error:
        raise Unreadable(f"no stored matrix: {error}") from error
    active = 3 * (order[:, 0] - 1) + order[:, 1] - 1
    rows, columns, values = entries[:, 0].astype(int) - 1, entries[:, 1].astype(int) - 1, entries[:, 2]
    if active.max(initial=0) >= dofs or max(rows.max(initial=0), columns.max(initial=0)) >= len(active):
        raise Unreadable("the stored matrix has dofs that the model has not")
    apart = rows != columns
    both = np.concatenate([rows, columns[apart]]), np.concatenate([columns, rows[apart]])
    return sp.csr_array((np.concatenate([values, values[apart]]), both), shape=(len(active),) * 2), active


def green_functions(job: Path, loads: int, active: int) -> np.ndarray:
    """Displacements (loads, active) under unit loads: the end of the file, after the matrices."""
    path, size = job.with_suffix(".eig"), 8 * loads * active
    try:
        length = path.stat().st_size
        head = np.fromfile(path, np.int32, 4)
    except OSError as error:
        raise Unreadable("no file of Green functions") from error
    if length < 16 + size or head[3] != loads:
        raise Unreadable(f"{length} bytes of Green functions, at least {16 + size} expected for {loads} unit loads")
    return np.memmap(path, np.float64, "r", offset=length - size, shape=(loads, active))


def displacements(job: Path, steps: int, nodes: int) -> np.ndarray:
    """Displacements (steps, 3 nodes) of the restart file.

    They are two records after the materials' names of each step, (nodes, 4) with the temperature first.
    """
    data, records, end = restart_records(job)
    names = [i for i, (start, _) in enumerate(records) if data[start : start + 8] == b"MATTER-0"]
    found = [records[i + 2] for i in names if i + 2 < len(records)]
    if end != len(data) or len(found) != steps or any(length != 32 * nodes for _, length in found):
        raise Unreadable(f"{len(found)} of {steps} load cases in the restart file")
    return np.stack([np.frombuffer(data, np.float64, 4 * nodes, start).reshape(nodes, 4)[:, 1:].ravel()
                     for start, _ in found])


def restart_records(job: Path) -> tuple[bytes, list[tuple[int, int]], int]:
    """The restart file, where each of its records begins with how many bytes it has, and where they say that the last one ends."""
    try:
        data = job.with_suffix(".rout").read_bytes()
    except OSError as error:
        raise Unreadable("no restart file") from error
    records, at = [], 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<i", data, at)
        records.append((at + 4, length))
        at += 8 + length
    return data, records, at
