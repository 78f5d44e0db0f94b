"""Planes and boxes on thin parts, alone and beside large ones: the faces that are meant, and never those behind them."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

PLATE = {"mesh": {"box": {"size": [1000, 1000, 0.001], "cells": [3, 3, 1]}}}
HALL = {"parts": [boxed("hall", [1000, 1000, 1000]), boxed("chip", [0.1, 0.1, 0.0008], [2, 2, 1], [1100, 0, 0])]}


def forces(source, on, element="P1") -> tuple[np.ndarray, np.ndarray]:
    """The sum of what a pressure of 1 exerts, and the places of its nodes; every part is held at its lowest x."""
    parts = [part["name"] for part in source.get("parts", [])]
    held = [{"on": f"{name}/xmin" if name else "xmin", "displacement": [0, 0, 0]} for name in parts or [""]]
    scene = build_scene(config_from({"name": "thin", **source, "subdomains": "groups" if parts else {"metis": 2},
                                     "materials": [{"young": 1.0, "poisson": 0.3}], "blackbox": {"code": "freefem", "element": element},
                                     "boundary": [*held, {"on": on, "pressure": 1.0}]}))
    return scene.loads[0].sum(axis=0), scene.mesh.nodes[scene.boundary[-1].nodes]


@pytest.mark.parametrize("source, on, expected, level", [
    (PLATE, {"plane": "z", "at": 0}, 1e6, 0.0), (PLATE, {"plane": "z", "at": 0.001}, -1e6, 0.001),
    (PLATE, {"plane": "z", "at": 1e-9}, 1e6, 0.0), (PLATE, {"box": [[0, 0, 0], [1000, 1000, 0]]}, 1e6, 0.0),
    (PLATE, {"box": [[-1, -1, 0.001], [1001, 1001, 1]]}, -1e6, 0.001), (HALL, {"plane": "z", "at": 0.0008}, -0.01, 0.0008),
    (HALL, {"box": [[0, 0, 0.0008], [1200, 1000, 0.0008]]}, -0.01, 0.0008), (HALL, {"plane": "z", "at": 0}, 1e6 + 0.01, 0.0),
])
@pytest.mark.parametrize("scale, element", [(1.0, "P1"), (1e-3, "P2")])
def test_one_face_of_a_thin_part_is_taken(source, on, expected, level, scale, element):
    def scaled(x):
        return [scaled(y) for y in x] if isinstance(x, list) else {k: v if k == "cells" else scaled(v) for k, v in x.items()} \
            if isinstance(x, dict) else scale * x if isinstance(x, float | int) else x

    force, nodes = forces(scaled(source), scaled(on), element)
    assert force == pytest.approx([0, 0, expected * scale**2], rel=1e-9, abs=1e-9 * scale**2)
    assert np.ptp(nodes[:, 2]) <= 1e-12 * scale and nodes[0, 2] == pytest.approx(level * scale)


@pytest.mark.parametrize("source, on, words", [
    (PLATE, {"plane": "z", "at": 0.0004}, "no boundary face lies on the plane z = 0.0004; the nearest boundary node is 0.0004 away"),
    (HALL, {"plane": "z", "at": 0.0004}, "the plane z = 0.0004 meets no face exactly; some are up to 0.0004 off"),
    (PLATE, {"box": [[0, 0, -1], [1000, 1000, -0.0005]]}, "no boundary face has its three nodes in the box"),
])
def test_what_lies_between_two_faces_is_refused(source, on, words):
    with pytest.raises(InputError, match=words.replace(".", r"\.")):
        forces(source, on)


def test_digits_that_are_left_out_are_forgiven():
    """A plane at a third of a length, written with six digits."""
    force, nodes = forces({"mesh": {"box": {"size": [100, 100, 100 / 3], "cells": [2, 2, 2]}}}, {"plane": "z", "at": 33.3333})
    assert force == pytest.approx([0, 0, -1e4]) and np.ptp(nodes[:, 2]) == 0


@pytest.mark.parametrize("law, inertia", [
    ({"law": "contact"}, 2 * 10 / 12), ({"law": "elastic", "stiffness_n": 1e5, "stiffness_t": 1e4}, 8 * 10 / 12)], ids=["loose", "glued"])
def test_slender_bodies_bend_as_far_as_they_have_to(law, inertia):
    """Two strips a hundred times as long as they are high, one on the other, go a million times as far as the first stage takes them;
    q L⁴/(8 E I), each by itself or both as one."""
    size, cells = [100, 10, 1], [12, 1, 1]
    solution = solve(config_from({
        "name": "strips", "parts": [boxed("low", size, cells), boxed("high", size, cells, at=[0, 0, 1])], "subdomains": "groups",
        "materials": [{"young": 2e5, "poisson": 0.0}], "interfaces": [{"between": "auto", **law}],
        "boundary": [*({"on": f"{name}/xmin", "displacement": [0, 0, 0]} for name in ("low", "high")),
                     {"on": "high/zmax", "traction": [0, 0, -0.001]}],
        "blackbox": {**IN_PROCESS, "element": "P2"}, "method": {"tolerance": {"error": 1e-4}}, "output": {"figures": False}}))
    assert solution.converged, solution.stop_reason
    assert solution.summary["iterations"] <= 60
    assert solution.summary["peak_displacement"]["value"] == pytest.approx(0.01 * 100**4 / (8 * 2e5 * inertia), rel=0.015)
