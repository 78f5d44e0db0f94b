"""Bodies that land after a gap, and bodies that are pulled beyond friction: what is carried, and the share of it."""

import pytest
from helpers import HELD, STEEL, box, on, solved, stopped

WEIGHT = 7.85e-9 * 9810 * 1000  # of a cube of 10


def falling(axis: int, gap: float, **more: object) -> dict:
    """Return a cube of steel above the ground, with its weight along an axis."""
    down, at = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    down[axis], at[axis] = -9810.0, -gap
    ground = {"plane": {"at": at, "normal": "xyz"[axis]}, "name": "ground"}
    return {"name": "falling", "mesh": {"box": {"size": [10, 10, 10], "cells": [2, 2, 2]}}, "subdomains": "groups",
            "materials": [{**STEEL, "density": 7.85e-9}], "boundary": [], "loads": [{"gravity": down}], "method": {"tolerance": {"error": 1e-5}},
            "interfaces": [{"between": ["box", ground], "law": "contact", "friction": 0.3, **more}]}


@pytest.mark.parametrize("axis, gap", [(2, 0.5), pytest.param(0, 1.0, marks=pytest.mark.long)])
def test_a_block_lands_on_the_ground(axis, gap):
    """Its weight alone closes a gap a million times as wide as what it then deforms by."""
    solution = solved(falling(axis, gap))
    assert solution.reactions[0][0][axis] == pytest.approx(WEIGHT, rel=1e-4)
    assert solution.displacement[0, :, axis].min() == pytest.approx(-gap, rel=1e-4)


@pytest.mark.parametrize("ground, poisson", [
    ("ground", 0.3), pytest.param("plane", 0.0, marks=pytest.mark.long)])
def test_landed_blocks_are_as_exact_as_was_asked(ground, poisson):
    """The gap is a thousand times what the block deforms by: its last digits are no error."""
    block, rigid = box("block", [1, 1, 1], [2, 2, 2], [0, 0, 1]), ground == "plane"
    base = box("ground", [3, 3, 1], [3, 3, 1], [-1, -1, -1])
    law = {"between": ["ground", "block"], "gap": "geometry"}
    if rigid:
        law = {"between": ["block", {"plane": {"at": [0, 0, 0], "normal": "z"}}], "within": 3}
    solution = solved({"name": "landing", "subdomains": "groups",
                       "materials": [{"young": 200e3, "poisson": poisson}],
                       "parts": [block] if rigid else [base, block],
                       "interfaces": [{**law, "law": "contact", "friction": 0.1}],
                       "boundary": [*([] if rigid else [{"on": "ground/zmin", "displacement": HELD}]),
                                    {"on": "block/zmax", "traction": [4, 0, -200]}],
                       "method": {"tolerance": {"error": 1e-8}}})
    assert solution.iterations <= 25
    carried = abs(solution.interfaces.resultant[0, 0])
    assert carried == pytest.approx([4, 0, 200], abs=1e-5)


def test_a_block_that_may_never_land_is_no_balance():
    """A gap beyond small displacements holds nothing."""
    assert stopped(falling(2, 50.0, within=75.0)).stop_reason == "limit load"


def pulled(share: float, length: int = 20) -> dict:
    """Return a bar pressed onto a wall by a displacement, and pulled along it with a share of what friction holds."""
    holds = 0.1 * 10 * length  # μ p A
    wall = {"plane": {"at": [0, 0, 0], "normal": "z"}, "name": "wall"}
    return {"name": "pulled", "mesh": {"box": {"size": [length, 1, 1], "cells": [length, 1, 1]}}, "subdomains": "groups",
            "materials": [{"young": 1000, "poisson": 0.0}],
            "interfaces": [{"between": ["*", wall], "law": "contact", "friction": 0.1, "pairing": "fixed"}],
            "boundary": [{"on": on("z", 1), "displacement": [None, None, -0.01]},
                         {"on": on("y", 0), "displacement": [None, 0, None]},
                         {"on": on("x", length), "traction": [holds, 0, 0], "history": "pull"}],
            "histories": {"pull": [0, 0.4, share]}, "method": {"tolerance": {"law": 1e-5}}}


def test_a_bar_holds_what_friction_does():
    assert solved(pulled(0.95)).reactions[-1][-1][0] == pytest.approx(-0.95 * 20, rel=1e-4)


def test_a_bar_that_is_pulled_beyond_friction_has_a_limit_load_and_its_share():
    solution = stopped(pulled(1.1, 14))
    assert solution.stop_reason == "limit load"
    assert solution.summary["limit_load"][0]["factor"] == pytest.approx((1 - 0.4) / (1.1 - 0.4), rel=1e-3)
