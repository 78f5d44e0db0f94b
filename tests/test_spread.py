"""A matrix among ranks: each eliminates what it alone sees, and all find what one process finds."""

import numpy as np
import pytest
import scipy.sparse as sp
from threads import among

from orchestrator.method.interface.factor import SpreadFactor


def chain(ranks: int, each: int, definite: bool = True) -> list[tuple[sp.csr_array, np.ndarray, np.ndarray]]:
    """Parts of a matrix: neighbours in a ring share three unknowns; per rank its part, numbers, and what is shared."""
    rng, parts, total = np.random.default_rng(3), [], ranks * each
    for rank in range(ranks):
        number = np.sort(np.arange(rank * each, (rank + 1) * each + 3) % total)
        root = rng.standard_normal((len(number), len(number) if definite else 2))
        shared = (number % each < 3)
        parts.append((sp.csr_array(np.tril(root @ root.T + (np.eye(len(number)) if definite else 0.0))), number, shared))
    return parts


@pytest.mark.parametrize("ranks", [2, 3])
def test_solutions_are_those_of_the_whole(ranks):
    parts, total = chain(ranks, 7), 7 * ranks
    whole, right, share = np.zeros((total, total)), np.zeros((2, total)), []
    for lower, number, _ in parts:
        dense = lower.toarray()
        whole[np.ix_(number, number)] += dense + np.tril(dense, -1).T
        share.append(np.random.default_rng(len(share)).standard_normal((2, len(number))))
        right[:, number] += share[-1]
    exact = np.linalg.solve(whole, right.T).T
    found = among(ranks, lambda team: SpreadFactor(*parts[team.rank], team)(share[team.rank]))
    for (_, number, _), x in zip(parts, found):
        assert np.allclose(x, exact[:, number], rtol=1e-10, atol=1e-12)


def test_a_singular_matrix_is_refused_by_all():
    parts = chain(2, 7, definite=False)
    found = among(2, lambda team: SpreadFactor(*parts[team.rank], team))
    assert RuntimeError in map(type, found) and all(isinstance(error, RuntimeError) for error in found)  # a barrier that is left
