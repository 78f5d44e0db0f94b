"""Nonlinear parts on their joints: load steps are committed by replay.

Whoever answers for the part keeps nothing between its runs. What it answers to the forces of a load step is asked together
with those of all committed steps before, from the beginning; to commit is to remember one more.

Only springs may stand on its joints, since they are all that it is told of the search direction: the diagonal of the soles.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.foreign.algebra import AlgebraWorker
from orchestrator.blackbox.protocol import Model


class ReplayWorker(AlgebraWorker):
    """The elastic part answers as any other; ``advance`` is the code's ``respond(springs, forces)``."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.promised |= 4
        self.committed: dict[int, list[np.ndarray]] = {}

    def load(self, index: int, model: Model) -> None:
        super().load(index, model)
        self.committed[index] = []

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        begin, model, part = time.thread_time(), self.models[index][0], self.code.condensed()
        size = part.stiffness.shape[0]
        k, asked = self._soles(model).diagonal()[:size], [*self.committed[index], forces[:size].copy()]
        u = np.zeros((2, model.fixed.size))
        u[0, :size] = self.code.respond(k, asked)
        u[1, :size] = part.stiffness @ u[0, :size] + k * u[0, :size] - forces[:size]
        if commit:
            self.committed[index] = asked
        self.count([0.0, 0.0, time.thread_time() - begin])
        return u

    def _soles(self, model: Model) -> sp.csr_array:
        """(3n, 3n) diagonal."""
        return sp.csr_array(sp.diags_array(super()._soles(model).diagonal()))
