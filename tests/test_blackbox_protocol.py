"""The protocol is what is used: the pool and every layer keep all of it, and nothing else is asked of them."""

import inspect

import pytest
from blackbox_case import box, forces, settings

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.start import make_blackbox
from orchestrator.blackbox.usage import STAGES, Usage
from orchestrator.config.method import Skip
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.timing import Savings


def faces(protocol: type) -> dict[str, object]:
    """Public members of a protocol."""
    return {name: member for name, member in vars(protocol).items()
            if (not name.startswith("_") or name in ("__enter__", "__exit__")) and callable(member)}


@pytest.mark.parametrize("protocol, kind", [
    (BlackBox, kind) for kind in (Pool, SharedModels, GuardedTraces)], ids=lambda kind: kind.__name__)
def test_every_member_is_there_with_its_arguments(protocol, kind):
    members = faces(protocol)
    assert len(members) >= 7
    for name, member in members.items():
        found, wanted = (list(inspect.signature(m).parameters) for m in (getattr(kind, name), member))
        assert found == wanted, name
    assert "__getattr__" not in {name for parent in kind.__mro__ for name in vars(parent)}


def test_what_runs_keeps_it_too():
    """A stack of all layers around two codes: asked through the top, counted at the bottom."""
    models = [box(name="one"), box((2, 2, 2), "two", seed=3)]
    models[1].code = 1
    with SharedModels(make_blackbox([settings(), settings(transport="file")]), Skip(), 1, 3, Savings()) as top:
        found = top
        while not isinstance(found, Pool):
            assert isinstance(found.usage, Usage)
            found = found.inner
        usage = top.usage
        assert usage is found.usage
        top.load(models)
        answers = top.traces({i: forces(m) for i, m in enumerate(models)})
        assert [answers[i].shape for i in (0, 1)] == [(3, len(m.trace)) for m in models]
        assert list(usage.clock()) == list(STAGES) and usage.asked > 0 and usage.memory_peak_mb() > 10
        assert [row["worker"] for row in usage.activity()] == [0, 1] and [row["models"] for row in usage.activity()] == [1, 1]
        assert sum(row[stage] for row in usage.activity() for stage in STAGES) == pytest.approx(sum(usage.clock().values()))
        assert [(entry["code"], entry["transport"], entry["models"]) for entry in usage.codes()] == [
            ("freefem", "pipe", 1), ("freefem", "file", 1)]
        folders = usage.folders()
        assert len(folders) == 1 and all(folder.is_dir() for folder in folders)
        assert len(usage.pids()) == 1, "a process between requests through pipes only"
    assert not any(folder.exists() for folder in folders) and usage.pids() == []
