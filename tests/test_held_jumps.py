"""Jumps that are held give way where that costs less."""

import numpy as np
import pytest

from orchestrator.method.stopping.held_jumps import Charges, HeldJumps

NORMAL = np.array([[0.0], [0.0], [1.0]])
YIELDS = np.array([2.0])  # how far a unit force moves the sides


def opened(jump):
    """(P,) how far pairs are open."""
    return jump[2]


def laws(pressure):
    """A pair that presses and may open, for p g."""
    return Charges(lambda jump: pressure * np.maximum(opened(jump), 0.0), lambda jump: np.flatnonzero(opened(jump) < -1e-12), NORMAL,
                   1.0, 1e-12, 1e4)


def closed(soft=0.0, priced=True):
    return HeldJumps(np.array([0]), NORMAL.T, np.zeros(1), np.atleast_1d(soft), np.array([priced]))


def pulled(held, wants):
    """Force that holds, and jump, of sides that would be open by ``wants``."""
    pull = wants / (YIELDS + held.soft)
    return pull, NORMAL * (held.soft * pull)


@pytest.mark.parametrize("pressure", [0.1, 0.4])
def test_a_pair_that_is_held_dearly_opens_until_it_pulls_with_its_price(pressure):
    held = closed()
    pull, jump = pulled(held, 1.0)
    assert pull == 0.5
    for _ in range(2):  # the first step gets there, and the second leaves it
        held = closed(held.softened(pull, YIELDS, jump, laws(pressure)))
        pull, jump = pulled(held, 1.0)
        assert pull == pytest.approx(pressure, rel=1e-12)
        assert opened(jump) == pytest.approx(1 - YIELDS * pressure, rel=1e-12)


def test_a_pair_stays_closed_that_is_held_for_less_than_its_price():
    pull, jump = pulled(closed(), 1.0)
    assert closed().softened(pull, YIELDS, jump, laws(0.6)) == 0.0


def test_sides_never_give_way_into_each_other():
    pull, jump = pulled(closed(), -1.0)
    assert closed().softened(pull, YIELDS, jump, laws(0.1)) == 0.0


def test_what_has_no_price_is_held_as_it_is():
    pull, jump = pulled(closed(0.3, False), 1.0)
    assert closed(0.3, False).softened(pull, YIELDS, jump, laws(0.1)) == 0.3
