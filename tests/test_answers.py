"""Probes, extremes, reactions and resultants against closed forms and equilibrium."""

import csv

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS
from yaml_case import call

from orchestrator.config.load import config_from
from orchestrator.results.extremes import extremes
from orchestrator.results.summary.lines import summary_rows
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.quadratic import choose_element

EXACT = 1e-9  # of quantities of order 1: what iterations to 1e-11 leave of them
FORCE, MOMENT, LENGTH, YOUNG = 3.0, 2.0, 4.0, 1000.0
PROBES = [
    {"name": "fibre", "at": [2.3, 0.2, 0.9], "quantity": "stress"}, {"name": "tip", "at": [LENGTH, 0.5, 0.5]},
    {"name": "clamp", "on": "xmin", "quantity": "resultant"},
    {"name": "end", "on": {"plane": "x", "at": LENGTH}, "quantity": "resultant", "about": [0, 0, 0]},
    {"name": "free", "on": "zmax", "quantity": "resultant"}, {"name": "side", "on": "ymin", "quantity": "max", "of": "stress"},
    {"on": "xmax"}]


def bar(**changes) -> dict:
    """A bar, ν = 0, pulled by a force at load step 1; at 2 bent by a moment about y too, about the origin."""
    spread = {"on": "xmax", "history": "last"}
    return {
        "name": "bar", "mesh": {"box": {"size": [LENGTH, 1, 1], "cells": [4, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": YOUNG, "poisson": 0.0}], "histories": {"all": [1.0, 1.0], "last": [0.0, 1.0]},
        "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [FORCE, 0, 0], "history": "all"},
                     spread | {"resultant": {"moment": [0, MOMENT, 0]}}],
        "blackbox": IN_PROCESS, "method": {"tolerance": {"error": 2e-11}}, "output": {"probes": PROBES}} | changes


def close(found, expected, tolerance=EXACT) -> bool:
    return bool(np.abs(np.asarray(found, float) - expected).max() <= tolerance)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_tension_and_bending_of_a_bar(element, tmp_path):
    """σ = F/A + M z/I, u = F x/EA, w = −M x²/2EI; forces and moments everywhere in equilibrium; and so in the files."""
    at_the_end = [LENGTH, 0.5, 0.5] if element == "P1" else [0, 0, 0]
    found = solve(config_from(bar(blackbox=IN_PROCESS | {"element": element}, output={"probes": PROBES, "moments_about": at_the_end})))
    summary = found.summary
    told = {probe["name"]: probe for probe in summary["probes"]}
    steps = [0, 1] if element == "P2" else [0]  # four-node tets cannot bend
    sigma = np.array([FORCE, FORCE + MOMENT * 0.4 * 12])
    for step in steps:
        values = {name: {key: value[step] for key, value in probe["values"].items()} for name, probe in told.items()}
        fibre, tip = values["fibre"], values["tip"]
        for key in ("sxx", "von_mises", "s1"):
            assert close(fibre[key], sigma[step])
        assert close([fibre[key] for key in ("syy", "szz", "sxy", "syz", "sxz", "s2", "s3")], 0.0)
        sag = -step * MOMENT * 12 * LENGTH**2 / 2 / YOUNG
        assert close([tip["ux"], tip["uy"], tip["uz"]], [FORCE * LENGTH / YOUNG, 0, sag])
        assert close([values["probe_7"][key] for key in ("ux", "uz")], [FORCE * LENGTH / YOUNG, sag])
        top = FORCE + step * MOMENT * 6
        assert close(values["side"]["sxx"], top) and (not step or close(told["side"]["at"]["sxx"][step][2], 1.0))
    for name, about in (("clamp", [0, 0.5, 0.5]), ("end", [0, 0, 0])):
        sign = -1 if name == "clamp" else 1
        moments = [np.cross([0, 0.5, 0.5], [FORCE, 0, 0]) * (name == "end") + [0, step * MOMENT, 0] for step in (0, 1)]
        wrench = np.array(list(told[name]["values"].values())).T
        assert close(wrench, sign * np.array([[FORCE, 0, 0, *moment] for moment in moments]), 1e-10 * 10)
    assert close(list(told["free"]["values"].values()), 0.0, 1e-9)

    reactions, about = np.array(summary["reactions"]), summary["reaction_moments"]
    moments = np.array(about["moments"])
    assert close(reactions.sum(axis=0), 0.0, 1e-9) and close(moments.sum(axis=0), 0.0, 1e-9)
    assert close(moments[0, 1], -np.cross(np.array([0, 0.5, 0.5]) - at_the_end, [FORCE, 0, 0]) - [0, MOMENT, 0])
    assert summary["reaction_names"] == ["xmin", "xmax", "xmax"]
    table = found.resultants
    assert close(table.force, [[[FORCE, 0, 0]]] * 2) and close(table.moment[:, 0], [[0, 0, 0], [0, MOMENT, 0]])
    assert close(table.pressure_centre[:, 0], [[2, 0.5, 0.5], [2, 0.5, 0.5 + MOMENT / FORCE]])
    if element == "P2":
        peak, farthest = summary["peak_stress"], summary["peak_displacement"]
        assert close(peak["value"], FORCE + MOMENT * 6) and close(peak["at"][2], 1.0) and peak["load_step"] == 2
        assert close(farthest["at"][0], LENGTH) and farthest["part"] == "box"

    found.write(tmp_path)
    rows = {name: list(csv.DictReader(open(tmp_path / f"{name}.csv"))) for name in ("probes", "extremes", "interfaces")}
    assert [float(row["tip.ux"]) for row in rows["probes"]] == told["tip"]["values"]["ux"]
    assert [row["load_step"] for row in rows["probes"]] == ["1", "2"]
    most = max((row for row in rows["extremes"] if row["quantity"] == "von_mises"), key=lambda row: float(row["value"]))
    assert float(most["value"]) == pytest.approx(summary["peak_stress"]["value"], rel=1e-8)
    assert close([float(row["fx"]) for row in rows["interfaces"]], FORCE) and rows["interfaces"][0]["law"] == "perfect"


@pytest.mark.parametrize("element, law", [("P1", {"law": "contact", "friction": 0.5}), ("P2", {"law": "perfect"})])
def test_resultants_are_in_equilibrium_where_meshes_do_not_match(element, law):
    """Force and moment of the interface, of the support, and of probes on either side: one and the same."""
    found = solve(config_from({
        "name": "blocks", "subdomains": "groups", "materials": [{"young": 100.0, "poisson": 0.3, "expansion": 1e-3}], "interfaces": [law],
        "parts": [boxed("base", [1, 1, 0.5], [2, 2, 1]), boxed("top", [1, 1, 0.5], [3, 3, 1], [0, 0, 0.5])],
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]},
                     {"on": "top/zmax", "resultant": {"force": [0.1, 0, -2], "moment": [0.05, 0.1, 0.02]}}],
        "loads": [{"on": "base", "temperature": 5.0}], "blackbox": IN_PROCESS | {"element": element},
        "method": {"tolerance": {"law" if law["law"] == "contact" else "error": 1e-9}},
        "output": {"probes": [{"on": name, "part": name.split("/")[0], "quantity": "resultant", "about": [0, 0, 0]}
                              for name in ("top/zmin", "base/zmin", "base/xmin")]}}))
    table = found.resultants
    side = 1 if found.scene.subdomains[found.scene.interfaces[0].subdomains[0]].name == "base" else -1
    carried = np.concatenate([table.force[0, 0], table.moment[0, 0] + np.cross(table.centre[0], table.force[0, 0])])
    support = np.concatenate([found.summary["reactions"][0][0], found.summary["reaction_moments"]["moments"][0][0]])
    on_top, below, free = (np.array(list(probe["values"].values()))[:, 0] for probe in found.summary["probes"])
    assert close(support[:3], [-0.1, 0, 2], 1e-10)
    assert close(-side * carried, support, 1e-10) and close(on_top, support, 1e-10) and close(below, support, 1e-10)
    assert close(free, 0.0, 1e-10)


