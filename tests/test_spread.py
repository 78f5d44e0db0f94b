"""A matrix among ranks: each eliminates what it alone sees, and all find what one process finds."""

import numpy as np
import pytest
from threads import among, chain

from orchestrator.method.interface.spread import SpreadFactor


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
