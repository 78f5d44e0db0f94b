"""CalculiX input decks: a model, and what to do with it.

Numbers have 14 digits: CalculiX reads 20 characters of each. Dofs are written as node (from 1) and direction (1 to 3).
"""

from __future__ import annotations

import io

import numpy as np

from orchestrator.blackbox.protocol import Model

SMALLEST = 1e-99  # below, exponents have three digits and a number 21 characters


def mesh(model: Model) -> str:
    """Nodes, C3D4 tets (P1, one integration point) and a material per region: matter and soles alike.

    Raises ValueError when a node belongs to no tet: CalculiX would give it no dofs.
    """
    if not (np.bincount(model.cells.ravel(), minlength=len(model.nodes)) > 0).all():
        raise ValueError(f"{model.name}: a node belongs to no tet")
    text = io.StringIO()
    text.write("*NODE,NSET=ALL\n")
    _rows(text, "%d,%.13e,%.13e,%.13e", 1 + np.arange(len(model.nodes)), model.nodes)
    for region, (young, poisson) in enumerate(model.materials):
        chosen = np.flatnonzero(model.region == region)
        text.write(f"*ELEMENT,TYPE=C3D4,ELSET=REGION-{region}\n")
        _rows(text, "%d,%d,%d,%d,%d", 1 + chosen, 1 + model.cells[chosen])
        text.write(f"*MATERIAL,NAME=MATTER-{region}\n*ELASTIC\n{young:.13e},{poisson:.13e}\n"
                   "*DENSITY\n1.\n"  # of no consequence, but some procedures ask for it
                   f"*SOLID SECTION,ELSET=REGION-{region},MATERIAL=MATTER-{region}\n")
    return text.getvalue()


def clamped(model: Model) -> str:
    """Boundary conditions: the dofs that are held."""
    text = io.StringIO("*BOUNDARY\n" if model.fixed.any() else "")
    text.seek(0, io.SEEK_END)
    _dofs(text, np.flatnonzero(model.fixed))
    return text.getvalue()


def store_matrix() -> str:
    """Write the stiffness matrix, 14 digits, and the order of its dofs; nothing is solved."""
    return "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"


def unit_loads(dofs: np.ndarray) -> str:
    """One factorisation, one unit load at a time; all displacements as binary doubles."""
    text = io.StringIO("*STEP\n*GREEN,STORAGE=YES\n*CLOAD,OMEGA0=0.\n")
    text.seek(0, io.SEEK_END)
    _dofs(text, dofs, ",1.")
    text.write("*END STEP\n")
    return text.getvalue()


def load_cases(forces: np.ndarray) -> str:
    """A static step per row of (rhs, 3n) forces, at most about 1 in size.

    The restart file keeps every step's displacements, as doubles.
    """
    text = io.StringIO()
    for step, row in enumerate(forces):
        text.write("*STEP\n" + "*RESTART,WRITE\n" * (step == 0) + "*STATIC\n*CLOAD,OP=NEW\n")
        loaded = np.flatnonzero(np.abs(row) > SMALLEST)
        # a step must load something; a zero leaves the model at rest
        _rows(text, "%d,%d,%.13e", *(np.c_[loaded // 3, loaded % 3].T + 1), row[loaded])
        text.write("1,1,0.\n" * (len(loaded) == 0) + "*END STEP\n")
    return text.getvalue()


def _dofs(text: io.StringIO, dofs: np.ndarray, tail: str = "") -> None:
    dofs = np.asarray(dofs, int)
    _rows(text, "%d,%d" + tail, 1 + dofs // 3, 1 + dofs % 3)


def _rows(text: io.StringIO, form: str, *columns: np.ndarray) -> None:
    """One line per row; integer columns first."""
    table = np.column_stack(columns)
    if len(table):
        text.write(("\n".join([form] * len(table)) + "\n") % tuple(table.ravel().tolist()))
