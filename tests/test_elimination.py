"""Linear algebra of the coarse contact problem: elimination front after front, and what is compiled."""

import fcntl
import threading

import numpy as np
import pytest
from ranks_case import lattice, SIZE

from orchestrator.method.sparse.blocks import BlockPattern
from orchestrator.method.sparse.fronts import Elimination
from orchestrator.compiled import compiled, kept_in, made_of


@pytest.mark.parametrize("SIZE, fronts", [(32, 41), (12, 14), (1, 4)], ids=["many fronts", "some", "one each"])
def test_it_is_what_dense_elimination_gives(SIZE, fronts):
    """Whatever fronts are made of: of large blocks many, of small ones few."""
    ends, bodies = lattice(4)
    rng = np.random.default_rng(2)
    pattern = BlockPattern(ends, bodies, SIZE)
    # neither symmetric nor definite
    pairs, own = rng.normal(size=(len(ends), 2 * SIZE, 2 * SIZE)), 3 * SIZE * rng.normal(size=(bodies, SIZE, SIZE))
    values = pattern.values(pairs.reshape(-1, 2, SIZE, 2, SIZE).swapaxes(2, 3), own)
    dense = pattern.matrix(values).toarray() + 0.25 * np.eye(SIZE * bodies)
    expected = 0.25 * np.eye(SIZE * bodies)
    for e, block in enumerate(own):
        expected[SIZE * e: SIZE * (e + 1), SIZE * e: SIZE * (e + 1)] += block
    for (a, b), block in zip(ends, pairs):
        rows = np.r_[SIZE * a: SIZE * (a + 1), SIZE * b: SIZE * (b + 1)]
        expected[np.ix_(rows, rows)] += block
    assert dense == pytest.approx(expected)
    elimination_of = Elimination(pattern.indptr, pattern.indices, SIZE)
    factors = elimination_of.factors(values, 0.25)
    assert len(elimination_of.fronts) == fronts
    right = rng.normal(size=(bodies, SIZE))
    assert factors.solve(right).ravel() == pytest.approx(np.linalg.solve(dense, right.ravel()), rel=1e-8)
    again = elimination_of.factors(values, 0.25)
    assert np.array_equal(again.solve(right), factors.solve(right))
    assert np.array_equal(pattern.factors(values, 0.25).solve(right), factors.solve(right))


def test_a_pivot_that_vanishes_is_told():
    pattern = BlockPattern(np.array([[0, 1]]), 2, SIZE)
    with pytest.raises(ZeroDivisionError, match="pivot"):
        pattern.factors(np.zeros((4, SIZE, SIZE)), 0.0)


def test_machine_code_is_that_of_all_loops_as_they_are_written(tmp_path):
    """What a loop takes from another module goes along into its machine code."""
    made = []
    for name, text in [("loops", "@compiled\n"), ("called", "@numba.njit\n"), ("plain", ""), ("loops", "@compiled\n\n"),
                       ("called", "\n@numba.njit\n"), ("plain", "print()\n")]:
        (tmp_path / f"{name}.py").write_text(text)
        made.append(made_of.__wrapped__(tmp_path))
    assert made[1] == made[2] and made[4] == made[5] and len(set(made)) == 4


def _doubled(values):
    return 2 * values


@pytest.mark.long
def test_one_process_compiles_a_loop_at_a_time(tmp_path, monkeypatch):
    """Another one that compiles it too, for other types perhaps, is waited for."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kept_in().mkdir()
    loop, done = compiled(_doubled), []
    waits = threading.Thread(target=lambda: done.append(loop(3)))
    with open(kept_in() / f"{__name__}._doubled.lock", "w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        waits.start()
        waits.join(2)
        assert waits.is_alive() and not done
    waits.join()
    assert done == [6] and loop(np.ones(2)).tolist() == [2, 2]
