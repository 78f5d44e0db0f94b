"""Newton matrices of a load step, solved with the factors of an earlier one as long as these serve.

From one iteration of the method to the next few pairs change their status, so that old factors precondition well:
GMRES (Saad & Schultz, SIAM J. Sci. Stat. Comput. 7, 1986) then needs a few products where a factorisation costs many.
Where it would need more than that is worth, and where it gets slow, the matrix is factorised anew.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.coarse.block_pattern import BlockPattern

ACCURACY = 5e-3  # relative residual of a solution: a whole step is to reach half of what its solve has to
SOFT = 0.05  # what a solution still gains by the factors alone, over itself; what is left then is the square of that
REFINED = 4  # products with factors of the matrix itself, which single precision asks for
WORTH = 0.5  # products that are tried, over those that cost as much as new factors, which serve later steps as well
SEEN = 2  # products after which it can be told how many more it takes


class KeptFactors:
    """Factors of one matrix after the other, of one pattern.

    Parameters
    ----------
    blocks : those that factors are kept of, in single precision; None: of none
    """

    def __init__(self, pattern: BlockPattern, blocks: np.ndarray | None = None):
        self.pattern, self.blocks = pattern, blocks
        self._factors = None if blocks is None else pattern.elimination.factors(blocks)

    def solve(self, values: np.ndarray, right: np.ndarray, shift: float) -> np.ndarray:
        """(bodies, size) solution x of (matrix + shift) x = right, whose residual is ``ACCURACY`` of it or less."""
        blocks = self.pattern.shifted(values, shift)
        tries = int(WORTH * self.pattern.elimination.worth)
        x = self._tried(blocks, right.ravel(), tries) if self.blocks is not None else None
        if x is None:
            try:
                self.blocks = blocks.astype(np.float32)
                self._factors = self.pattern.elimination.factors(self.blocks, self._factors)
                x = self._tried(blocks, right.ravel(), max(tries, REFINED))
            except ZeroDivisionError:
                pass
        if x is not None:
            return x.reshape(right.shape)
        # soft modes are softer than single precision resolves: such factors serve but once
        self.blocks, self._factors = None, self.pattern.elimination.factors(blocks)
        return self._factors.solve(right)

    def _tried(self, blocks: np.ndarray, right: np.ndarray, most: int) -> np.ndarray | None:
        """The solution by the factors there are, or None. Forces tell little of soft modes: their share is looked at, and
        added."""
        matrix = self.pattern.matrix_of(blocks)
        x = gmres(lambda v: matrix @ v, self._once, right, most)
        if x is None:
            return None
        more = self._once(right - matrix @ x)
        return x + more if np.linalg.norm(more) <= SOFT * np.linalg.norm(x) else None

    def again(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) x for another right-hand side by the factors alone, as they are."""
        return self._once(right.ravel()).reshape(right.shape)

    def _once(self, right: np.ndarray) -> np.ndarray:
        return self._factors.solve(right.reshape(self.pattern.bodies, -1)).ravel().astype(float)


def gmres(product: Callable[[np.ndarray], np.ndarray], precondition: Callable[[np.ndarray], np.ndarray],
          right: np.ndarray, most: int) -> np.ndarray | None:
    """(n,) solution to ``ACCURACY``, preconditioned from the right; None if that takes more than ``most`` products, as
    far as can be told."""
    size = np.linalg.norm(right)
    if size == 0:
        return np.zeros_like(right)
    basis, directions = np.empty((most + 1, len(right))), np.empty((most, len(right)))
    H, target = np.zeros((most + 1, most)), np.zeros(most + 1)
    basis[0], target[0] = right / size, 1.0
    for j in range(most):
        directions[j] = precondition(basis[j])
        new = product(directions[j])
        for _ in range(2):  # what rounding leaves of a direction that is nearly known
            part = basis[: j + 1] @ new
            new -= part @ basis[: j + 1]
            H[: j + 1, j] += part
        H[j + 1, j] = np.linalg.norm(new)
        if not np.isfinite(H[: j + 2, j]).all():
            return None
        weights = np.linalg.lstsq(H[: j + 2, : j + 1], target[: j + 2], rcond=None)[0]
        left = np.linalg.norm(target[: j + 2] - H[: j + 2, : j + 1] @ weights)
        if left <= ACCURACY:
            return size * (weights @ directions[: j + 1])
        if H[j + 1, j] == 0 or (j + 1 >= SEEN and left ** (most / (j + 1)) > ACCURACY):
            return None
        basis[j + 1] = new / H[j + 1, j]
    return None
