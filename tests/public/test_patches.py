"""Patch tests: constant stress passes every kind of interface to rounding."""

import numpy as np
import pytest
from helpers import HELD, STEEL, box, on, rollers, solved

PRESSURE = 50.0
STRAIN = PRESSURE / STEEL["young"] * np.array([0.3, 0.3, -1.0])
ROUNDING = 1e-8
BONDED, TOUCHING = ({"method": {"tolerance": {kind: 1e-10}}} for kind in ("error", "law"))


def nodes_of(solution, tmp_path):
    """Nodes and displacement of either side, as the files have them."""
    solution.write(tmp_path / "out")
    with np.load(tmp_path / "out" / "fields.npz") as f:
        return f["nodes"], f["displacement"]


def assert_uniform(solution, tmp_path, strain=STRAIN):
    nodes, displacement = nodes_of(solution, tmp_path)
    exact = nodes * strain
    assert displacement[0] == pytest.approx(exact, abs=ROUNDING * np.abs(exact).max())


def stacked(law: dict, lower=(2, 2, 2), upper=(3, 3, 2), at=1.0, **changes) -> dict:
    """Two boxes on rollers, pressed from above."""
    return {"name": "stack",
            "parts": [box("low", [1, 1, 1], lower), box("high", [1, 1, 1], upper, [0, 0, at])],
            "subdomains": "groups", "materials": [STEEL],
            "interfaces": [{"between": ["low", "high"], **law}],
            "boundary": [*rollers("x", "y", "z"), {"on": "high/zmax", "pressure": PRESSURE}],
            **(BONDED if law == PERFECT else TOUCHING), **changes}


PERFECT = {"law": "perfect"}
FREE, ROUGH = ({"law": "contact", "friction": friction} for friction in (0.0, 0.3))
LAWS = {"perfect": PERFECT, "frictionless": FREE, "friction": ROUGH}


@pytest.mark.parametrize("element, law", [*(("P1", law) for law in LAWS), ("P2", "perfect")])
def test_faces_that_match(law, element, tmp_path):
    code = {"element": element, "workers": 1}
    found = solved(stacked(LAWS[law], upper=(2, 2, 2), blackbox=code))
    assert_uniform(found, tmp_path)
    if law != "perfect":
        nodes = 9 if element == "P1" else 25
        assert found.interfaces.pressure == pytest.approx(np.full((1, nodes), PRESSURE))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_faces_meshed_apart(law, element, tmp_path):
    found = solved(stacked(LAWS[law], blackbox={"element": element, "workers": 1}))
    assert_uniform(found, tmp_path)


@pytest.mark.parametrize("element, cut", [("P1", {"grid": [2, 2, 2]}), ("P2", {"metis": 5})],
                         ids=["grid", "metis"])
def test_cross_points(cut, element, tmp_path):
    """Subdomains that meet along edges and at corners."""
    found = solved({"name": "cube", "mesh": {"box": {"size": [2, 2, 2], "cells": [4, 4, 4]}},
                    "subdomains": cut,
                    "materials": [STEEL],
                    "boundary": [*rollers("x", "y", "z"), {"on": "zmax", "pressure": PRESSURE}],
                    "blackbox": {"element": element, "workers": 1}, **BONDED})
    assert_uniform(found, tmp_path)


def test_eight_cubes_in_contact(tmp_path):
    """Cubes that meet at a corner, pressed from three sides, without friction."""
    pressed = [{"on": f"{axis}max", "pressure": PRESSURE} for axis in "xyz"]
    found = solved({"name": "cubes", "mesh": {"box": {"size": [2, 2, 2], "cells": [4, 4, 4]}},
                    "subdomains": {"grid": [2, 2, 2]}, "materials": [STEEL], "interfaces": [FREE],
                    "boundary": [*rollers("x", "y", "z"), *pressed], **TOUCHING})
    assert_uniform(found, tmp_path, np.full(3, -PRESSURE / STEEL["young"] * (1 - 2 * 0.3)))


def test_uniform_shear(tmp_path):
    """A simple shear through bonds between meshes apart: u_y = γ x, τ = G γ on all sides."""
    slope = 0.0005
    tau = slope * STEEL["young"] / (2 * (1 + STEEL["poisson"]))
    boundary = [{"on": "a/xmin", "displacement": HELD},
                {"on": "b/xmax", "displacement": [0, 2 * slope, 0]},
                *({"on": on("y", y), "traction": [(2 * y - 1) * tau, 0, 0]} for y in (0, 1))]
    parts = [box("a", [1, 1, 1], (2, 2, 2)), box("b", [1, 1, 1], (2, 3, 3), [1, 0, 0])]
    found = solved({"name": "shear", "parts": parts, "subdomains": "groups", "materials": [STEEL],
                    "interfaces": [{"between": ["a", "b"], **PERFECT}], "boundary": boundary,
                    **BONDED})
    nodes, displacement = nodes_of(found, tmp_path)
    exact = np.outer(nodes[:, 0], [0, slope, 0])
    assert displacement[0] == pytest.approx(exact, abs=ROUNDING * slope)
