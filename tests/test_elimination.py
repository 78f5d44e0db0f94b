"""Linear algebra of the coarse contact problem: elimination front after front, and what is compiled."""

import fcntl
import threading

import numpy as np
import pytest
from ranks_case import lattice, SIZE

from orchestrator.method.sparse.blocks import BlockPattern
from orchestrator.method.sparse.fronts import Elimination
from orchestrator.compiled import compiled, kept_in, made_of

WIDE = 16  # rows of a block, of which rigid motions are eliminated alone


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


def stretched(rng, pattern):
    """Values in whose last rows bodies resist ten times as much, and a body, the last, that a millionth holds in the first."""
    stretches = [40.0] * (WIDE - 1)
    values = rng.normal(scale=0.5 * np.sqrt(SIZE / WIDE), size=(len(pattern.indices), WIDE, WIDE))
    values[pattern.diagonal] += np.diag([8.0, *stretches])
    values[pattern.diagonal[-1]] = np.diag([1e-6, *stretches])
    return values


def test_rigid_motions_are_eliminated_and_stretches_follow():
    """Nothing is left in rigid motions, a loose body's included, and a share elsewhere, as small as it is asked for."""
    ends, bodies = lattice(6)
    pattern, rng = BlockPattern(ends, bodies, WIDE, rigid=1), np.random.default_rng(6)
    values, right = stretched(rng, pattern), rng.normal(size=(bodies, WIDE))
    right[-1] = 1e-6
    matrix, factors = pattern.matrix(values), pattern.factors(values, 0.0)
    for share in (0.1, 1e-3):
        found = factors.factors.solve(right, share)
        left = (right.ravel() - matrix @ found.ravel()).reshape(right.shape)
        assert pattern.elimination.size == 1 and 1e-9 < np.linalg.norm(left) / np.linalg.norm(right) <= share
        assert np.abs(left[:, 0]).max() < 1e-12 and found[-1, 0] == pytest.approx(1.0, rel=1e-9)
    exact = BlockPattern(ends, bodies, WIDE).factors(values, 0.0).solve(right)
    assert np.linalg.norm(found - exact) < 1e-2 * np.linalg.norm(exact)


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