def test_probes_of_bodies_that_nothing_holds_are_told():
    """Lifted off at the second load step: its displacement means nothing there, that of the other body does."""
    block = {"size": [1, 1, 1], "cells": [1, 1, 1]}
    found = solve(config_from({
        "name": "lifted", "subdomains": "groups", "materials": [{"young": 100.0, "poisson": 0.3}], "histories": {"h": [-1, 1]},
        "parts": [boxed("base", **block), boxed("top", **block, at=[0, 0, 1]), boxed("lid", **block, at=[0, 0, 2])],
        "interfaces": [{"law": "contact", "friction": 0.5}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": "lid/zmax", "displacement": [0, 0, 0.01], "history": "h"}],
        "output": {"probes": [{"name": "above", "at": [0.5, 0.5, 1.5]}, {"name": "low", "at": [0.5, 0.5, 0.5]},
                              {"name": "seat", "on": "top/zmax", "quantity": "mean"}, {"on": "top/zmax", "quantity": "resultant"}]}})).summary
    assert found["detached"] == [[], ["top"]]
    told = [text for text in found["warnings"] if "mean nothing there" in text]
    assert len(told) == 2 and all(f"'{name}' tells displacements of top, which nothing holds at load step 2" in text
                                  for name, text in zip(("above", "seat"), told))


def test_friction_turns_work_into_heat():
    """A block is pressed by N, pushed over its base by d: D = μ N d; the interface carries N, μ N."""
    press, push, slip = 0.02, 0.05, 0.3
    made = config_from({
        "name": "block", "subdomains": "groups", "materials": [{"young": 100.0, "poisson": 0.0}],
        "parts": [boxed("base", [1, 1, 0.5], [2, 2, 1]), boxed("top", [1, 1, 0.5], [3, 3, 1], [0, 0, 0.5])],
        "interfaces": [{"law": "contact", "friction": slip}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]},
                     {"on": "top/zmax", "displacement": [[0, 0, -press], [push, 0, -press], [2 * push, 0, -press]]}],
        "method": {"tolerance": {"error": 1e-9}}, "output": {"probes": [{"on": "top/zmin", "quantity": "resultant"}]}})
    found = solve(made)
    table, normal, resultants = found.met, 100.0 * press, found.resultants
    held = np.array(found.summary["reactions"])[0]
    side = 1 if found.scene.subdomains[found.scene.interfaces[0].subdomains[0]].name == "base" else -1
    assert close(resultants.force[:, 0], -side * held, 1e-7) and close(resultants.force[:, 0, 2], -side * normal, 1e-6)
    assert close(np.abs(resultants.force[2, 0, 0]), slip * normal, 1e-6)
    pressure, = table.pressure
    assert (pressure[1:] >= normal).all() and close(pressure[0], found.interfaces.pressure[0].max())
    on_top = np.array([found.summary["probes"][0]["values"][key] for key in ("fx", "fy", "fz")]).T
    assert close(on_top, held, 1e-7)
    # the second push slides the block as a whole, but for what its tipping has left to be sheared
    assert table.dissipation[0, 2] - table.dissipation[0, 1] == pytest.approx(slip * normal * push, rel=1e-4)
    assert table.work[0, 2] - table.work[0, 1] == pytest.approx(slip * normal * push, rel=1e-4)


