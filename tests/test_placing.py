"""Ranks whose codes are slow have subdomains taken from them; ranks that are held up for a moment keep theirs."""

from types import SimpleNamespace

import numpy as np
import pytest
from threads import among

from orchestrator.method.monitors.placing import Placing, Unbalanced

USUAL = 2.0  # seconds of a request


@pytest.mark.parametrize("slow, found", [([4.0] * 6, True), ([9.0, 2.0, 2.0, 9.0, 9.0, 9.0], False)], ids=["always", "at times"])
def test_the_least_seconds_of_requests_count(slow, found):
    """Of rank 1; a request for nothing takes none, and says nothing."""
    def of_rank(team):
        spent = [0.0]
        monitor = Placing(team, lambda: spent[0], 1.0, 10.0, lambda: True)
        for number, seconds in enumerate([0.0, *slow], 1):
            spent[0] += seconds and (seconds if team.rank else USUAL)
            try:
                monitor.judge(SimpleNamespace(verdict=SimpleNamespace(reason=""), number=number))
            except Unbalanced as error:
                return error
        return None

    ended = among(2, of_rank)
    assert [type(error) for error in ended] == [Unbalanced if found else type(None)] * 2
    if found:
        assert ended[0].speeds == pytest.approx(np.array([2, 1]) / 3) and ended[0].iteration == 3
