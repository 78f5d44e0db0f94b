"""Values along lines, and forces across planes."""


import numpy as np
import pytest
from in_process import IN_PROCESS
from method_case import CLAMP, config, method
from quick import quick

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
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
