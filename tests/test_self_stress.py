"""Forces that no body feels, where interfaces meet at nodes: the linear stage answers alike, and the laws decide about them."""

import numpy as np
import pytest
from contact_case import CASES, contact
from in_process import IN_PROCESS
from method_case import box_of, prepared

from orchestrator.config.load import config_from
from orchestrator.method.coarse.node_loops import node_loops
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.problems.cases import pressed_cubes


@pytest.fixture(scope="module")
def eight():
    """Eight cubes; the upper four and the lower four have nodes that are prescribed on the middle planes."""
    made = contact(0.2, **CASES["eight cubes"], method={"sole": {"fit": False}, "tolerance": {"error": 1e-6}})
    with box_of(made) as blackbox:
        yield prepared(made, build_scene(made), blackbox)


def test_groups_are_the_loops_at_edges_and_at_the_corner_of_all(eight):
    """Four cubes meet at an edge: one loop of four pairs, in three components; twelve pairs at the corner of all eight."""
    groups = {g.slots.shape[1]: g for g in node_loops(eight.space, eight.local.pairs)}
    assert sorted(groups) == [4, 12] and all(not g.shared.any() for g in groups.values())
    assert groups[4].states.shape[3] == 3 and groups[12].states.shape[3] == 3 * (12 - 8 + 1) and len(groups[12].slots) == 1
    # six edges from the corner of all, of two nodes each that are not on it; bonded where both sides are prescribed
    assert len(groups[4].slots) == 6 * 2 - 2


def test_no_body_feels_it(eight):
    d, rng = eight, np.random.default_rng(5)
    s = 1e2 * rng.normal(size=(d.steps, d.space.size))
    before = d.stage(s)
    after = d.self_stress()(before, d.local)
    change = after.s - s
    assert np.abs(change).max() > 1e-2 * np.abs(s).max()
    answered = d.stage(after.s)
    largest = np.abs(before.f).max()
    assert np.abs(answered.w - before.w).max() <= 1e-12 * np.abs(before.w).max()
    assert np.abs(answered.f - after.f).max() <= 1e-10 * largest and np.array_equal(after.w, before.w)
    one, two = (x[d.local.pairs.free] for x in (d.local.pairs.transfer.one, d.local.pairs.transfer.two))
    assert np.abs(change[:, one] + change[:, two]).max() <= 1e-12 * largest  # both sides feel the same


def test_it_brings_forces_nearer_to_the_laws(eight):
    """Of what the laws answer there, each group is no farther off than before, and most are nearer."""
    d, rng = eight, np.random.default_rng(6)
    before = d.stage(1e2 * rng.normal(size=(d.steps, d.space.size)))
    after = d.self_stress()(before, d.local)
    pairs, own = d.local.pairs, d.self_stress()

    def left(fields):
        at = pairs.traces(*fields.extended)
        F, q = at.predicted()[0], at.force[0]
        force = pairs.settled(pairs.force(F, d.local.before, 0).force, F, d.local.before.jump)[0]
        return [np.linalg.norm(f.sums((q - force)[:, own.chosen].T)[:, :, 0], axis=1) for f in own.families]

    for one, two in zip(left(before), left(after)):
        assert (two <= one * (1 + 1e-9)).all() and np.median(two / one) < 0.5


@pytest.mark.long
def test_cubes_whose_edges_nearly_stick():
    """92 iterations without it."""
    made = config_from({**pressed_cubes(0.1, elements=2), "blackbox": IN_PROCESS,
                        "method": {"tolerance": {"error": 1e-6}, "max_iterations": 60, "contact": {"stabilisation": 2.5e-9}}})
    assert solve(made).converged
