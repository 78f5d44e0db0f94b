"""A matrix among ranks: each eliminates what it alone sees, and all find what one process finds."""

import numpy as np
import pytest
import scipy.sparse as sp
from threads import among, chain

from orchestrator.method.sparse.symmetric import whole
from orchestrator.method.interface.spread import SpreadFactor, semidefinite


@pytest.mark.parametrize("ranks", [2, 3])
def test_solutions_are_those_of_the_whole(ranks):
    parts, total = chain(ranks, 7), 7 * ranks
    matrix, right, share = np.zeros((total, total)), np.zeros((2, total)), []
    for lower, number, _ in parts:
        matrix[np.ix_(number, number)] += whole(lower).toarray()
        share.append(np.random.default_rng(len(share)).standard_normal((2, len(number))))
        right[:, number] += share[-1]
    exact = np.linalg.solve(matrix, right.T).T

    def solved(team):
        lower, number, shared = parts[team.rank]
        return [factor(share[team.rank]) for factor in (SpreadFactor(lower, number, shared, team), semidefinite(whole(lower), number, team))]

    for (_, number, _), found in zip(parts, among(ranks, solved)):
        for x in found:
            assert np.allclose(x, exact[:, number], rtol=1e-10, atol=1e-10 * np.abs(exact).max())


def test_what_a_singular_matrix_can_do_is_solved():
    """Neighbours push each other, and nothing holds them all: forces that cancel have displacements."""
    spring = sp.csr_array([[1.0, -1.0], [-1.0, 1.0]])
    numbers = [np.array([0, 1]), np.array([1, 2])]
    found = among(2, lambda team: semidefinite(spring, numbers[team.rank], team)(np.array([[1.0, -1.0]])))
    assert [np.diff(x[0]) for x in found] == [pytest.approx(-1.0, abs=1e-2)] * 2


def test_a_singular_matrix_is_refused_by_all():
    parts = chain(2, 7, definite=False)
    found = among(2, lambda team: SpreadFactor(*parts[team.rank], team))
    assert RuntimeError in map(type, found) and all(isinstance(error, RuntimeError) for error in found)  # a barrier that is left
