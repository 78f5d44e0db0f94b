"""Soles of contact follow the bodies behind them, wherever they begin."""

import numpy as np
import pytest
from contact_case import BOTTOM, PATH, contact
from method_case import box_of, prepared

from orchestrator.method.coarse.sole_scale import FLAT, NEAR, NOTCH
from orchestrator.blackbox.shared import assembled
from orchestrator.method.interface.search_direction import placed_soles, sole_requests
from orchestrator.scene.build import build_scene
from orchestrator.scene.soles.make import make_soles
from orchestrator.scene.soles import stiffened

USUAL = 1.2


CONTACT = {"law": "contact", "friction": 0.2}


def three(ratio=USUAL, unit=1.0, law=(CONTACT,), **sole):
    """Three blocks, one on the other: the one in the middle is loose. Lengths in any unit."""
    size = [0.5 * unit, 0.5 * unit, 1.5 * unit]
    return contact(law=list(law),
                   mesh={"box": {"size": size, "cells": [2, 2, 6]}}, subdomains={"grid": [1, 1, 3]},
                   materials=[{"young": 200e3 / unit**2, "poisson": 0.3}],
                   boundary=[BOTTOM, {"on": {"plane": "z", "at": size[2]},
                                      "displacement": (unit * np.array(PATH)).tolist()}],
                   method={"tolerance": {"error": 1e-6}, "sole": {"contact_ratio": ratio, "allow_extreme": True, **sole}})


def stiffness(d):
    return d.stage.direction.diagonal.mean()


def made(config):
    with box_of(config) as blackbox:
        return prepared(config, build_scene(config), blackbox)


def test_soles_that_are_too_soft_end_alike_wherever_they_begin():
    """Others stay as they are."""
    ends = {factor: made(three(USUAL * factor)) for factor in (0.03, 0.1, 1, 30)}
    slack = NEAR ** (1 / 0.3)  # what is measured changes by at least the 0.3rd power of k
    for factor in (0.03, 0.1):
        d = ends[factor]
        assert 1 / slack <= stiffness(d) / stiffness(ends[1]) <= slack * FLAT ** (1 / 0.3)
        assert round(np.log(d.made.sole_scale) / np.log(NOTCH), 9) % 1 == 0 and d.made.sole_scale > 2
    assert ends[1].made.sole_scale == ends[30].made.sole_scale == 1
    assert ends[1].made.sweeps < min(ends[0.03].made.sweeps, ends[0.1].made.sweeps)


def test_what_is_loaded_is_what_the_method_reckons_with():
    """A loose body that its soles push by k U moves by U; and k is what the black box assembles."""
    config = three(0.03)
    with box_of(config) as blackbox:
        scene = build_scene(config)
        d = prepared(config, scene, blackbox)
        assert d.made.sole_scale > 2
        direction, middle = d.stage.direction, d.space.owner == 1
        rigid = np.where(middle & (d.space.dof % 3 == 0), 1.0, 0.0)[None]
        moved = d.space.trace(d.stage.solve(d.space.loads(direction.times(rigid))))
        assert moved[:, middle] == pytest.approx(rigid[:, middle], abs=1e-9)
        soles = stiffened(make_soles(scene, config.method.sole), np.full(2, d.made.sole_scale))
        requests = sole_requests(scene, d.space, soles)
        found = assembled([model for model, _, _ in requests], blackbox, True)
        again = placed_soles(d.space, requests, found)
        assert abs(again.whole - direction.whole).max() <= 1e-12 * abs(direction.whole).max()
