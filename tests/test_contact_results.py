"""What a run with contact leaves behind: both sides, statuses, resultants, bodies that come loose, warnings."""

from dataclasses import replace

import method_case as case
import numpy as np
import pytest

from orchestrator.laws.contact import OPEN, SLIP, STICK
from orchestrator.method.delivery.moved import rotations
from orchestrator.results.summary.cautions import cautions
from orchestrator.results.summary.lines import summary_rows

FRICTION = 0.3
FLOOR = {"on": {"plane": "z", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}
RUNS = {"tolerance": {"law": 1e-8}}


def stack(blocks: int, top: list, between=("*", "*"), friction=FRICTION, **changes):
    """Blocks of 1 × 1 × 1 on top of each other, held below, the top moved."""
    contact = {"between": list(between), "law": "contact", "friction": friction, **changes.pop("law", {})}
    roof = {"on": {"plane": "z", "at": float(blocks)}, "displacement": top}
    return {"mesh": {"box": {"size": [1.0, 1.0, float(blocks)], "cells": [2, 2, 2 * blocks]}},
            "subdomains": {"grid": [1, 1, blocks]}, "boundary": [FLOOR, roof], "interfaces": [contact],
            **case.method(**RUNS), **changes}


PRESS_SHEAR_LIFT = [[0, 0, -2e-3], [5e-3, 0, -2e-3], [0, 0, 4e-3]]


@pytest.fixture(scope="module")
def pressed():
    """Two blocks: pressed, sheared until they slide, lifted off each other."""
    return case.solved(False, **stack(2, PRESS_SHEAR_LIFT))


@pytest.fixture(scope="module")
def loose():
    """Three blocks, the middle one pressed between the others, then left alone."""
    return case.solved(False, **stack(3, [[0, 0, -3e-3], [0, 0, 3e-3]]))


def test_statuses_agree_with_gaps_pressures_and_friction(pressed):
    i = pressed.interfaces
    assert pressed.converged and (i.steps, len(i.nodes)) == (3, 9)
    small, top = 1e-6 * np.abs(pressed.displacement).max(), i.pressure.max()
    tangential = np.linalg.norm(i.friction_traction, axis=2)
    limit = FRICTION * i.pressure
    assert (i.gap >= -small).all() and (i.pressure >= -1e-6 * top).all()
    assert (np.abs(i.pressure[i.status == OPEN]) <= 1e-6 * top).all()
    assert (np.abs(i.gap[i.status != OPEN]) <= small).all()
    assert (tangential <= limit + 1e-6 * top).all()
    np.testing.assert_allclose(tangential[i.status == SLIP], limit[i.status == SLIP], atol=1e-6 * top)
    assert (i.status[0] == STICK).any() and (i.status[1] == SLIP).all() and (i.status[2] == OPEN).all()
    np.testing.assert_allclose(i.gap[2], 4e-3, rtol=1e-6)
    # the tangential vectors are tangential
    for field in (i.slip, i.friction_traction):
        assert np.abs(np.einsum("tni,ni->tn", field, i.normal)).max() <= 1e-12 * max(np.abs(field).max(), 1)


def test_detached_body_is_named(loose):
    names = [s.name for s in loose.scene.subdomains]
    assert loose.summary["detached"] == [[], [names[1]]]
    assert loose.summary["weakly_held"] == [[], []]
    text = dict(summary_rows(loose.summary))["not held"]
    assert text.startswith(names[1]) and "load step 2" in text and "where stabilisation leaves it" in text


def test_warnings():
    """High friction, contact inside a part, long slides, large displacement and rotation: each in a sentence."""
    found = case.solved(False, **stack(2, [[0.9, 0, -2e-3]], friction=0.01))
    texts = found.summary["warnings"]
    assert any("inside one part (box)" in t for t in texts) and any("slid by more than an element" in t for t in texts)
    assert any("displaced by more than 10%" in t for t in texts) and not any("friction" in t for t in texts)
    assert "block 0-0-1" in dict(summary_rows(found.summary))["warning"]
    interface = found.scene.interfaces[0]
    interface.law = replace(interface.law, friction=1.5)
    assert any("friction 1.5" in t and "not assured" in t for t in cautions(found.scene, found.sides, found.met))
    points = np.random.default_rng(1).normal(size=(20, 3))
    spin = np.array([[0.0, 0.2, 0.0], [0.01, 0, 0]])
    turned = np.cross(spin[:, None, :], points) + np.array([1.0, 2.0, 3.0])
    assert rotations([points, points], [turned, 0 * turned]) == pytest.approx([0.2, 0], rel=1e-12)
    sides = [np.cross([0.0, 0.2, 0.0], found.scene.mesh.nodes[s.nodes])[None] for s in found.scene.subdomains]
    assert any("rotated by up to 0.2 rad" in t for t in cautions(found.scene, sides))
    names = [s.name for s in found.scene.subdomains]
    assert cautions(found.scene, sides, detached=[names]) == [], "where a detached body is means nothing"
