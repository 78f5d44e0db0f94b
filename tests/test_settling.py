"""A loose body slides until something stops it."""

from types import SimpleNamespace

import numpy as np
import pytest

from orchestrator.laws.contact import Contact
from orchestrator.laws.points import Points
from orchestrator.method.coarse.settling import Body
from orchestrator.method.interface.pairs import History, Pairs, Run
from orchestrator.method.interface.ties import Prescribed
from orchestrator.method.interface.transfer import Transfer

GAP, PUSH = 0.5, 0.1


def pushed_body(friction: float = 0.0) -> Body:
    """A body free along x and y, pushed by ``PUSH``, with a wall of stiffness 1 at the distance ``GAP`` in x."""
    normal = np.array([[1.0], [0], [0]])
    points = Points(normal, *np.ones((3, 1)), {"gap": np.full(1, GAP), "friction": np.full(1, friction)})
    dofs, bounds = np.zeros((3, 1), int), np.array([0, 1])
    transfer = Transfer(dofs, dofs, 1, 1, bounds, [(dofs[:, 0], dofs[:, 0])], np.ones(1, bool), np.zeros(1, bool))
    pairs = Pairs([SimpleNamespace(law=Contact(friction, np.full(1, GAP)))], transfer, None,
                  [Run(Contact, slice(0, 1), points)], np.ones(1, bool), [Contact], None, Prescribed.nothing(1), np.arange(1))
    fields = np.zeros((1, 3, 12))
    fields[0, 0, 0] = fields[0, 1, 1] = 1.0
    stiffness = np.diag(np.r_[0.0, 0.0, np.ones(10)])  # what the body lacks stays at rest
    return Body(pairs, np.array([0]), fields, -fields, stiffness, fields[0])


def settled(body: Body, rho: np.ndarray, radius: float) -> np.ndarray:
    return body.settle(np.zeros((3, 1)), History.none(1), 0, rho, 1e-10, radius)


def test_a_pushed_body_comes_to_rest_at_the_wall():
    rho = np.r_[-PUSH, np.zeros(11)]
    assert settled(pushed_body(), rho, 10.0) == pytest.approx(np.r_[GAP + PUSH, np.zeros(11)], abs=1e-9)


def test_no_body_moves_further_than_the_radius_at_once():
    change = settled(pushed_body(), np.r_[-PUSH, np.zeros(11)], 0.2)
    assert change == pytest.approx(np.r_[0.2, np.zeros(11)])


def test_friction_at_the_wall_holds_what_slides_along():
    rho = np.r_[-PUSH, -0.02, np.zeros(10)]
    change = settled(pushed_body(friction=0.3), rho, 10.0)
    assert change[0] == pytest.approx(GAP + PUSH)
    force = -change + np.r_[GAP, np.zeros(11)]  # of the sticking pair
    assert force[:2] == pytest.approx([-PUSH, -0.02], abs=1e-9) and np.hypot(*force[1:3]) < 0.3 * PUSH


def test_a_balanced_body_rests():
    assert not settled(pushed_body(), np.zeros(12), 1.0).any()
