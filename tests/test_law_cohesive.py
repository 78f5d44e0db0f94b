"""Glue that breaks, against its closed form: traction, damage, unloading, shear, pressing; resumed, beside contact, in the files."""

import numpy as np
import pytest
from method_case import config
from test_keeping import stopped_and_resumed
from test_laws import COUNT, assert_consistent, missed, points_of

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.laws.base import Written
from orchestrator.laws.points import Points
from orchestrator.registry import LAWS
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

YOUNG, LENGTH = 1000.0, 2.0
K, STRENGTH, TOUGHNESS = 4000.0, 10.0, 0.2
FIRST, LAST = STRENGTH / K, 2 * TOUGHNESS / STRENGTH
GLUE = {"law": "cohesive", "stiffness": K, "strength": STRENGTH, "toughness": TOUGHNESS}
# led from both ends: whole, softening, back, less than before, softening on, broken, pressed
LED = [0.01, 0.03, 0.012, 0.02, 0.035, 0.06, -0.01]


def bar(led, axis=0, steps=None, **changes):
    """Two blocks of half the length with glue between them, one end held, the other led along an axis; no lateral strain."""
    moves = [[value if c == axis else 0.0 for c in range(3)] for value in led]
    return config(**{
        "mesh": {"box": {"size": [LENGTH, 1.0, 1.0], "cells": [4, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": YOUNG, "poisson": 0.0}], "interfaces": [GLUE],
        "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "displacement": moves}],
        "method": {"tolerance": {"error": 1e-9}}, **changes})


def test_sheared():
    """The same law along the interface: blocks that cannot bend answer with G/L alone."""
    points, law = _points(1)
    led = np.linspace(0, 2 * LAST, 40)
    damage = np.zeros(1)
    energy, before, force = 0.0, 0.0, 0.0
    for end in led[1:]:  # a stiff machine leads the pair
        answer = law.force(points.at(0, {"damage": damage}), np.array([[0.0], [0.0], [1e9 * end]]), None)
        damage, now = answer.own["damage"], float(answer.force[2, 0])
        energy, before, force = energy + 0.5 * (now + force) * (end - before), end, now
    assert damage[0] == 1 and energy == pytest.approx(TOUGHNESS, rel=2e-2)


def _points(count):
    law = LAWS["cohesive"]
    made = law.of(law.Parameters(**GLUE), count, 1.0)
    area = np.ones(count)
    normal = np.repeat([[1.0], [0.0], [0.0]], count, axis=1)
    return Points(normal, *np.full((2, count), 1e9), area, made.parameters(np.arange(count), area, area)), made


# it falls by no less than .93 of what the softest pair's search direction rises by
STEEP = {"stiffness": 3.0, "strength": 0.4, "toughness": 0.37}


def drawn():
    """Pairs of every damage drawn in all directions: the law, its points, what it answers, the jump that comes with it."""
    random, law = np.random.default_rng(6), LAWS["cohesive"].of(LAWS["cohesive"].Parameters(law="cohesive", **STEEP), COUNT, 1.0)
    points = points_of(law, random)
    damage = np.where(random.random(COUNT) < 0.5, 0.0, random.random(COUNT))
    damage[:5] = 1.0
    F = random.normal(size=(3, COUNT)) * random.uniform(0.1, 4.0, COUNT)
    F[:, 5:10] -= points.along(F)[5:10] * points.normal[:, 5:10]
    points = points.at(0, {"damage": damage})
    answer = law.force(points, F, None)
    return law, points, damage, answer, points.compliance(F - answer.force)


def test_glue_carries_what_its_damage_leaves():
    """f = (1 − D) K A d, whole where pressed, D by the largest separation so far: wherever Newton's method has begun."""
    _, points, damage, answer, d = drawn()
    first, last, d_n = 0.4 / 3.0, 2 * 0.37 / 0.4, points.along(d)
    apart = np.hypot(np.maximum(d_n, 0.0), np.linalg.norm(points.across(d), axis=0))
    before = first * last / (last - damage * (last - first))
    kappa = np.minimum(np.maximum(before, apart), last)
    found = answer.own["damage"]
    assert found == pytest.approx(last * (kappa - first) / (kappa * (last - first)), abs=1e-12)
    left = (1 - found) * 3.0 * points.area
    normal = np.where(d_n > 0, left, 3.0 * points.area)
    assert answer.force == pytest.approx(left * points.across(d) + normal * d_n * points.normal, abs=1e-12)
    grown = found > damage
    assert min((grown & (found < 1)).sum(), (grown & (found == 1)).sum(), (~grown & (damage > 0)).sum(), (found == 0).sum()) > 5
    names = np.where(found >= 1, "broken", np.where(found > 0, "damaged", "intact"))
    assert [status.name for status in LAWS["cohesive"].statuses[:3]] == ["intact", "damaged", "broken"]
    assert np.array_equal(names, np.array(["intact", "damaged", "broken"])[answer.status - answer.status.min()])
    assert answer.active is None is answer.derivative


def test_what_glue_misses_is_weighed_by_how_soft_it_is():
    law, points, _, answer, d = drawn()
    left = (1 - answer.own["damage"]) * 3.0 * points.area
    found, wanted = missed(law, points, answer, d, d, np.where(points.along(d) > 0, left, 3.0 * points.area), left)
    assert found == pytest.approx(wanted)


def test_glue_written_to_files_is_checked_node_by_node():
    """Drawn, pressed and broken beside a whole and a shortened normal: closed forms; the worse of both components is told."""
    law = LAWS["cohesive"].of(LAWS["cohesive"].Parameters(law="cohesive", **STEEP), 4, 1.0)
    assert law.rigidity == 3.0
    length, opening, damage = np.array([1.0, 0.6, 1.0, 0.6]), np.array([0.5, 0.3, -0.5, -0.3]), np.array([0.0, 0.5, 0.5, 1.0])
    slip = np.random.default_rng(0).normal(size=(1, 4, 3))
    left = 3.0 * (1 - damage)
    sound = dict(opening=opening[None], slip=slip, shear=left[:, None] * slip, chosen=np.arange(4), length=length,
                 own={"damage": damage[None]},
                 pressure=(-np.where(opening > 0, left, 3.0) * opening / length**2)[None])

    def worst(**change):
        return law.violations(Written(**sound | change), 2.0, 4.0)["the glue's law"]

    assert worst() < 1e-15
    for node in range(4):
        pressure, shear = sound["pressure"].copy(), sound["shear"].copy()
        pressure[0, node] -= 0.1
        shear[0, node] += [0.0, 0.03, 0.04]
        assert worst(pressure=pressure) == pytest.approx(0.1 * length[node] / 10.0)
        assert worst(shear=shear) == pytest.approx(0.05 / 10.0)
        assert worst(pressure=pressure, shear=shear) == pytest.approx(max(0.1 * length[node], 0.05) / 10.0)


def test_force_and_derivative_belong_together(monkeypatch):
    """Pairs of every damage, also where it grows, in all directions."""
    law, random = LAWS["cohesive"], np.random.default_rng(2)
    own = law.force
    monkeypatch.setattr(law, "force", staticmethod(lambda points, *a, **k: own(points.at(0, {"damage": damage}), *a, **k)))
    damage = np.where(random.random(COUNT) < 0.5, 0.0, random.random(COUNT))
    assert_consistent("cohesive", {"stiffness": 3.0, "strength": 0.4, "toughness": 1.0})


def test_a_stopped_run_knows_the_damage(tmp_path):
    made = bar(LED, method={"tolerance": {"error": 1e-9}, "increment": 2})
    scene = build_scene(made)
    whole = solve(made, scene)
    resumed, _ = stopped_and_resumed(tmp_path, made, scene, [2, whole.iterations // 2, whole.iterations - 1])
    assert resumed.interfaces.own["damage"] == pytest.approx(whole.interfaces.own["damage"], abs=1e-10)


def test_toughness_that_is_spent_before_the_strength_is_refused():
    with pytest.raises(InputError, match="(?s)toughness above strength.*raise it above 0.0125"):
        config_from({**bar([1.0]).complete(), "interfaces": [{**GLUE, "toughness": 1e-3}]})
    least = STRENGTH**2 / (2 * K)
    assert [len(list(LAWS["cohesive"].Parameters.broken({**GLUE, "toughness": x * least}))) for x in (0.999, 1.0, 1.001)] == [1, 1, 0]
