"""Where the workers' time goes: it adds up, and the summary, console and report tell it."""

import time

import pytest
from blackbox_case import box, forces, settings

from orchestrator.blackbox.usage import CLOCKS, since
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.load import config_from
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.problems.cases import grains
from orchestrator.timing import Stopwatch


class Moments:
    """Seconds between two blocks of code, at least and at most: whatever reads a clock in both lies in between."""

    def __init__(self):
        self.read: list[tuple[float, float]] = []

    def around(self, what):
        begin = time.perf_counter()
        result = what()
        self.read.append((begin, time.perf_counter()))
        return result

    def allow(self, seconds: float) -> bool:
        (before, first), (last, after) = self.read
        return last - first <= seconds * (1 + 1e-9) and seconds <= (after - before) * (1 + 1e-9)


@pytest.mark.parametrize("transport", ["pipe", "file"])
def test_seconds_of_every_worker_add_up_to_the_wall_clock(transport):
    models, moments = [box(seed=i) for i in range(3)], Moments()
    with make_blackbox(settings(workers=2, transport=transport)) as pool:
        before = moments.around(pool.usage.activity)
        pool.load(models)
        pool.traces({i: forces(m) for i, m in enumerate(models)})
        pool.traces({0: forces(models[0])})
        time.sleep(0.2)
        spent = [since(now, then) for now, then in zip(moments.around(pool.usage.activity), before)]
        clock = pool.usage.clock()
    probed = transport == "pipe"  # models that a process keeps are asked once when all are there
    assert sorted(a["models"] for a in spent) == [1, 2] and sorted(a["calls"] for a in spent) == [2 + probed, 3 + probed]
    assert sum(a["dofs"] for a in spent) == sum((~m.fixed).sum() for m in models)
    for a in spent:
        seconds = sum(a[name] for name in CLOCKS)
        assert moments.allow(seconds), (seconds, moments.read)
        assert a["idle"] >= 0.2 and a["waiting"] >= 0 and a["messages"] > 0
    assert sum(a["factorise"] for a in spent) == pytest.approx(clock["factorise"])
    lazy = min(spent, key=lambda a: a["calls"])  # it waited while the other one answered the last request
    assert lazy["waiting"] > 0


def idle_share(workers):
    return sum(row["waiting"] + row["idle"] for row in workers) / sum(row["seconds"] for row in workers)


@pytest.fixture(scope="module")
def solved():
    config = config_from({**grains(10, 0.2), "blackbox": {"workers": 2}, "method": {"max_iterations": 6}})
    watch = Stopwatch()
    return solve(config, build_scene(config), watch=watch)


def test_record_of_a_run(solved):
    record = solved.summary["workload"]
    assert list(record) == ["set_up", "iterations"]
    for period in record.values():
        assert [row["worker"] for row in period["workers"]] == [0, 1]
        assert sum(row["models"] for row in period["workers"]) == 10
        one, other = (row["seconds"] for row in period["workers"])
        assert one == pytest.approx(other, rel=1e-9), "both until the same moment"
        assert sum(row["seconds"] for row in period["stages"]) <= period["seconds"]
    own = solved.summary["timing"]["blackbox"]
    assert sum(row["factorise"] for row in record["set_up"]["workers"]) == pytest.approx(own["factorise"])
    calls = {row["stage"]: row["calls"] for row in record["iterations"]["stages"]}
    assert calls["local_stage"] == calls["coarse"] == 6
    assert calls["linear_stage"] == 7, "the last one completes the fields that are delivered"
    assert all(row["factorise"] == 0 and row["solve"] > 0 for row in record["iterations"]["workers"])
    assert 0 < idle_share(record["iterations"]["workers"]) < 1
