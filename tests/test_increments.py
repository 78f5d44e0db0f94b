"""Load steps in batches give what they give together: the history goes on from batch to batch."""

from __future__ import annotations

import numpy as np
import pytest
from in_process import IN_PROCESS
from test_keeping import stopped_and_resumed

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method import halving
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

SCENE = {
    "name": "blocks", "mesh": {"box": {"size": [2, 2, 2], "cells": [4, 4, 4]}}, "subdomains": {"grid": [1, 1, 2]},
    "materials": [{"young": 200e3, "poisson": 0.3}],
    "boundary": [
        {"on": "zmin", "displacement": [0, 0, 0]},
        {"on": "zmax", "displacement": [[0, 0, -0.002], [0.002, 0, -0.002], [0.001, 0, -0.002], [0, 0, -0.001]]},
    ],
    "interfaces": [{"between": ["*", "*"], "law": "contact", "friction": 0.3}],
    "blackbox": IN_PROCESS,
}


def solved(**method):
    config = config_from({**SCENE, "method": {"tolerance": {"law": 1e-9}, **method}})
    return solve(config, build_scene(config))


@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.long
def test_batches_of_load_steps_continue_the_history(size):
    """Reactions and statuses agree with all steps solved together; friction makes them depend on the path."""
    together, batches = solved(), solved(increment=size)
    assert together.converged and batches.converged
    ours, theirs = np.array(batches.summary["reactions"]), np.array(together.summary["reactions"])
    assert np.abs(ours - theirs).max() <= 1e-7 * np.abs(theirs).max()
    assert batches.summary["status_counts"] == together.summary["status_counts"]
    loaded, back = theirs[1][0], theirs[1][2]
    assert abs(back[0]) > 1e-3 * abs(loaded[2])  # the way back is not the way there: there is a history to carry


def test_a_reference_with_contact_is_refused():
    """The undecomposed solution bonds everything: it would be a false reference."""
    config = config_from(SCENE)
    with pytest.raises(InputError, match="perfect interfaces"):
        solve(config, build_scene(config), reference=True)


PRESSED, SHEARED = [0, 0, -0.002], [0.002, 0, -0.002]
HALVES = [(1, 0.0, 1.0), (1, 0.0, 0.5)]  # load step, from 0, and the parts of it that are halved: its first half is halved again


def pressed(*path, kind="displacement"):
    """Two blocks in frictional contact, pressed and sheared, load step by load step."""
    boundary = [SCENE["boundary"][0], {"on": "zmax", kind: [*path]}]
    config = config_from({**SCENE, "boundary": boundary, "method": {"tolerance": {"error": 1e-6}, "increment": 1}})
    return config, build_scene(config)


@pytest.fixture
def halved(monkeypatch):
    """Parts of load steps are taken not to settle, once they have, as large ones do not; the rest is as it is."""
    before = halving.Plan.smaller

    def smaller(plan, now, most):
        part = plan.now
        if now.verdict.reason and (part.steps.start, part.begin, part.end) in HALVES:
            return halving.UNSETTLED
        return before(plan, now, most)

    monkeypatch.setattr(halving.Plan, "smaller", smaller)


@pytest.mark.long
def test_a_run_that_is_stopped_within_a_load_step_goes_on_there(halved, tmp_path):
    made, scene = pressed(PRESSED, SHEARED)
    whole = solve(made, scene)
    first = whole.summary["load_path"][1]["after"]
    resumed, told = stopped_and_resumed(tmp_path, made, scene, [first + 4, whole.iterations - 3])
    assert [event.iteration for event in told] == list(range(1, whole.iterations + 1))
    assert np.abs(resumed.displacement - whole.displacement).max() <= 1e-12 * np.abs(whole.displacement).max()
    assert resumed.summary["load_path"] == whole.summary["load_path"]
