"""Points that lag behind: their laws are solved as they are, together with how bodies move."""

from types import SimpleNamespace

import numpy as np
import pytest
from contact_case import CASES, contact
from method_case import box_of, prepared

from orchestrator.method.coarse import correction
from orchestrator.method.monitors import lagging
from orchestrator.scene.build import build_scene


@pytest.fixture(scope="module")
def eight():
    """Eight cubes pressed together, and fields that are far from the laws."""
    made = contact(1.0, **CASES["eight cubes"], method={"sole": {"fit": False}, "tolerance": {"error": 1e-6}})
    with box_of(made) as blackbox:
        yield prepared(made, build_scene(made), blackbox)


def evaluated(d, s):
    fields = d.coarse(d.stage(s))
    return SimpleNamespace(problem=d, fields=fields, local=d.local(fields), number=9, last=False, measures=SimpleNamespace(residual=0.5),
                           verdict=SimpleNamespace(reason="", laws=SimpleNamespace(largest_other=1e-4)))


def test_what_lags_behind_is_solved(eight):
    """The points chosen carry most of what is left; with fields of their own they carry nothing, and fields stay admissible."""
    s = eight.local(eight.stage(np.zeros((eight.steps, eight.space.size)))).s
    before = evaluated(eight, s)
    monitor = lagging.LaggingPoints(eight.space)
    verdict = monitor.judge(before)
    assert verdict.changes == ("lagging",) and verdict.sweeps * eight.steps == eight.coarse.most(np.flatnonzero(monitor.chosen))
    changed = monitor.change(before)
    changed.coarse.problem.reduction = 1e-8
    after = evaluated(changed, s)
    chosen, pairs = np.isin(eight.local.pairs.transfer.one, np.flatnonzero(monitor.chosen)).any(axis=0), eight.local.pairs
    apart = [np.abs(now.local.force - pairs.traces(*now.fields.extended).force)[..., chosen].max() for now in (before, after)]
    assert chosen.any() and not chosen.all() and apart[1] <= 1e-5 * apart[0]
    answered, largest = eight.stage(after.fields.s), np.abs(after.fields.f).max()
    assert np.abs(answered.f - after.fields.f).max() <= 1e-9 * largest


def test_bodies_without_room_go_on_without(eight, monkeypatch):
    """Where there are so many that their usual fields alone are all that there is room for."""
    monkeypatch.setattr(correction, "UNKNOWNS", 5 * eight.coarse.bodies)
    monkeypatch.setattr(correction, "TIMES", 1)
    assert len(eight.coarse.response.U) > 5 and eight.coarse.room == 0
    s = eight.local(eight.stage(np.zeros((eight.steps, eight.space.size)))).s
    assert lagging.LaggingPoints(eight.space).judge(evaluated(eight, s)).changes == ()


def test_of_many_bodies_each_may_have_some(eight, monkeypatch):
    monkeypatch.setattr(correction, "UNKNOWNS", 1)
    s = eight.local(eight.stage(np.zeros((eight.steps, eight.space.size)))).s
    monitor, now, usual = lagging.LaggingPoints(eight.space), evaluated(eight, s), eight.coarse.response.U
    assert monitor.judge(now).changes == ("lagging",)
    fields = monitor.change(now).coarse.response.U
    assert len(usual) < len(fields) <= 3 * len(usual) and np.array_equal(fields[: len(usual)], usual)


def test_a_resumed_run_has_the_same_fields(eight):
    s = eight.local(eight.stage(np.zeros((eight.steps, eight.space.size)))).s
    before, monitor = evaluated(eight, s), lagging.LaggingPoints(eight.space)
    monitor.judge(before)
    changed, other = monitor.change(before), lagging.LaggingPoints(eight.space)
    assert np.array_equal(other.restore(monitor.state(), eight).coarse.response.U, changed.coarse.response.U)


def test_points_give_way_only_to_others_of_their_body(eight, monkeypatch):
    """What lags behind later has fields beside what did before; a body that has no room beside them takes the later ones."""
    s = eight.local(eight.stage(np.zeros((eight.steps, eight.space.size)))).s
    now, monitor, owner = evaluated(eight, s), lagging.LaggingPoints(eight.space), eight.space.owner[: eight.space.size]
    wanted = lagging.traces_of(now, lagging.lags(now) > lagging.SHARE)
    monitor.own = ~wanted & (owner == owner[np.flatnonzero(wanted)[0]])  # one body has all others of its own
    monitor.own[np.flatnonzero(~wanted & (owner != owner[np.flatnonzero(wanted)[0]]))[:1]] = True
    monkeypatch.setattr(type(eight.coarse), "room", int(np.bincount(owner[wanted]).max()) + 1)
    full = np.bincount(owner[monitor.own | wanted]) > type(eight.coarse).room
    assert full.sum() == 1
    assert np.array_equal(monitor.fitting(now), np.where(full[owner], wanted, monitor.own | wanted))