GOOD = """
name: pair
parts:
  - {name: low, mesh: {box: {size: [1, 1, 1], cells: [1, 1, 1]}}}
  - {name: top, mesh: {box: {size: [1, 1, 1], cells: [1, 1, 1]}}, move: {translate: [0, 0, 1]}}
subdomains: groups
materials: [{young: 1, poisson: 0.3}]
boundary: [{on: low/zmin, displacement: [0, 0, 0]}]
output:
"""
BAD = [("probes: [{at: [5, 0, 0]}]", "outside the body"), ("probes: [{at: [0.5, 0.5, 1]}]", "add part: low"),
       ("probes: [{at: [0.5, 0.5, 1], part: midle}]", "no volume and no body"), ("probes: [{at: [0, 0]}]", "at least 3"),
       ("probes: [{on: low/zmx}]", "did you mean low/zmax"), ("probes: [{on: low/zmax, part: top}]", "has none of these faces"),
       ("probes: [{at: [0, 0, 0], on: xmin}]", "unknown key 'on'"),
       ("probes: [{on: low/zmax, quantity: sum}]", "mean, max, min, resultant"),
       ("probes: [{on: low/zmax, quantity: resultant, of: stress}]", "beside a mean or an extreme only"),
       ("probes: [{on: low/zmax, about: [0, 0, 0]}]", "beside a resultant only"), ("probes: [{quantity: mean}]", "no on"),
       ("probes: [{name: a, at: [0, 0, 0]}, {name: a, at: [1, 0, 0]}]", "a second probe called 'a'"),
       ("figures: nice", "true or false"), ("moments_about: origin", "a list"), ("units: {length: mm}", "no force"),
       ("units: {length: mm, force: kg m/s2}", "kg m/s2")]


@pytest.mark.parametrize("line, words", BAD, ids=[line for line, _ in BAD])
def test_bad_input_is_told(tmp_path, line, words):
    path = tmp_path / "pair.yaml"
    path.write_text(GOOD + f"  {line}\n")
    done = call("check", path)
    said = done.stderr
    assert done.exit_code == 2 and words in said and "pair.yaml:10" in said and "found:" in said and "expected:" in said, said


def test_points_where_parts_meet_take_a_word(tmp_path):
    path = tmp_path / "pair.yaml"
    path.write_text(GOOD + "  probes: [{at: [0.5, 0.5, 1], part: top}, {on: top/zmin, part: top, of: stress}]\n")
    done = call("check", path)
    assert done.exit_code == 0, done.stderr


def test_the_element_is_chosen_and_says_why():
    """Bending, ν, size: each in words; what was chosen is what is solved, to the last bit."""
    def chosen(size=(4, 1, 1), cells=(4, 2, 2), poisson=0.0):
        changes = {"mesh": {"box": {"size": list(size), "cells": list(cells)}}, "materials": [{"young": YOUNG, "poisson": poisson}],
                   "output": {}}
        return build_scene(config_from(bar(blackbox=IN_PROCESS | {"element": "auto"}, **changes)))

    thin, soft, thick = chosen(), chosen(poisson=0.49), chosen((1, 1, 1), (12, 12, 12))
    assert "stiff in bending" in str(thin.element) and "lock" in str(soft.element) and "more accuracy" in str(thick.element)
    assert all(scene.mesh.cells.shape[1] == 10 for scene in (thin, soft, thick))
    large, both = choose_element(1_600_000, 0.3), choose_element(1_600_000, 0.49)
    assert str(large).startswith("P1: ten-node tets would have") and "across a part" in str(large)
    assert both.element == "P1" and "element: P2 is better" in str(both)
    one, other = (solve(config_from(bar(blackbox=IN_PROCESS | {"element": name}, output={}))) for name in ("auto", "P2"))
    assert (one.displacement == other.displacement).all() and one.summary["element"].startswith("P2: ") and other.summary["element"] is None
    assert dict(summary_rows(one.summary))["element"] == one.summary["element"]
