"""Bodies that still move while all others have arrived: a load step of the coarse contact problem for them alone.

Loose grains that look for their place between others change at a few pairs what a step of all bodies has to be taken for, and a line
that is searched for all of them ends where the first of them touches. Held to a few bodies that touch each other, with all others at rest,
a step costs their pairs and a small dense matrix. It is Newton's method again, from where the last step of all has ended, and what
it leaves is for the next one (approximate nonlinear elimination: Lanzkron, Rose & Wilkes, SIAM J. Sci. Comput. 17, 1996).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from orchestrator.method.coarse.elimination import operations
from orchestrator.method.coarse.load_step import LoadStep
from orchestrator.method.coarse.pattern import BlockPattern
from orchestrator.scene.mesh.faces import components

SHARE = 0.125  # of what a step of all bodies costs, that one of a few may


def clusters(at: LoadStep, moving: np.ndarray) -> list[np.ndarray]:
    """Bodies (k,) int that touch each other, of those that are ``moving`` (bodies,) bool; few enough to be worth a step of their own."""
    pattern, bodies = at.bodies.pattern, np.flatnonzero(moving)
    both = moving[pattern.rows] & moving[pattern.indices]
    label = components(pattern.rows[both], pattern.indices[both], pattern.bodies)[1][bodies]
    found = (bodies[label == each] for each in np.unique(label))
    return [each for each in found if operations(len(each), 0, pattern.size) <= SHARE * pattern.elimination.operations]


class Cluster(LoadStep):
    """ρ of a few bodies, and its derivative; fields y (bodies, n) of all, in which the others stay where they are.

    at : the load step of all, where it formed its last ρ (bodies, n)
    start : (bodies, n) the fields there
    members : (k,) int, these bodies
    """

    def __init__(self, at: LoadStep, rho: np.ndarray, start: np.ndarray, members: np.ndarray):
        self.bodies, self.number, self.start, self.members = at.bodies, at.number, start, members
        chosen, self.fields = at.bodies.summed[1].touching(members)
        self.here, self.left = at.F.take(chosen, axis=1), at.left.take(chosen)
        place = np.full(len(start), len(members))  # the last is all others
        place[members] = np.arange(len(members))
        self.pattern = BlockPattern(place[self.fields.ends], len(members) + 1, self.fields.size)
        self.affine, self.resisted = self._affine(place), np.zeros_like(start)
        self.resultant = rho + at.bodies.team.sum(self.carried(self.answer(self.here).force, self.resisted))[0]

    def _affine(self, place: np.ndarray) -> np.ndarray:
        """(k n, k n) K₀ − ΣTᵀε L."""
        pattern = self.bodies.pattern
        rows, columns = place[pattern.rows[pattern.entering]], place[pattern.indices[pattern.entering]]
        own = np.flatnonzero((rows < len(self.members)) & (columns < len(self.members)))
        return self._square(rows[own], columns[own], self.bodies.affine[own])

    def residual(self, y: np.ndarray) -> np.ndarray:
        """(bodies, n) ρ, zero at all others."""
        return super().residual(y - self.start)

    def linear(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, n) (K₀ − ΣTᵀε L) y, and nothing that is this rank's alone."""
        return self._among_all(self.affine @ y[self.members].ravel()), np.zeros_like(y)

    def left_by(self, carried: np.ndarray) -> np.ndarray:
        return self._among_all((self.resultant + self.stiff - carried)[self.members])

    def matrix(self) -> np.ndarray:
        """(k n, k n) K₀ − ΣTᵀA L at the last forces."""
        slopes = self.fields.slopes(self.answer(self.F, derivative=True), self.bodies.weight)
        return self.affine - self._square(self.pattern.rows, self.pattern.indices, self.pattern.summed(slopes))

    def _square(self, rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """(k n, k n) of all ranks' blocks (·, n, n), whose last row and column are dropped."""
        count, size = len(self.members), self.fields.size
        result = np.zeros((count + 1, count + 1, size, size))
        result[rows, columns] = blocks
        whole, = self.bodies.team.sum(result[:count, :count])
        return whole.swapaxes(1, 2).reshape(2 * (count * size,))

    def factors(self, matrix: np.ndarray, shift: float) -> _Factors:
        return _Factors(self, *dgetrf(matrix + shift * np.eye(len(matrix)))[:2])

    def _among_all(self, own: np.ndarray) -> np.ndarray:
        result = np.zeros_like(self.start)
        result[self.members] = own.reshape(len(self.members), -1)
        return result


class _Factors(NamedTuple):
    """A factorised matrix, and the rows exchanged."""

    of: Cluster
    dense: np.ndarray
    turn: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, n) solution for a right-hand side of that shape, which all ranks have; on all ranks."""
        own, _ = dgetrs(self.dense, self.turn, right[self.of.members].ravel())
        return self.of._among_all(self.of.bodies.team.spread(own))
