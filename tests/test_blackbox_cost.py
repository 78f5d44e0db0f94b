"""The cost model: what it decides between solves and an interface compliance, whoever asks."""

import math

import numpy as np
import pytest
from blackbox_case import box, settings

from orchestrator.blackbox.shared import copies
from orchestrator.blackbox.start import make_blackbox
from orchestrator.blackbox.transport import runs
from orchestrator.blackbox.transport.runs import Request, Tally


@pytest.mark.parametrize("start, each, factor", [(0.0, 1e-3, 1.0), (0.3, 1e-3, 1.0), (0.0, 0.2, 0.01), (0.05, 0.01, 30.0)],
                         ids=["alive", "runs", "green", "dear unit loads"])
def test_at_most_twice_the_cheaper_way(start, each, factor):
    """However many requests come: codes that stay alive, end after every run, or have a cheaper way to unit loads."""
    request, unit_loads = Request(start, each), Request(start, factor * each)
    for trace in (9, 150, 1500):
        for cases in (1, 7):
            for requests in (1, 2, 5, 17, 60, 1500):
                tally, seconds = Tally("one", trace, request, unit_loads), 0.0
                for _ in range(requests):
                    if tally.due(cases):
                        seconds += unit_loads.of(trace)
                        break
                    tally.spent += request.of(cases)
                    seconds += request.of(cases)
                assert seconds <= 2 * min(requests * request.of(cases), unit_loads.of(trace)) + request.of(cases)


def test_copies_pay_by_the_solves_they_take_off_others():
    assert copies(1, 1, 8) == 1
    assert copies(60, 60, 8) == 8, "as many as there are workers"
    assert copies(60, 3, 8) == 3, "or members"
    assert copies(12, 60, 8) == 2, "each must be worth a factorisation"


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
