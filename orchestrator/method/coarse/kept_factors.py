"""Newton matrices of a load step, solved with the factors of an earlier one as long as these serve.

From one iteration of the method to the next few pairs change their status, so that old factors precondition well:
GMRES (Saad & Schultz, SIAM J. Sci. Stat. Comput. 7, 1986) then needs a few products where a factorisation costs many.
Where it would need more than that is worth, and where it gets slow, the matrix is factorised anew.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.coarse.block_pattern import BlockPattern

ACCURACY = 5e-3  # relative residual of a solution: a whole step is to reach half of what its solve has to
SOFT = 0.05  # what a solution still gains by the factors alone, over itself; what is left then is the square of that
WORTH = 0.5  # products that are tried, over those that cost as much as new factors, which serve later steps as well
SEEN = 2  # products after which it can be told how many more it takes


class KeptFactors:
    """Factors of one matrix after the other, of one pattern.

    blocks : those that factors are kept of; None: of none
    """

    def __init__(self, pattern: BlockPattern, blocks: np.ndarray | None = None):
        self.pattern, self.blocks = pattern, blocks
        self._factors = None if blocks is None else pattern.elimination.factors(blocks)

    def solve(self, values: np.ndarray, right: np.ndarray, shift: float, alike: bool = True) -> np.ndarray:
        """(bodies, size) solution x of (matrix + shift) x = right, whose residual is ``ACCURACY`` of it or less.

        alike : the matrix may be much like the one whose factors are kept, so that these are tried
        """
        blocks = self.pattern.shifted(values, shift)
        x = self._tried(blocks, right) if alike and self.blocks is not None else None
        if x is None:
            self.blocks, self._factors = blocks, self.pattern.elimination.factors(blocks, self._factors)
            x = self._factors.solve(right)
        return x

    def _tried(self, blocks: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """The solution by the factors there are, or None. Forces tell little of soft modes: their share is looked at, and
        added."""
        from orchestrator.method.coarse.fronts import gmres

        x, more, most = np.empty(right.shape), np.empty(right.shape), int(WORTH * self.pattern.elimination.worth)
        found = gmres(self._factors.numbers, blocks, self.pattern.indptr, self.pattern.indices, np.ascontiguousarray(right),
                      most, ACCURACY, SEEN, x, more)
        return x + more if found and np.linalg.norm(more) <= SOFT * np.linalg.norm(x) else None

    def again(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) x for another right-hand side by the factors alone, as they are."""
        return self._factors.solve(right)
