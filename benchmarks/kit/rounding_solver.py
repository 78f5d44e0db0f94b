"""A solver of one's own whose answers have few digits, as codes that speak in text give them.

    blackbox: {code: …/rounding_solver.py, options: {digits: 6}}
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.kit.elasticity import stiffness  # noqa: E402


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Values with so many significant decimal digits."""
    unit = 10.0 ** (np.floor(np.log10(np.where(values == 0, 1.0, np.abs(values)))) - digits + 1)
    return np.rint(values / unit) * unit


class Solver:
    """Forces are read, and displacements written, with ``digits`` significant digits."""

    def __init__(self, digits: int):
        self.digits = digits

    def stiffness(self, model) -> sp.csr_array:
        return stiffness(model.nodes, model.cells, *model.materials[model.region].T)

    def prepare(self, model):
        free = np.flatnonzero(~model.fixed)
        return free, spla.splu(sp.csc_array(self.stiffness(model)[free][:, free]))

    def solve(self, prepared, forces: np.ndarray) -> np.ndarray:
        free, factor = prepared
        displacements = np.zeros_like(forces)
        displacements[:, free] = rounded(factor.solve(np.ascontiguousarray(rounded(forces[:, free], self.digits).T)).T, self.digits)
        return displacements
