"""CalculiX input decks: a model, and what to do with it.

Numbers have 14 digits: CalculiX reads 20 characters of each. Dofs are written as node (from 1) and direction (1 to 3).
"""

from __future__ import annotations

import numpy as np

from orchestrator.blackbox.protocol import Model

SMALLEST = 1e-99  # below, exponents have three digits and a number 21 characters


def mesh(model: Model) -> str:
    """Nodes, C3D4 tets (P1, one integration point) and a material per region: matter and soles alike.

    Raises ValueError when a node belongs to no tet: CalculiX would give it no dofs.
    """
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


def store_matrix() -> str:
    """Write the stiffness matrix, 14 digits, and the order of its dofs; nothing is solved."""
    return "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"


def unit_loads(dofs: np.ndarray) -> str:
    """One factorisation, one unit load at a time; all displacements as binary doubles."""
    return "*STEP\n*GREEN,STORAGE=YES\n*CLOAD,OMEGA0=0.\n" + _dofs(dofs, ",1.") + "*END STEP\n"


def load_cases(forces: np.ndarray) -> str:
    """A static step per row of (rhs, 3n) forces, at most about 1 in size.

    The restart file keeps every step's displacements, as doubles.
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
