"""The cost model: what it decides between solves and an interface compliance, whoever asks."""

import math

import numpy as np
import pytest
from blackbox_case import box, settings

from orchestrator.blackbox.start import make_blackbox
from orchestrator.blackbox.transport import runs


@pytest.mark.parametrize("code", [{"code": "calculix"}, {"transport": "file"}], ids=str)
def test_no_compliance_without_room_for_it(code, monkeypatch):
    """A code that ends after every run does not form what memory would not hold; answers are right."""
    model = box(name="wide")
    forces = np.random.default_rng(2).standard_normal((2 * len(model.trace), len(model.trace)))
    with make_blackbox(settings()) as plain:
        plain.load([model])
        expected = plain.traces({0: forces})[0]
    for room, formed in ((0.0, False), (math.inf, True)):
        monkeypatch.setattr(runs, "memory_left", lambda: room / runs.MEMORY)
        with make_blackbox(settings(**code)) as blackbox:
            blackbox.load([model])
            answers = [blackbox.traces({0: forces})[0] for _ in range(2)]
            assert bool(blackbox.usage.codes()[0]["compliances"]) is formed
        assert all(np.abs(u - expected).max() < 1e-11 * np.abs(expected).max() for u in answers)
