"""Affine fields of the two bodies of an interface at points whose nodes do not match: T = [G₁U₁, −G₂U₂] as it is.

A rigid link takes the turn of the master's facets along, so that fields affine on the bodies are not combinations of
1, x, y, z at the points; and the forces are in balance at the end only if T is exact. Sums over the points are dense
products, interface after interface.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.compiled import in_parts
from orchestrator.laws.points import Answer
from orchestrator.method.coarse.kernels import spread
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.interface.pairs import Pairs


class DenseFields(PairFields):
    """The fields at points of which some have no pair of nodes.

    T : (P, 3, 2n); all_L, bodies : as for ``PairFields``
    """

    def __init__(self, pairs: Pairs, T: np.ndarray, all_L: np.ndarray, bodies: np.ndarray, chosen: np.ndarray | None = None):
        super().__init__(pairs, np.empty((len(T), 0)), np.empty((len(bodies), 0, all_L.shape[2])), all_L, bodies, chosen)
        self.T = T

    def some(self, chosen: np.ndarray) -> DenseFields:
        """As for ``PairFields``."""
        return DenseFields(self.pairs.some(chosen), self.T, self.all_L, self.bodies, self.chosen[chosen])

    def jump(self, y: np.ndarray) -> np.ndarray:
        """(3, Q) T y."""
        result = np.zeros((3, len(self.chosen)))
        in_parts(spread, len(self.bodies), self.T, self.chosen, self.pairs.bounds, self.both(y), result, part=self.part(len(self.chosen)))
        return result

    def swept(self, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As for ``PairFields``."""
        return self.predicted(np.zeros((3, len(self.chosen))), y), self.jump(y) * weight[self.chosen]

    def carried(self, force: np.ndarray, weight: np.ndarray, bodies: int) -> np.ndarray:
        """As for ``PairFields``."""
        result, weighted = np.zeros((bodies, self.size)), (force * weight[self.chosen]).T
        for i, part in self._parts(np.arange(len(self.chosen))):
            both = np.tensordot(weighted[part], self.T[self.chosen[part]], axes=2).reshape(2, self.size)
            for body, own in zip(self.bodies[i], both):
                result[body] += own
        return result

    def slopes(self, answer: Answer, weight: np.ndarray) -> np.ndarray:
        """As for ``PairFields``."""
        result = np.zeros((len(self.bodies), 2, 2, self.size, self.size))
        for i, part in self._parts(answer.active):
            at = self.chosen[answer.active[part]]
            turned = answer.derivative[:, :, part].transpose(2, 0, 1) * weight[at, None, None] @ self.all_L[at]
            whole = self.T[at].reshape(-1, 2 * self.size).T @ turned.reshape(-1, 2 * self.size)
            result[i] = whole.reshape(2, self.size, 2, self.size).swapaxes(1, 2)
        self._collective(answer, weight, result)
        return result

    def at_pairs(self) -> np.ndarray:
        """(Q, 3, 2n) T."""
        return self.T[self.chosen]

    def _parts(self, points: np.ndarray) -> Iterator[tuple[int, slice]]:
        """Interfaces that have some of the points (R,) int, ascending, and which of them these are."""
        ends = np.searchsorted(points, self.pairs.bounds)
        for i in np.flatnonzero(np.diff(ends)):
            yield int(i), slice(int(ends[i]), int(ends[i + 1]))
