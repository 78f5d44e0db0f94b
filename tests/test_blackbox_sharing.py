"""A slow worker does not hold up the others: models are loaded elsewhere where that pays, and taken by who is free."""

import time

import numpy as np
import pytest
from blackbox_case import box, difference, forces, settings

from orchestrator.blackbox.pool.pool import Pool
from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.pool.sharing import IMBALANCE, LEAST, Sharing
from orchestrator.blackbox.transport.session import MessageWorker
from orchestrator.errors import BlackBoxError

PAUSE = 0.04  # seconds per model by which one worker is slow


@pytest.fixture
def slow(monkeypatch):
    """The first of two workers pauses over each of its models; the list says over how many, batch after batch."""
    solve, taken = MessageWorker.solve, []

    def slowly(self, op, jobs, names):
        if self.number == 0:
            taken.append(len(jobs))
            time.sleep(PAUSE * len(jobs))
        return solve(self, op, jobs, names)

    monkeypatch.setattr(MessageWorker, "solve", slowly)
    return taken


def pool():
    return Pool(find_codes([settings(workers=2)]))


def test_a_slow_workers_models_are_shared_once(slow):
    models = [box(name=f"box {i}", seed=i) for i in range(12)]
    asked = {i: forces(m) for i, m in enumerate(models)}
    with pool() as blackbox:
        blackbox.load(models)
        held = [row.models for row in blackbox.usage.activity()]
        first, paused = blackbox.traces(asked), []
        for _ in range(LEAST + 6):
            slow.clear()
            again = blackbox.traces(asked)
            paused.append(sum(slow))
            assert all(np.array_equal(again[i], first[i]) for i in asked)
        sharing = blackbox._sharing[0]
        assert sharing.settled and sharing.busy[0] > IMBALANCE * sharing.busy.mean()
        both = [i for i, workers in sharing.holders.items() if len(workers) == 2]
        assert both and all(sharing.holders[i] == [0, 1] for i in both)
        now = blackbox.usage.activity()
        assert [row.models for row in now] == [held[0], held[1] + len(both)]
        assert blackbox.usage.codes()[0]["models"] == len(models)
        assert set(paused[: LEAST - 1]) == {6} and min(paused[LEAST:]) < 6, "the other has taken some of them over"
        some = {i: asked[i] for i in [*both[:1], 11]}
        assert all(np.array_equal(u, first[i]) for i, u in blackbox.traces(some).items())
        fields = blackbox.fields({both[0]: np.ones((1, models[both[0]].fixed.size))})
        assert np.isfinite(fields[both[0]]).all()


@pytest.mark.parametrize("wrong", [1e-6, 1e-2])
def test_who_answers_otherwise_takes_nothing_over(slow, monkeypatch, wrong):
    """Beyond rounding the models stay where they are, so that results do not depend on who is quick; beyond that it is an error."""
    models, solve, homes = [box(name=f"box {i}", seed=i) for i in range(12)], MessageWorker.solve, {}

    def otherwise(self, op, jobs, names):
        answers = solve(self, op, jobs, names)
        return {i: u if homes.setdefault(i, self.number) == self.number else (1 + wrong) * u for i, u in answers.items()}

    monkeypatch.setattr(MessageWorker, "solve", otherwise)
    asked = {i: forces(m) for i, m in enumerate(models)}
    with pool() as blackbox:
        blackbox.load(models)
        if wrong > 1e-4:
            with pytest.raises(BlackBoxError, match="answers otherwise"):
                for _ in range(LEAST + 2):
                    blackbox.traces(asked)
            return
        first = blackbox.traces(asked)
        for _ in range(LEAST + 2):
            assert all(difference(u, first[i]) == 0 for i, u in blackbox.traces(asked).items())
        assert blackbox._sharing[0].settled and all(len(workers) == 1 for workers in blackbox._sharing[0].holders.values())


def sharing(busy, loading=(0.1, 0.1), requests=LEAST):
    made = Sharing({0: [0, 1, 2, 3], 1: [4, 5, 6, 7]}, dict.fromkeys(range(8), 1.0), dict(enumerate(loading)))
    for _ in range(requests):
        made.answered(dict(enumerate(busy)))
    return made


def test_models_move_only_where_it_pays():
    assert sharing((1.0, 1.2)).moves() == []
    assert sharing((3.0, 1.0), requests=LEAST - 1).moves() == []
    moves = sharing((3.0, 1.0)).moves()  # 0.75 s each there, 0.25 s here
    assert moves == [(0, 1), (1, 1)]
    assert sharing((3.0, 1.0), loading=(100.0, 100.0)).moves() == []  # 50 s for two factors, to save 1.5 s 17 times
    assert sharing((0.03, 0.01)).moves() == []  # nobody would notice
    done = sharing((3.0, 1.0))
    done.settle(moves)
    assert done.moves() == []
    assert Sharing({0: [0], 1: []}, {0: 1.0}, {0: 0.1}).moves() == []


def test_a_queue_gives_everything_once_to_who_may_have_it():
    made = sharing((3.0, 1.0))
    made.settle([(0, 1), (1, 1)])
    alone, queue = made.tasks(range(8))
    assert alone == {0: [2, 3], 1: [4, 5, 6, 7]} and queue.takers == {0, 1}
    assert queue.take(0) == [0] and queue.take(1) == [1] and queue.take(0) == [] == queue.take(1)
    alone, queue = made.tasks([1])
    assert alone == {0: [], 1: []} and queue.take(1) == [1]
    alone, queue = made.tasks([2])
    assert alone == {0: [2]} and not queue.takers and queue.take(0) == []
