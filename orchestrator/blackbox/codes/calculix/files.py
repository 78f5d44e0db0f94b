"""CalculiX's files: input decks of a model and its load cases, and results at full precision.

Decks: numbers have 14 digits, since CalculiX reads 20 characters of each. Dofs are written as node
(from 1) and direction (1 to 3). Results: printed displacements have 7 digits. The same numbers
stand as binary doubles in the file of Green functions (``.eig``) and in the restart file
(``.rout``), a sequence of Fortran records. The stored matrix (``.sti``) has 14 digits.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport.messages import BadReply

SMALLEST = 1e-99  # below, exponents have three digits and a number 21 characters
# Writes the stiffness matrix, 14 digits, and the order of its dofs; nothing is solved.
STORE_MATRIX = "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"


class Unreadable(BadReply):
    """A file of CalculiX's that is missing, cut short, or not what was expected."""


# ---- decks ---------------------------------------------------------------------------------------


def mesh(model: Model) -> str:
    """Nodes, C3D4 tets (P1, one integration point) and a material per region: matter and soles
    alike. Raises ValueError when a node
    belongs to no tet: CalculiX would give it no dofs."""
    if not (np.bincount(model.cells.ravel(), minlength=len(model.nodes)) > 0).all():
        raise ValueError(f"{model.name}: a node belongs to no tet")
    places = np.where(np.abs(model.nodes) < SMALLEST, 0.0, model.nodes)
    parts = ["*NODE,NSET=ALL\n", _rows("%d,%.13e,%.13e,%.13e", 1 + np.arange(len(places)), places)]
    for region, (young, poisson) in enumerate(model.materials):
        chosen = np.flatnonzero(model.region == region)
        parts += [f"*ELEMENT,TYPE=C3D4,ELSET=REGION-{region}\n",
                  _rows("%d,%d,%d,%d,%d", 1 + chosen, 1 + model.cells[chosen]),
                  f"*MATERIAL,NAME=MATTER-{region}\n*ELASTIC\n{young:.13e},{poisson:.13e}\n",
                  "*DENSITY\n1.\n",  # of no consequence, but some procedures ask for it
                  f"*SOLID SECTION,ELSET=REGION-{region},MATERIAL=MATTER-{region}\n"]
    return "".join(parts)


def clamped(model: Model) -> str:
    """Boundary conditions: the dofs that are held."""
    return "*BOUNDARY\n" + _dofs(np.flatnonzero(model.fixed)) if model.fixed.any() else ""


def unit_loads(dofs: np.ndarray) -> str:
    """One factorisation, one unit load at a time; all displacements as binary doubles."""
    return "*STEP\n*GREEN,STORAGE=YES\n*CLOAD,OMEGA0=0.\n" + _dofs(dofs, ",1.") + "*END STEP\n"


def load_cases(forces: np.ndarray) -> str:
    """A static step per row of (rhs, 3n) forces, at most about 1 in size. The restart file keeps
    every step's displacements, as doubles.
    """
    parts = []
    for step, row in enumerate(forces):
        loaded = np.flatnonzero(np.abs(row) > SMALLEST)
        parts += ["*STEP\n", "*RESTART,WRITE\n" * (step == 0), "*STATIC\n*CLOAD,OP=NEW\n",
                  _rows("%d,%d,%.13e", 1 + loaded // 3, 1 + loaded % 3, row[loaded]),
                  # a step must load something; a zero leaves the model at rest
                  "1,1,0.\n" * (len(loaded) == 0), "*END STEP\n"]
    return "".join(parts)


def _dofs(dofs: np.ndarray, tail: str = "") -> str:
    return _rows("%d,%d" + tail, 1 + dofs // 3, 1 + dofs % 3)


def _rows(form: str, *columns: np.ndarray) -> str:
    """One line per row of the columns side by side."""
    table = np.column_stack(columns)
    return (form + "\n") * len(table) % tuple(table.ravel().tolist())


# ---- results -------------------------------------------------------------------------------------


def matrix(job: Path, dofs: int) -> tuple[sp.csr_array, np.ndarray]:
    """Stored stiffness: the symmetric (active, active) matrix, and the (active,) dofs of its
    rows.
    """
    try:
        # node.direction, one a line: not a decimal number
        order = np.loadtxt(job.with_suffix(".dof"), delimiter=".", dtype=np.int64, ndmin=2)
        entries = np.loadtxt(job.with_suffix(".sti"), ndmin=2)
    except (OSError, ValueError) as error:
        raise Unreadable(f"no stored matrix: {error}") from error
    active = 3 * (order[:, 0] - 1) + order[:, 1] - 1
    rows, columns, values = entries[:,
                                    0].astype(int) - 1, entries[:, 1].astype(int) - 1, entries[:, 2]
    if active.max(initial=0) >= dofs or max(rows.max(initial=0),
                                            columns.max(initial=0)) >= len(active):
        raise Unreadable("the stored matrix has dofs that the model has not")
    apart = rows != columns
    both = np.concatenate([rows, columns[apart]]), np.concatenate([columns, rows[apart]])
    return sp.csr_array((np.concatenate([values, values[apart]]), both),
                        shape=(len(active),) * 2), active


def green_functions(job: Path, loads: int, active: int) -> np.ndarray:
    """Displacements (loads, active) under unit loads: the end of the file, after the matrices."""
    path, size = job.with_suffix(".eig"), 8 * loads * active
    try:
        length = path.stat().st_size
        head = np.fromfile(path, np.int32, 4)
    except OSError as error:
        raise Unreadable("no file of Green functions") from error
    if length < 16 + size or head[3] != loads:
        raise Unreadable(
            f"{length} bytes of Green functions, at least {16 + size} expected for {loads} unit "
            "loads")
    return np.memmap(path, np.float64, "r", offset=length - size, shape=(loads, active))


def displacements(job: Path, steps: int, material: str = "MATTER-0") -> np.ndarray:
    """(steps, nodes, 3) of the restart file, whose records begin and end with how many bytes they
    have. Displacements are two records after
    the materials' names of each step, of which ``material`` is the first; (nodes, 4) with the
    temperature first."""
    try:
        data = job.with_suffix(".rout").read_bytes()
    except OSError as error:
        raise Unreadable("no restart file") from error
    records, at, name = [], 0, material.encode().ljust(80)[:80]
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<i", data, at)
        records.append((at + 4, length))
        at += 8 + length
    names = [i for i, (start, length) in enumerate(records) if length and length % 80 == 0
             and data[start : start + 80] == name]
    found = [records[i + 2] for i in names if i + 2 < len(records)]
    if at != len(data) or len(found) != steps or any(length != found[0][1] or length % 32
                                                     for _, length in found):
        raise Unreadable(f"{len(found)} of {steps} load cases in the restart file")
    return np.stack([np.frombuffer(data, np.float64, length // 8, start).reshape(-1, 4)[:, 1:]
                     for start, length in found])


def complaint(printed: str) -> str:
    """The first error message in what CalculiX printed, on one line; empty when there is none."""
    rows = iter(printed.splitlines())
    for row in rows:
        if "*ERROR" in row:
            message = [row.strip()]
            for more in rows:  # messages go on until an empty line
                if not more.strip() or "*" in more[:3]:
                    break
                message.append(more.strip())
            return " ".join(message)
    return ""
