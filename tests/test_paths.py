"""Values along lines, and forces across planes."""

import csv

import numpy as np
import pytest
from in_process import IN_PROCESS
from method_case import CLAMP, config, method
from quick import quick

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.results.compare import compare
from orchestrator.results.solution import Solution
from orchestrator.scene.build import build_scene
from orchestrator.solving import solve

PULL = {"on": {"plane": "x", "at": 4.0}, "traction": [[10.0, 0.0, 0.0], [5.0, 2.0, -1.0]]}  # over an area of 1


def probed(probes: list[dict], **changes) -> Solution:
    made = config(**{"boundary": [CLAMP, PULL], **changes}, output={"probes": probes})
    return solve(made, build_scene(made))


def values(solution: Solution, name: str) -> dict[str, np.ndarray]:
    found = next(one for one in solution.summary["probes"] if one["name"] == name)
    return {key: np.array(column) for key, column in found["values"].items()}


def test_a_path_has_what_points_have(tmp_path):
    ends = [[0.1, 0.3, 0.4], [3.9, 0.6, 0.4]]
    at = [[float(x) for x in np.array(ends[0]) + t * (np.array(ends[1]) - ends[0])] for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
    points = [{"name": f"{what} {k}", "at": place, "quantity": what} for what in ("displacement", "stress") for k, place in enumerate(at)]
    lines = [{"name": what, "along": ends, "points": 5, "quantity": what} for what in ("displacement", "stress")]
    solution = probed([*points, *lines])
    for path in solution.summary["paths"]:
        for k in range(5):
            there = values(solution, f"{path['name']} {k}")
            for component, column in path["values"].items():
                assert np.allclose(column[:, k], there[component], rtol=1e-12, atol=1e-15), (path["name"], k, component)
        assert path["distance"][-1] == pytest.approx(np.linalg.norm(np.subtract(*ends)))
    with open(solution.write(tmp_path) / "paths.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 2 * 5 and float(rows[3]["ux"]) == solution.summary["paths"][0]["values"]["ux"][0, 3] and rows[3]["sxx"] == ""
    assert not compare(tmp_path, tmp_path).different
    assert Solution.read(tmp_path).summary["paths"][0]["name"] == "displacement"


def test_a_path_may_leave_the_body_and_not_miss_it():
    solution = probed([{"name": "out", "along": [[2, 0.5, 0.5], [6, 0.5, 0.5]], "points": 5}])
    path, = solution.summary["paths"]
    assert np.isfinite(path["values"]["ux"]).tolist() == [[True, True, True, False, False]] * 2
    assert any("2 of the 5 points of 'out' are outside" in warning for warning in solution.summary["warnings"])
    with pytest.raises(InputError, match="all points from"):
        build_scene(config(output={"probes": [{"along": [[9, 9, 9], [8, 8, 8]]}]}))


ASKEW = {"plane": [1.0, 0.2, -0.1], "at": [1.7, 0.5, 0.5]}


@pytest.mark.parametrize("plane", quick([{"plane": "x", "at": 1.0}, {"plane": "x", "at": 2.2}, ASKEW], ASKEW),
                         ids=["between subdomains", "through tets", "askew"])
def test_a_section_carries_what_acts_beyond_it(plane):
    solution = probed([{"name": "cut", "section": plane, "about": [4.0, 0.5, 0.5]}], **method(tolerance={"error": 1e-8}))
    found = values(solution, "cut")
    force = np.stack([found[key] for key in ("fx", "fy", "fz")], axis=1)
    assert np.allclose(force, [[10.0, 0.0, 0.0], [5.0, 2.0, -1.0]], atol=1e-5)
    moment = np.stack([found[key] for key in ("mx", "my", "mz")], axis=1)  # of the traction about the middle of the end that it acts on
    assert np.allclose(moment, 0.0, atol=1e-4)
    normal = np.array(plane["plane"] if isinstance(plane["plane"], list) else [1.0, 0.0, 0.0])
    normal /= np.linalg.norm(normal)
    assert np.allclose(found["normal"], force @ normal) and np.allclose(found["normal"]**2 + found["shear"]**2, (force**2).sum(axis=1))


def test_planes_beside_the_body_and_along_what_may_open_are_refused():
    with pytest.raises(InputError, match="no tets have their centres behind the plane, or none before it"):
        build_scene(config(output={"probes": [{"section": {"plane": "x", "at": 7}}]}))
    opening = {"interfaces": [{"law": "contact", "friction": 0.1}], "output": {"probes": [{"section": {"plane": "x", "at": 2.0}}]}}
    with pytest.raises(InputError, match=r"runs along slice 1 \| slice 2, where sides may part"):
        build_scene(config(**opening))


@pytest.mark.parametrize("probe, found", [
    ({"along": [[0, 0, 0], [0, 0, 0]]}, "two ends apart"), ({"along": [[0, 0, 0]]}, "along"),
    ({"section": {"plane": [0, 0, 1], "at": 2}}, "a point on"),
    ({"section": {"plane": [0, 0, 0], "at": [0, 0, 0]}}, "a direction"), ({"section": {"plane": "x"}}, "at")])
def test_bad_paths_and_sections_are_told(probe, found):
    bar = {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
           "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": [CLAMP], "blackbox": IN_PROCESS}
    with pytest.raises(InputError, match=found):
        config_from({**bar, "output": {"probes": [probe]}})
