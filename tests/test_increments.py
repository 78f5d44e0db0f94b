"""Load steps in batches give what they give together: the history goes on from batch to batch."""

from __future__ import annotations

import numpy as np
import pytest
from in_process import IN_PROCESS

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
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


def test_max_iterations_bounds_the_whole_run():
    """Four batches of one load step: each has at least one iteration, all together no more than were allowed."""
    for allowed in (4, 9):
        stopped = solved(increment=1, max_iterations=allowed)
        assert not stopped.converged and stopped.iterations == allowed == len(stopped.iterated.history)
        assert stopped.summary["stop_reason"] == "max_iterations"
    with pytest.raises(InputError, match="3 iterations for 4 batches"):
        solved(increment=1, max_iterations=3)
