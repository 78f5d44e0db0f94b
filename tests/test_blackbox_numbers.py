"""What FreeFEM answers beside what ``conformance`` asks of it (test_conformance.py), through both transports."""


import numpy as np
import pytest
from blackbox_case import box, difference, forces, settings

from orchestrator.blackbox.start import make_blackbox


@pytest.fixture(scope="module")
def models():
    return [box((3, 2, 2), "a"), box((2, 2, 3), "b", seed=1), box((4, 3, 2), "c", seed=2)]


@pytest.fixture(scope="module")
def pool(models):
    with make_blackbox(settings(workers=2)) as blackbox:
        blackbox.load(models)
        yield blackbox


def test_some_models_and_uneven_right_hand_sides(pool, models):
    both = pool.traces({2: forces(models[2], 4), 0: forces(models[0], 1)})
    assert list(both) == [2, 0]
    assert [u.shape for u in both.values()] == [(4, len(models[2].trace)), (1, len(models[0].trace))]
    assert pool.traces({1: np.zeros((0, len(models[1].trace)))})[1].shape == (0, len(models[1].trace))
    assert pool.traces({}) == {}


def test_forces_of_the_wrong_size_are_refused(pool):
    with pytest.raises(ValueError, match="expected \\(rhs, "):
        pool.traces({0: np.zeros((1, 3))})


def test_loading_again_forgets_what_was_loaded(models):
    with make_blackbox(settings()) as blackbox:
        blackbox.load(models)
        blackbox.load(models[1:])
        f = forces(models[1])
        again = blackbox.traces({0: f})[0]
        blackbox.load([models[1]])
        assert difference(again, blackbox.traces({0: f})[0]) == 0
