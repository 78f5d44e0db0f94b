"""The protocol is what is used: the pool and every layer keep all of it, and nothing else is asked of them."""

import inspect

import pytest

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.blackbox.pool import Pool
from orchestrator.method.linear.answers import GuardedTraces


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
