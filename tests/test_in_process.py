"""What the tests of the method find in process, FreeFEM finds: every kind of scene they use, solved by both."""

import pytest
from contact_case import BOTTOM, CASES, TOP, contact
from in_process import FREEFEM, IN_PROCESS
from method_case import CLAMP, CUBES, METIS, close, config, irregular, layered, method
from test_method import BENT, LOADS
from test_soft_modes import flat, mixed
from quick import quick

from orchestrator.run import solve
from orchestrator.scene.build import build_scene

PRECISE = method(tolerance={"error": 1e-10})
HISTORIES = {"histories": {"pull": [0.5, 0.0, 1.0], "press": [1.0, 0.0, -1.0]}, "boundary": [
    CLAMP, {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 0.0, 1.0], "history": "pull"},
    {"on": {"plane": "z", "at": 2.0}, "pressure": 2.0, "history": "press"}]}
P2 = {"element": "P2"}
STRIPES = [{"young": 200.0, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "*2"}]
BONDED = {  # name: folder → configuration but for the black box, and what is changed in that
    "slices": (lambda f: {**BENT, **PRECISE}, {}),
    "cubes, every load": (lambda f: {**CUBES, **LOADS["everything"], **PRECISE}, {}),
    "cubes, load steps": (lambda f: {**CUBES, **HISTORIES, **PRECISE}, {}),
    "metis, settled support": (lambda f: {**METIS, **LOADS["settled support"], **PRECISE}, {}),
    "irregular": (lambda f: {**BENT, **PRECISE, "mesh": irregular(f / "box.meshb"), "subdomains": {"metis": 9}}, {}),
    "contrast": (lambda f: {**BENT, **method(), "mesh": layered(f / "b.meshb", [0, 1, 0, 1]), "materials": STRIPES}, {}),
    "soft and stiff tets": (lambda f: mixed(f / "mixed.mesh", **PRECISE), {}),
    "flat": (lambda f: flat(**PRECISE), {}),
    "mono-scale, layer": (lambda f: {**CUBES, **BENT, **method(
        {"kind": "layer", "modulus_ratio": 0.1}, macro={"strategy": "none"}, tolerance={"error": 1e-10})}, {}),
    "plain, continuity": (lambda f: {**BENT, **method(
        macro={"strategy": "continuity"}, acceleration="none", tolerance={"error": 1e-2})}, {}),
    "ten-node tets": (lambda f: {**METIS, **BENT, **PRECISE}, P2),
}
PRESS = [BOTTOM, {"on": TOP, "displacement": [[0, 0, -0.002], [0.002, 0, -0.002]]}]
CONTACT = {
    "two blocks": (lambda **b: contact(0.3, error=1e-9, **b), {}),
    "eight cubes": (lambda **b: contact(0.1, error=1e-9, **CASES["eight cubes"], **b), {}),
    "ten grains": (lambda **b: contact(0.3, error=1e-9, **CASES["ten grains"], **b), {}),
    "press fit": (lambda **b: contact(0.2, gap=-0.001, boundary=[
        BOTTOM, {"on": TOP, "displacement": [0, 0, 0]}], error=1e-9, **b), {}),
    "a jump beside contact": (lambda **b: contact(law=[
        {"law": "contact", "friction": 0.3}, {"between": ["block *-0", "block *-1"], "law": "jump", "jump": [0.001, 0, 0]}],
        error=1e-9, **CASES["eight cubes"], **b), {}),
    "ten-node tets": (lambda **b: contact(0.3, error=1e-9, mesh={"box": {"size": [1, 1, 1], "cells": [3, 3, 4]}},
                                          boundary=PRESS, **b), P2),
}


def of_both(make, changes):
    """Solutions in process and through FreeFEM."""
    for blackbox in (IN_PROCESS, FREEFEM):
        made = make(blackbox={**blackbox, **changes})
        found = solve(made, build_scene(made))
        assert found.iterated.converged, found.iterated.stop_reason
        yield found


def made_to(solved):
    """The tolerance that a solution was made to."""
    return solved.summary["tolerance"]


@pytest.mark.parametrize("name", quick(BONDED, "cubes, every load"))
def test_bonded_scenes(tmp_path, name):
    """The same iterations, one by one, and the same field and reactions; rounding may cost or save the last one."""
    data, changes = BONDED[name]
    ours, theirs = of_both(lambda **blackbox: config(**{**data(tmp_path), **blackbox}), changes)
    common = min(ours.iterated.iterations, theirs.iterated.iterations)
    assert max(ours.iterated.iterations, theirs.iterated.iterations) - common <= 1
    assert close(*([e.residual for e in s.iterated.history[:common]] for s in (ours, theirs)), 1e-6)
    same = 1e-9 if ours.iterated.iterations == theirs.iterated.iterations else made_to(ours)
    assert close(ours.displacement, theirs.displacement, same)
    assert close(ours.summary["reactions"], theirs.summary["reactions"], same)


@pytest.mark.parametrize("name", quick(CONTACT, "two blocks"))
@pytest.mark.long
def test_scenes_with_contact(name):
    """The same statuses, and the same forces as far as the tolerance tells them."""
    make, changes = CONTACT[name]
    ours, theirs = of_both(make, changes)
    assert abs(ours.iterated.iterations - theirs.iterated.iterations) <= 2  # rounding may cost or save one
    assert ours.summary["status_counts"] == theirs.summary["status_counts"]
    assert close(ours.summary["reactions"], theirs.summary["reactions"], 1e-7)
    # pairs that stick in a circle about a grain's edge carry forces that no body feels: rounding decides on their last digits
    assert close(ours.interfaces.pressure, theirs.interfaces.pressure, 1e-4 if name == "ten grains" else 1e-6)
