"""Ranks find who has the same places, and what is one with theirs, by way of their neighbours."""

import numpy as np
from threads import among

from orchestrator.parallel.numbering import Borders, classes


def test_sums_are_completed_by_those_who_have_the_place():
    rng = np.random.default_rng(4)
    every = np.column_stack([rng.integers(-9, 9, 60) / 7, rng.standard_normal(60)])
    every[:2] = [[0.0, 1.0], [-0.0, 2.0]]
    having = rng.random((5, 60)) < 0.3
    having[4] = False  # a rank without borders
    having[:, 0] = True
    values = rng.standard_normal((5, 2, 60))
    expected = (values * having[:, None]).sum(axis=0)

    def of_rank(team):
        own = rng.permutation(np.flatnonzero(having[team.rank])) if team.rank == 1 else np.flatnonzero(having[team.rank])
        names = every[own] * np.where(team.rank % 2 and every[own] == 0, -1.0, 1.0)  # zero has two signs
        complete = Borders(names, 1 + np.arange(len(own)), team)
        sums = np.concatenate([np.full((2, 1), 7.0), values[team.rank][:, own]], axis=1)
        for _ in range(2):  # a place that nobody else has stays as it is
            again = complete(sums.copy())
        assert (again[:, 0] == 7.0).all()
        return dict(zip(own.tolist(), again[:, 1:].T))

    found = among(5, of_rank)
    for known in found:
        assert not isinstance(known, Exception), known
        for place, sums in known.items():
            assert np.allclose(sums, expected[:, place], rtol=1e-14, atol=1e-14)
            assert all((other[place] == sums).all() for other in found if place in other), "the same bits everywhere"


def test_classes_reach_over_ranks_that_lie_between():
    """A chain of three ranks: what is one on both ends, by way of the one between, has one name."""
    def of_rank(team):
        names = 10 * (3 - team.rank) + np.arange(4)  # the lowest is at the far end
        across = {rank: np.array([0, 1, -1]) for rank in (team.rank - 1, team.rank + 1) if 0 <= rank < 3}
        return classes(names, np.array([1]), np.array([2]), across, team).tolist()

    assert among(3, of_rank) == [[10, 11, 11, 33], [10, 11, 11, 23], [10, 11, 11, 13]]
