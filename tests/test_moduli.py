"""Bodies of different moduli in contact: a contrast costs no iterations, whichever side is softer."""

import pytest
from contact_case import BOTTOM, TOP, contact, converged, two_boxes, written

CONTRAST, FACTOR = 1000.0, 1.3
PATH = [[0.0, 0.0, -0.005], [0.01, 0.0, -0.005], [-0.005, 0.0, -0.005]]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return written(tmp_path_factory.mktemp("boxes") / "boxes.msh", two_boxes())


def blocks(boxes, lower, upper, **law):
    """Two irregularly meshed blocks, pressed and sheared both ways."""
    return contact(0.2, error=1e-6, mesh=boxes, subdomains="groups", **law, boundary=[BOTTOM, {"on": TOP, "displacement": PATH}],
                   materials=[{"young": lower, "poisson": 0.3}, {"young": upper, "poisson": 0.3, "on": "upper"}])


@pytest.mark.parametrize("changes", [{}, {"law": [{"law": "jump", "jump": [0, 0, 0.001]}]}], ids=["contact", "jump"])
def test_contrast_costs_no_iterations(boxes, changes):
    """Contact takes its soles near the softer side, a jump that is given near the stiffer: either needs it."""
    equal, *others = (converged(blocks(boxes, *moduli, **changes)).iterations for moduli in (
        (200e3, 200e3), (200e3 / CONTRAST, 200e3), (200e3, 200e3 / CONTRAST)))
    assert max(others) <= FACTOR * equal, (equal, others)
