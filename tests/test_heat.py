"""Matter that expands: against CalculiX and Lamé, expansion without stress, what is stored; and what is wrong with it."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS
from ring_case import ring

from orchestrator.config.load import config_from, load_config
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.kit.calculix_whole import displacements

STEEL = {"young": 200e3, "poisson": 0.3, "expansion": 1.2e-5}
LINEAR = {"at": [0, 0, 0], "value": 10.0, "gradient": [30.0, -20.0, 50.0]}


def bar(element: str = "P1", loads: list | None = None, **changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [1, 1, 2], "cells": [2, 2, 3]}}, "subdomains": {"slices": {"axis": "z", "count": 2}},
            "materials": [STEEL], "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}, {"on": "zmax", "displacement": [0, 0, None]}],
            "loads": [{"temperature": LINEAR, "history": "to and fro"}] if loads is None else loads,
            "histories": {"to and fro": [1.0, -2.0]}, "blackbox": {**IN_PROCESS, "element": element},
            "method": {"tolerance": {"error": 1e-9}}, **changes}


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_field_of_temperature_does_what_it_does_in_calculix(element, tmp_path):
    solution = solve(config_from(bar(element)), reference=element == "P1")
    warmth = LINEAR["value"] + solution.scene.mesh.nodes @ LINEAR["gradient"]
    exact = displacements(solution.scene, tmp_path, heat=np.outer([1, -2], warmth))
    assert solution.converged and np.abs(exact - solution.displacement).max() < 1e-6 * np.abs(exact).max()
    assert np.abs(solution.scene.loads.sum(axis=1)).max() < 1e-10 * np.abs(solution.scene.loads).max()
    assert solution.energy[1] == pytest.approx(4 * solution.energy[0], rel=1e-8)
    if element == "P1":
        assert solution.summary["true_error"] < solution.error_bound < 1e-9


HELD = [{"on": side, "symmetry": True} for side in ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")]
CUBES = [boxed("a"), boxed("b", at=[0, 0, 1])]
STILL = {
    "held": {}, "ten nodes": {"blackbox": {**IN_PROCESS, "element": "P2"}}, "pieces": {"subdomains": {"metis": 3}},
    "no slip": {"boundary": [{"on": "*", "displacement": [0, 0, 0]}]},
    "moved": {"boundary": [{"on": "*", "displacement": [0.01, 0.02, 0.03]}]},
    "steps of nothing": {"loads": [{"temperature": 100.0, "history": "h"}], "histories": {"h": [1.0, 0.0]}},
    "contact": {"interfaces": [{"law": "contact", "friction": 0.2}],
                "parts": CUBES,
                "boundary": [{"on": on, "symmetry": True} for on in ("*/x*", "*/y*", "a/zmin", "b/zmax")], "subdomains": {"groups": True}}}


@pytest.mark.parametrize("what", STILL)
def test_what_is_heated_and_cannot_move_is_sound(what):
    """The exact answer is no displacement at all beside what is prescribed: stress −E α ΔT / (1 − 2ν), and no error to warn of."""
    data = {**bar(loads=[{"temperature": 100.0}], boundary=HELD, histories={}), "method": {}, **STILL[what]}
    if "parts" in data:
        del data["mesh"]
    solution = solve(config_from(data))
    assert solution.converged, solution.stop_reason
    moved = np.array([0.01, 0.02, 0.03]) if what == "moved" else 0.0
    assert np.abs(solution.displacement - moved).max() < 1e-8 * 1.2e-3
    pressed = -STEEL["young"] * 1.2e-3 / (1 - 2 * STEEL["poisson"])
    assert np.abs(solution.fields.stress(0)[:, :3] - pressed).max() < 1e-6 * abs(pressed)
    assert solution.summary["discretisation_error"] < 1e-5
    assert not [text for text in solution.summary["warnings"] if "small perturbations" not in text]


def test_a_thick_cylinder_under_pressure_and_heat_is_what_lame_says(tmp_path):
    """Plane strain, P2. Pressure p inside; then T = T₀ ln(b/r)/ln(b/a) alone: within half a per cent."""
    a, b, p, young, nu, alpha, hot = 1.0, 2.0, 50.0, 200e3, 0.3, 1.2e-5, 100.0
    x = ring(tmp_path / "ring.msh", a, b, 0.15, (5, 12, 1))
    r = np.hypot(x[:, 0], x[:, 1])
    np.savetxt(tmp_path / "warm.csv", np.c_[x, hot * np.log(b / r) / np.log(b / a)], fmt="%.12g")
    solution = solve(config_from({
        "name": "cylinder", "mesh": {"file": str(tmp_path / "ring.msh")}, "subdomains": {"metis": 2}, "materials": [
            {"young": young, "poisson": nu, "expansion": alpha}],
        "boundary": [*({"on": side, "symmetry": True} for side in ("start", "end", "low", "high")),
                     {"on": "inner", "pressure": p, "history": "first"}],
        "loads": [{"temperature": {"file": str(tmp_path / "warm.csv")}, "history": "second"}],
        "histories": {"first": [1, 0], "second": [0, 1]}, "blackbox": {**IN_PROCESS, "element": "P2"}}))
    nodes = solution.scene.mesh.nodes[: len(x)]
    r = np.hypot(nodes[:, 0], nodes[:, 1])
    radial = np.einsum("tni,ni->tn", solution.displacement[:, : len(x), :2], nodes[:, :2] / r[:, None])
    c = p * a**2 / (b**2 - a**2)
    pressed = (1 + nu) / young * c * ((1 - 2 * nu) * r + b**2 / r)
    mean = lambda s: (hot / np.log(b / a)) * (s**2 / 2 * np.log(b / s) + s**2 / 4 - a**2 / 2 * np.log(b / a) - a**2 / 4)  # ∫ T r dr
    heated = (1 + nu) / (1 - nu) * alpha * (mean(r) / r + ((1 - 2 * nu) * r + a**2 / r) * mean(b) / (b**2 - a**2))
    for found, exact in zip(radial, (pressed, heated)):
        assert np.abs(found - exact).max() < 5e-3 * np.abs(exact).max()
    nodal = solution.fields.nodal
    at = nodal.points
    inside = np.flatnonzero((np.hypot(at[:, 0], at[:, 1]) < a * 1.001) & (at[:, 1] < 1e-9))
    hoop = [nodal.stress(t)[inside, 1].mean() for t in (0, 1)]  # σ_yy where the ring crosses the plane y = 0
    exact = [c * (1 + b**2 / a**2), young * alpha / (1 - nu) * (mean(b) * 2 / (b**2 - a**2) - hot)]
    assert hoop == pytest.approx(exact, rel=2e-2)  # nodal stresses at an edge, whose elements are a fifth of the wall


WRONG = {
    "no expansion": ({"materials": [{"young": 1.0, "poisson": 0.3}]}, ("loads", 0, "temperature"), "materials[0]"),
    "two kinds": ({"loads": [{"temperature": 1.0, "gravity": [0, 0, 1.0]}]}, ("loads", 0, "gravity"), "together"),
    "no such volume": ({"loads": [{"temperature": 1.0, "on": "bx"}]}, ("loads", 0, "on"), "'bx'"),
    "no place": ({"loads": [{"temperature": {"gradient": [0, 0, 1.0]}}]}, ("loads", 0, "temperature"), "at and gradient together"),
    "nothing": ({"loads": [{"temperature": {}}]}, ("loads", 0, "temperature"), "nothing"),
    "a word": ({"loads": [{"temperature": "warm"}]}, ("loads", 0, "temperature"), "a number, or"),
    "a file and a value": ({"loads": [{"temperature": {"file": "a", "value": 1.0}}]}, ("loads", 0, "temperature"), "a file alone"),
    "no history": ({"loads": [{"temperature": 1.0, "history": "none"}]}, ("loads", 0, "history"), "'none'"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_temperature_is_told_with_its_place(what):
    changes, path, words = WRONG[what]
    with pytest.raises(InputError) as caught:
        build_scene(config_from(bar(**changes)))
    assert caught.value.problems[0].path == path and words in str(caught.value.problems[0]) and caught.value.problems[0].cure


@pytest.mark.parametrize("content, words", [
    ("0 0 0", "3 columns"), ("0 0 0 warm", "warm.csv:1: field 4 is no number"), ("0 0 0 1", "no row for"),
    ("0 0 0 nan", "warm.csv:1: a number that is not finite"),
    ("", "no numbers"), ("# x y z T", "no numbers"), ("0;0.5;0;20,5", "decimal points"),
    ("0 0 0 1e999", "warm.csv:1: a number that is not finite"),
    (None, "no file")])
def test_what_is_wrong_with_a_file_of_temperatures_is_told_with_its_line(content, words, tmp_path):
    if content is not None:
        (tmp_path / "warm.csv").write_text(content)
    (tmp_path / "bar.yaml").write_text("""name: bar
mesh: {box: {size: [1, 1, 2], cells: [2, 2, 3]}}
subdomains: {slices: {axis: z, count: 2}}
materials: [{young: 200e3, poisson: 0.3, expansion: 1.0e-5}]
boundary: [{on: zmin, displacement: [0, 0, 0]}]
loads:
  - temperature: {file: warm.csv}
""")
    with pytest.raises(InputError) as caught:
        loaded = load_config(tmp_path / "bar.yaml")
        try:
            build_scene(loaded.config)
        except InputError as error:
            raise InputError(loaded.source.located(error.problems)) from None
    problem = caught.value.problems[0]
    assert problem.line == 7 and words in str(problem) and problem.expected and problem.cure
