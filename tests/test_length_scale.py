"""Residuals are relative to what is loaded, held and deformed: not to where a loose body happens to be."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import late, quick

from orchestrator.config.load import config_from
from orchestrator.method.checkpoint import Start
from orchestrator.method.events import Subscriber
from orchestrator.run import solve

TOLERANCE = 1e-6
FAR = [0.1, 1e4, 1e6]


def stack(top=None, unit=1.0, **more):
    """Three blocks in frictional contact: the lowest stands, the middle one is pushed, the upper one is sent away."""
    boundary = [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                {"on": {"box": [[0, 0, 0.6 * unit], [0, unit, 0.9 * unit]]}, "displacement": [1e-3 * unit, 0, -5e-3 * unit]}]
    if top is not None:
        boundary.append({"on": {"plane": "z", "at": 1.5 * unit}, "displacement": [0, 0, top * unit]})
    return config_from({
        "name": "stack", "mesh": {"box": {"size": [unit, unit, 1.5 * unit], "cells": [4, 4, 12]}},
        "subdomains": {"grid": [1, 1, 3]}, "materials": [{"young": 200e3 / unit**2, "poisson": 0.3}],
        "boundary": boundary, "interfaces": [{"law": "contact", "friction": 0.2}], "blackbox": IN_PROCESS,
        "method": {"tolerance": {"error": TOLERANCE}, "max_iterations": 200}, **more})


class LastState(Subscriber):
    wants_states = True

    def iteration(self, event):
        self.state = event.state.copy()


@pytest.fixture(scope="module")
def exact():
    """The two lower blocks to many digits."""
    return solve(stack(FAR[0], method={"tolerance": {"error": 1e-9}}))


def apart(solution, exact):
    return max(np.abs(a - b).max() for a, b in zip(solution.sides[:2], exact.sides)) / max(np.abs(u).max() for u in exact.sides[:2])


@pytest.mark.parametrize("far", quick(FAR, FAR[-1]))
def test_a_body_sent_far_away_leaves_the_others_as_exact(exact, far):
    solution = solve(stack(far))
    assert solution.converged and apart(solution, exact) < 10 * TOLERANCE
    assert solution.summary["energy"][0] == pytest.approx(exact.summary["energy"][0], rel=1e-5)


@pytest.mark.long
def test_a_state_out_of_all_proportion_gives_no_wrong_result(exact):
    """What is left of an absurd state is the place of the loose block, as far away as the state says."""
    kept = LastState()
    sound = solve(stack(), subscribers=[kept])
    assert sound.converged
    for factor in (1e3, 1e12):
        resumed = solve(stack(), start=Start(factor * kept.state))
        wrong = max(np.abs(a - b).max() for a, b in zip(resumed.sides[:2], sound.sides)) / np.abs(sound.sides[1]).max()
        assert not resumed.converged or wrong < 30 * TOLERANCE
        assert factor > 1e3 or resumed.converged


@pytest.mark.parametrize("far, converges", [late(1e3, True), (1e6, False)])
def test_energy_and_bound_of_what_is_moved_far(far, converges):
    """Rigid motions have no energy: what they leave of rounding is told by the bound."""
    def bar(at):
        return solve(config_from({
            "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "blackbox": IN_PROCESS,
            "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [{"on": "xmin", "displacement": [at, 0, 0]}, {"on": "xmax", "traction": [10, 1, 0]}]}))

    here, there = bar(0.0), bar(far)
    wrong = np.abs(there.displacement - [far, 0, 0] - here.displacement).max() / np.abs(here.displacement).max()
    assert there.converged == converges and (converges or wrong > TOLERANCE)
    assert there.summary["energy"][0] == pytest.approx(here.summary["energy"][0], rel=1e-5 if converges else 1e-3)
