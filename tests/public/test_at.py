"""Values at any point of a solution, before and after it is written."""

import numpy as np
import orchestrator
import pytest
from helpers import HELD, STEEL, box, on, solved

YOUNG = STEEL["young"]
PULLED = {"name": "pulled", "subdomains": "groups", "materials": [{"young": YOUNG, "poisson": 0.0}],
          "parts": [box("left", [2, 1, 1], [4, 2, 2]), box("right", [2, 1, 1], [3, 2, 2], [2, 0, 0])],
          "boundary": [{"on": on("x", 0), "displacement": HELD}, {"on": on("x", 4), "traction": [10, 0, 0]}],
          "histories": {"twice": [1, 2]}, "interfaces": [{"between": "auto", "law": "perfect"}]}
PLACES = np.array([[0.3, 0.2, 0.9], [2.0, 0.5, 0.5], [3.7, 1.0, 0.0], [4.2, 0.5, 0.5]])


def test_a_bar_stretches_linearly_and_outside_nothing_is_known(tmp_path):
    """Displacement 10 x / E, stress 10; a point of both parts has the same value in each."""
    solution = solved(PULLED)
    for each in (solution, orchestrator.Solution.read(solution.write(tmp_path / "out"))):
        found = each.at(PLACES)
        assert found["displacement"].shape == (1, 4, 3) and found["stress"].shape == (1, 4, 6)
        assert found["displacement"][0, :3, 0] == pytest.approx(10 * PLACES[:3, 0] / YOUNG, rel=1e-5)
        assert found["stress"][0, :3, 0] == pytest.approx(10, rel=1e-4) and np.isnan(found["von_mises"][0, 3])
        sides = [each.at(PLACES[1], part)["displacement"][0, 0, 0] for part in ("left", "right")]
        assert sides == pytest.approx([20 / YOUNG] * 2, rel=1e-5)


def test_sides_that_part_have_values_of_their_own():
    """Two blocks that a gap of a tenth keeps apart: the upper one moves, the lower one does not."""
    parts = [box("low", [1, 1, 1], [2, 2, 2]), box("high", [1, 1, 1], [2, 2, 2], [0, 0, 1])]
    solution = solved({"name": "gap", "subdomains": "groups", "materials": [STEEL], "parts": parts,
                       "interfaces": [{"between": "auto", "law": "contact", "friction": 0.1}],
                       "boundary": [{"on": on("z", 0), "displacement": HELD}, {"on": on("z", 2), "displacement": [0, 0, 0.1]}]})
    low, high = (solution.at([0.5, 0.5, 1.0], part)["displacement"][0, 0, 2] for part in ("low", "high"))
    assert low == pytest.approx(0, abs=1e-6) and high == pytest.approx(0.1, rel=1e-4)
