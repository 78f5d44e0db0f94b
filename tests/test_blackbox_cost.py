"""The cost model: what it decides between solves and an interface compliance, whoever asks."""

import math

import numpy as np
import pytest
from blackbox_case import box, settings

from orchestrator.blackbox import cost
from orchestrator.blackbox.cost import Request, compliance_pays, copies, to_come
from orchestrator.blackbox.start import make_blackbox


def spent(requests: int, trace: int, cases: int, request: Request, unit_loads: Request, expected: int = 0) -> float:
    """Seconds of a run of so many requests that follows the model."""
    seconds = 0.0
    for done in range(requests):
        if compliance_pays(trace, to_come(done, expected), cases, request, unit_loads):
            return seconds + unit_loads.of(trace)
        seconds += request.of(cases)
    return seconds


@pytest.mark.parametrize("start, each, factor", [(0.0, 1e-3, 1.0), (0.3, 1e-3, 1.0), (0.0, 0.2, 0.01), (0.05, 0.01, 30.0)],
                         ids=["alive", "runs", "green", "dear unit loads"])
def test_at_most_twice_the_cheaper_way(start, each, factor):
    """However many requests come: codes that stay alive, end after every run, or have a cheaper way to unit loads."""
    request, unit_loads = Request(start, each), Request(start, factor * each)
    for trace in (9, 150, 1500):
        for cases in (1, 7):
            formed = unit_loads.of(trace)
            for requests in (1, 2, 5, 17, 60, 400, 5000):
                found = spent(requests, trace, cases, request, unit_loads)
                solved = requests * request.of(cases)
                assert found <= 2 * min(solved, formed) + request.of(cases)


def test_what_is_expected_decides_before_anything_has_been():
    """Twenty stages are worth twenty solves of each load case, less nothing more; forty dofs are not."""
    request = Request(0.0, 1.0)
    assert [compliance_pays(trace, to_come(0, 20), 2, request, request) for trace in (39, 40, 41)] == [True, False, False]
    assert not compliance_pays(39, to_come(0), 2, request, request), "nothing is expected of who was never asked"
    assert [to_come(done, 20) for done in (0, 5, 10, 19, 30)] == [20, 15, 11, 20, 31]


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
        monkeypatch.setattr(cost, "room", lambda: room)
        with make_blackbox(settings(**code)) as blackbox:
            blackbox.load([model])
            answers = [blackbox.traces({0: forces})[0] for _ in range(2)]
            assert bool(blackbox.usage.codes()[0]["compliances"]) is formed
        assert all(np.abs(u - expected).max() < 1e-11 * np.abs(expected).max() for u in answers)
