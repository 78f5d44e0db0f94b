"""Places of contact that elements are too large for are told of, and no others."""

import numpy as np
import pytest
from boxes import boxed
from quick import late
from test_tools import block, solved

TOLD = "hardly wider than a face"


def told(solution) -> bool:
    return any(TOLD in text for text in solution.summary["warnings"])


@pytest.mark.parametrize("radius, force, few, element", [
    (2.0, 1.0, True, "P1"), late(2.0, 1.0, True, "P2"), late(40.0, 9.0, False, "P1"), late(40.0, 9.0, False, "P2")])
def test_a_ball_on_a_coarse_block(radius, force, few, element):
    """Of radius 2 it meets a place of a twentieth of the block's width, a fifth of a face; of 40 one as wide as two faces and a half."""
    ball = {"sphere": {"centre": [0.5, 0.5, 0.5 + radius], "radius": radius}}
    found = solved(block({**ball, "displacement": [0, 0, None], "force": [0, 0, -force]}, element))
    assert told(found) == few


def test_plane_sides_that_part():
    """A plate whose ends are lifted off a block: a row of points is left closed, but not by shape."""
    found = solved({**{key: value for key, value in block({}).items() if key != "mesh"}, "subdomains": "groups",
                    "parts": [boxed("low", [1, 0.25, 0.25], [8, 2, 2]), boxed("high", [1, 0.25, 0.1], [8, 2, 2], [0, 0, 0.25])],
                    "interfaces": [{"between": ["low", "high"], "law": "contact"}], "boundary": [
                        {"on": "low/zmin", "displacement": [0, 0, 0]}, {"on": "high/zmax", "traction": [0, 0, -1.0]},
                        *({"on": f"high/{end}", "displacement": [0, 0, 0.01]} for end in ("xmin", "xmax"))]})
    assert np.count_nonzero(found.interfaces.pressure[0] > 0) == 3 and not told(found)
