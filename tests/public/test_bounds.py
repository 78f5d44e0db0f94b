"""Errors that are told beside the true ones, of which the same scene solved much further tells."""

import numpy as np
import pytest
from helpers import HELD, STEEL, box, on, solved

BONDED = {
    "beam in slices": {"mesh": {"beam": {"size": [16, 2, 2], "h": 1}},
                       "subdomains": {"slices": {"axis": "x", "count": 4}},
                       "boundary": [{"on": on("x", 0), "displacement": HELD},
                                    {"on": on("x", 16), "traction": [1, 0, 2]}]},
    "cubes": {"mesh": {"box": {"size": [3, 3, 3], "cells": [6, 6, 6]}},
              "subdomains": {"grid": [3, 3, 3]},
              "boundary": [{"on": "zmin", "displacement": HELD}, {"on": "zmax", "pressure": 2}]},
    "layers of unlike matter": {"mesh": {"box": {"size": [2, 2, 4], "cells": [4, 4, 8]}},
                                "subdomains": {"slices": {"axis": "z", "count": 4}},
                                "materials": [STEEL, {"young": 2e3, "poisson": 0.45, "on": "*"}],
                                "boundary": [{"on": "zmin", "displacement": HELD},
                                             {"on": "zmax", "traction": [1, 0, -1]}]},
    "cut by metis, under its weight": {"mesh": {"box": {"size": [4, 2, 2], "cells": [8, 4, 4]}},
                                       "subdomains": {"metis": 7},
                                       "loads": [{"body_force": [0, 0, -1]}],
                                       "boundary": [{"on": "xmin", "displacement": HELD}]},
    "bonded a little aside": {
        "parts": [box("a", [1, 1, 1], [2, 2, 2]), box("b", [1, 1, 1], [2, 2, 2], [4e-4, 0, 1])],
        "subdomains": "groups", "interfaces": [{"between": "auto", "law": "perfect"}],
        "boundary": [{"on": "a/zmin", "displacement": HELD},
                     {"on": "b/zmax", "traction": [1, 0, -1]}]},
    "a plate of ten-node tets, cut by metis": {
        "mesh": {"box": {"size": [2, 2, 0.2], "cells": [2, 2, 2]}}, "subdomains": {"metis": 5},
        "boundary": [{"on": "xmin", "displacement": HELD}, {"on": "zmax", "traction": [1, 0, -1]}],
        "blackbox": {"element": "P2", "workers": 1}},
}


@pytest.mark.parametrize("scene, tolerance", [*((name, 1e-6) for name in BONDED), ("cubes", 1e-2)])
def test_the_bound_of_bonded_parts(scene, tolerance):
    """True error ≤ bound ≤ tolerance, and the bound within ten times of it."""
    problem = {"name": "bonded", "materials": [STEEL], **BONDED[scene]}
    method = {"tolerance": {"error": tolerance}}
    summary = solved(problem, reference=True, method=method).summary
    assert summary["error_kind"] == "guaranteed"
    assert summary["true_error"] <= summary["error_bound"] <= tolerance
    assert summary["error_bound"] <= 10 * summary["true_error"]


def touching(friction: float, apart: bool = False) -> dict:
    """Two blocks, the upper one smaller, pressed and pushed."""
    cells = [3, 3, 2] if apart else [2, 2, 2]
    return {"name": "touching", "parts": [box("low", [2, 2, 1], [4, 4, 2]),
                                          box("high", [1, 1, 1], cells, [0.5, 0.5, 1])],
            "subdomains": "groups", "materials": [STEEL],
            "boundary": [{"on": "low/zmin", "displacement": HELD},
                         {"on": "high/zmax", "displacement": [3e-4, 0, -1e-3]}],
            "interfaces": [{"between": ["low", "high"], "law": "contact", "friction": friction}]}


def energies(found, exact, folder) -> tuple[float, float]:
    """Strain energy of what two solutions differ by, and of the second, on four-node tets."""
    f, u = {}, []
    for name, solution in (("found", found), ("exact", exact)):
        solution.write(folder / name)
        with np.load(folder / name / "fields.npz") as arrays:
            f = dict(arrays)
        u.append(f["displacement"][-1])
    corners, (first, second) = f["nodes"][f["cells"]], f["lame"].T
    edges, result = corners[:, 1:] - corners[:, :1], []
    for field in (u[0] - u[1], u[1]):
        moved = field[f["cells"]]
        slope = np.linalg.solve(edges, moved[:, 1:] - moved[:, :1])
        strain = (slope + slope.transpose(0, 2, 1)) / 2
        dense = first / 2 * np.trace(strain, axis1=1, axis2=2)**2 + second * (strain**2).sum((1, 2))
        result.append(float(dense @ np.abs(np.linalg.det(edges))) / 6)
    return tuple(result)


@pytest.mark.parametrize("apart", [False, True], ids=["matching", "meshed apart"])
def test_the_energy_error_of_contact_without_friction(apart, tmp_path):
    """Guaranteed, of either side's displacement as it is written."""
    exact = solved(touching(0.0, apart), method={"tolerance": {"law": 1e-10}})
    for tolerance in (3e-2, 1e-3):
        rough = solved(touching(0.0, apart), method={"tolerance": {"error": tolerance}})
        off, size = energies(rough, exact, tmp_path)
        assert size == pytest.approx(exact.energy[-1], rel=1e-8)
        assert rough.summary["error_kind"] == "guaranteed" and rough.error_bound <= tolerance
        assert np.sqrt(off / size) <= rough.error_bound * (1 + rough.error_bound)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_balance_after_contact(friction):
    """What the upper block is pressed and pushed with, the lower one stands on."""
    found = solved(touching(friction, apart=True), method={"tolerance": {"error": 1e-4}})
    force = found.reactions[:, 0]
    assert force[0] == pytest.approx(-force[1], abs=1e-4 * np.abs(force).max())
    assert np.hypot(*force[1, :2]) <= friction * -force[1,
                                                        2] * (1 + 1e-3) + 1e-9 * np.abs(force).max()
