"""What a run with contact leaves behind: both sides, statuses, resultants, bodies that come loose, warnings."""

import dataclasses
import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import method_case as case
import numpy as np
import pytest

from orchestrator.config.load import load_config
from orchestrator.method.delivery.interface_fields import UNWRITTEN, InterfaceFields
from orchestrator.laws.contact import OPEN, SLIP, STICK
from orchestrator.laws.points import BONDED
from orchestrator.method.delivery.moved import rotations
from orchestrator.results.summary.cautions import cautions
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields
from orchestrator.results.fields.npz import read_npz
from orchestrator.results.figures.charts import tolerance
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.history import read_history
from orchestrator.results.report.report import report
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import summary_rows
from orchestrator.results.summary.summary import STAGES, jsonable, read_summary
from orchestrator.run import run

FRICTION = 0.3
FLOOR = {"on": {"plane": "z", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}
RUNS = {"tolerance": {"law": 1e-8}}


def stack(blocks: int, top: list, between=("*", "*"), friction=FRICTION, **changes):
    """Blocks of 1 × 1 × 1 on top of each other, held below, the top moved."""
    contact = {"between": list(between), "law": "contact", "friction": friction, **changes.pop("law", {})}
    roof = {"on": {"plane": "z", "at": float(blocks)}, "displacement": top}
    return {"mesh": {"box": {"size": [1.0, 1.0, float(blocks)], "cells": [2, 2, 2 * blocks]}},
            "subdomains": {"grid": [1, 1, blocks]}, "boundary": [FLOOR, roof], "interfaces": [contact],
            **case.method(**RUNS), **changes}


PRESS_SHEAR_LIFT = [[0, 0, -2e-3], [5e-3, 0, -2e-3], [0, 0, 4e-3]]


@pytest.fixture(scope="module")
def pressed():
    """Two blocks: pressed, sheared until they slide, lifted off each other."""
    return case.solved(False, **stack(2, PRESS_SHEAR_LIFT))


@pytest.fixture(scope="module")
def loose():
    """Three blocks, the middle one pressed between the others, then left alone."""
    return case.solved(False, **stack(3, [[0, 0, -3e-3], [0, 0, 3e-3]]))


def fields_of(solved) -> Fields:
    return Fields.of(solved.scene, solved.displacement, solved.fields.sides, solved.interfaces)


def test_statuses_agree_with_gaps_pressures_and_friction(pressed):
    i = pressed.interfaces
    assert pressed.converged and (i.steps, len(i.nodes)) == (3, 9)
    small, top = 1e-6 * np.abs(pressed.displacement).max(), i.pressure.max()
    tangential = np.linalg.norm(i.friction_traction, axis=2)
    limit = FRICTION * i.pressure
    assert (i.gap >= -small).all() and (i.pressure >= -1e-6 * top).all()
    assert (np.abs(i.pressure[i.status == OPEN]) <= 1e-6 * top).all()
    assert (np.abs(i.gap[i.status != OPEN]) <= small).all()
    assert (tangential <= limit + 1e-6 * top).all()
    np.testing.assert_allclose(tangential[i.status == SLIP], limit[i.status == SLIP], atol=1e-6 * top)
    assert (i.status[0] == STICK).any() and (i.status[1] == SLIP).all() and (i.status[2] == OPEN).all()
    np.testing.assert_allclose(i.gap[2], 4e-3, rtol=1e-6)
    # the tangential vectors are tangential
    for field in (i.slip, i.friction_traction):
        assert np.abs(np.einsum("tni,ni->tn", field, i.normal)).max() <= 1e-12 * max(np.abs(field).max(), 1)


def test_counts_and_resultants(pressed):
    s, i = pressed.summary, pressed.interfaces
    assert [sum(step) for step in zip(*s["status_counts"].values())] == [9, 9, 9]
    assert s["status_counts"]["open"] == [0, 0, 9] and s["status_counts"]["slip"][1] == 9
    (entry,) = s["interface_resultants"]
    assert entry["subdomains"] == [x.name for x in pressed.scene.subdomains] and entry["law"] == "contact"
    scale = np.abs(entry["resultant"]).max()
    below, above = np.array(s["reactions"])
    # the lower block is side 1: what the upper one does to it goes into the floor
    np.testing.assert_allclose(entry["resultant"], -below, atol=1e-6 * scale)
    np.testing.assert_allclose(entry["resultant"], above, atol=1e-6 * scale)
    traction = -i.pressure[:, :, None] * i.normal + i.friction_traction
    np.testing.assert_allclose((traction * i.area[:, None]).sum(axis=1), np.array(entry["resultant"]), atol=1e-9 * scale)
    assert i.area.sum() == pytest.approx(1.0)


def test_residuals_of_the_laws(pressed):
    r = pressed.summary["residuals"]
    parts = ("interface_residual", "imbalance", "penetration", "tension", "cone", "slip_direction", "body_residual")
    assert r["law_residual"] == max(r[p] for p in parts) <= 1e-8
    assert r["law_residual"] == pytest.approx(pressed.iterated.last.law_residual, rel=1e-12)
    assert jsonable(pressed.summary)["error_bound"] is None


def test_both_sides_and_their_mean(pressed):
    i, f = pressed.interfaces, fields_of(pressed)
    one, two = (f.interface_displacement(side) for side in (0, 1))
    jump = two - one
    np.testing.assert_allclose(np.einsum("tni,ni->tn", jump, i.normal), i.gap - i.initial_gap, atol=1e-15)
    np.testing.assert_allclose(jump - np.einsum("tni,ni->tn", jump, i.normal)[..., None] * i.normal, i.slip, atol=1e-15)
    np.testing.assert_allclose(f.displacement[:, i.nodes], 0.5 * (one + two), atol=1e-15)
    for s, u in zip(pressed.scene.subdomains, pressed.sides):
        inner = ~np.isin(s.nodes, i.nodes)
        np.testing.assert_array_equal(f.displacement[:, s.nodes[inner]], u[:, inner])
    # each body's stress is its own: lifted off, nothing is strained
    assert f.opened.von_mises(2).max() < 1e-5 * f.opened.von_mises(0).max()
    assert f.von_mises(2).max() > f.opened.von_mises(0).max(), "the mean would show stress where there is none"


def test_files_hold_bodies_that_separate(pressed, tmp_path):
    mine = fields_of(pressed)
    write_fields(ResultsFolder(tmp_path), mine)
    sets = ET.parse(tmp_path / "fields/interfaces.pvd").getroot().findall("Collection/DataSet")
    assert [s.get("file") for s in sets] == ["interface_0001.vtu", "interface_0002.vtu", "interface_0003.vtu"]

    body = meshio.read(tmp_path / "fields/step_0003.vtu")
    assert len(body.points) == sum(len(s.nodes) for s in pressed.scene.subdomains)
    subdomain = body.cell_data["subdomain"][0]
    lower, upper = (np.unique(body.cells_dict["tetra"][subdomain == e]) for e in (0, 1))
    assert len(np.intersect1d(lower, upper)) == 0
    where = body.points + body.point_data["displacement"]
    assert where[upper, 2].min() - where[lower, 2].max() == pytest.approx(4e-3, rel=1e-6)

    i = mine.interfaces
    patch = meshio.read(tmp_path / "fields/interface_0002.vtu")
    np.testing.assert_array_equal(patch.points, pressed.scene.mesh.nodes[i.nodes])
    np.testing.assert_array_equal(patch.cells_dict["triangle"], i.triangles)
    for name in ("gap", "slip", "pressure", "friction_traction", "status"):
        np.testing.assert_array_equal(patch.point_data[name], getattr(i, name)[1])
    jump = patch.point_data["displacement_2"] - patch.point_data["displacement_1"]
    np.testing.assert_allclose(jump, i.slip[1] + (i.gap - i.initial_gap)[1][:, None] * i.normal, atol=1e-15)
    assert set(patch.cell_data["interface"][0]) == {0}

    read = read_npz(tmp_path)
    for e, u in enumerate(mine.sides):
        np.testing.assert_array_equal(read.sides[e], u)
        np.testing.assert_array_equal(np.load(tmp_path / "fields.npz")[f"displacement_sides_{e}"], u)
    for field in dataclasses.fields(i):
        if field.name not in UNWRITTEN:
            np.testing.assert_array_equal(getattr(read.interfaces, field.name), getattr(i, field.name))
    with np.load(tmp_path / "fields.npz") as data:
        assert {"interface_nodes", "interface_offsets", "gap", "slip", "pressure", "friction_traction", "status"} \
            <= set(data)


def test_detached_body_is_named(loose):
    names = [s.name for s in loose.scene.subdomains]
    assert loose.summary["detached"] == [[], [names[1]]]
    assert loose.summary["weakly_held"] == [[], []]
    text = dict(summary_rows(loose.summary))["not held"]
    assert text.startswith(names[1]) and "load step 2" in text and "where stabilisation leaves it" in text


def test_frictionless_body_is_weakly_held():
    """Pressed between two plates without friction, the middle block may glide; the others may not."""
    found = case.solved(False, **stack(3, [[0, 0, -3e-3]], friction=0.0))
    assert found.summary["weakly_held"] == [[found.scene.subdomains[1].name]] and found.summary["detached"] == [[]]
    assert "free to move" in dict(summary_rows(found.summary))["not held"]


def test_prescribed_nodes_stay_on_their_places():
    """An interface that runs into a clamp: its prescribed nodes carry nothing and move as prescribed."""
    clamp = {"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}
    found = case.solved(False, **stack(2, [[0, 0, -1e-3]]) | {"boundary": [
        clamp, {"on": {"plane": "z", "at": 2.0}, "traction": [0.0, 0.0, -10.0]}]})
    i = found.interfaces
    held = found.scene.mesh.nodes[i.nodes, 0] == 0
    assert held.sum() == 3 and (i.status[0, held] == BONDED).all() and (i.status[0, ~held] != BONDED).all()
    assert not i.gap[0, held].any() and not i.pressure[0, held].any() and not i.friction_traction[0, held].any()


def test_contact_beside_perfect_interfaces():
    """Sides are continuous where interfaces are perfect; only the others have interface fields."""
    data = stack(4, [[0, 0, -4e-3], [0, 0, 2e-3]], between=("block 0-0-1", "block 0-0-2"))
    found = case.solved(False, **data)
    assert list(found.interfaces.names) == ["block 0-0-1 | block 0-0-2"]
    f = fields_of(found)
    for a, b, apart in ((0, 1, False), (1, 2, True), (2, 3, False)):
        shared = np.intersect1d(*(found.scene.subdomains[e].nodes for e in (a, b)))
        one, two = (found.sides[e][:, np.searchsorted(found.scene.subdomains[e].nodes, shared)] for e in (a, b))
        difference = np.abs(one - two).max()
        assert difference == pytest.approx(2e-3, rel=1e-5) if apart else difference <= 1e-15
    assert found.summary["detached"] == [[], []] and f.opened.displacement.shape[1] == 4 * 27


def test_perfect_runs_have_none_of_it(tmp_path):
    found = case.solved(False)
    assert found.interfaces is None and found.fields.sides is None
    assert not any("interface" in text for text in found.summary["warnings"])
    assert not {"status_counts", "detached", "interface_resultants"} & set(found.summary)
    write_fields(ResultsFolder(tmp_path), fields_of(found))
    assert sorted(p.name for p in (tmp_path / "fields").iterdir()) == ["fields.pvd", "step_0001.vtu"]
    read = read_npz(tmp_path)
    assert read.sides is None and read.interfaces is None and read.opened is read


def test_warnings():
    """High friction, contact inside a part, long slides, large displacement and rotation: each in a sentence."""
    found = case.solved(False, **stack(2, [[0.9, 0, -2e-3]], friction=0.01))
    texts = found.summary["warnings"]
    assert any("inside one part (box)" in t for t in texts) and any("slid by more than an element" in t for t in texts)
    assert any("displaced by more than 10%" in t for t in texts) and not any("friction" in t for t in texts)
    assert "block 0-0-1" in dict(summary_rows(found.summary))["warning"]
    interface = found.scene.interfaces[0]
    interface.law = replace(interface.law, friction=1.5)
    assert any("friction 1.5" in t and "not assured" in t for t in cautions(found.scene, found.sides, found.answers.met))
    points = np.random.default_rng(1).normal(size=(20, 3))
    spin = np.array([[0.0, 0.2, 0.0], [0.01, 0, 0]])
    turned = np.cross(spin[:, None, :], points) + np.array([1.0, 2.0, 3.0])
    assert rotations([points, points], [turned, 0 * turned]) == pytest.approx([0.2, 0], rel=1e-12)
    sides = [np.cross([0.0, 0.2, 0.0], found.scene.mesh.nodes[s.nodes])[None] for s in found.scene.subdomains]
    assert any("rotated by up to 0.2 rad" in t for t in cautions(found.scene, sides))
    names = [s.name for s in found.scene.subdomains]
    assert cautions(found.scene, sides, detached=[names]) == [], "where a detached body is means nothing"


@pytest.mark.long
def test_from_the_configuration_to_the_report(tmp_path, capsys):
    out, path = tmp_path / "out", tmp_path / "stack.yaml"
    data = stack(3, [[0, 0, -3e-3], [0, 0, 3e-3]])
    path.write_text(json.dumps({"name": "stack", "materials": [{"young": 200e3, "poisson": 0.3}],
                                "blackbox": {"workers": 1}, **data}))
    assert run(load_config(path), output=out) == 0
    printed = capsys.readouterr().out
    for part in ("law residual", "not held", "block 0-0-1", "warning", "open"):
        assert part in printed, part
    summary = read_summary(out)
    assert summary["error_bound"] is None and summary["detached"] == [[], ["block 0-0-1"]]
    assert all(face["used"][1] == 0 for face in summary["contact_faces"]), "lifted off, nothing but rounding presses"
    assert len(summary["interface_resultants"]) == 2 and tolerance(summary) == ("law residual", 1e-8)
    timing = summary["timing"]
    assert set(timing) - {"total", "blackbox"} <= set(STAGES), "every stage has a name in plain words"
    assert 0.9 * timing["total"] <= sum(timing.get(stage, 0.0) for stage in STAGES) <= 1.001 * timing["total"]
    assert {p.name for p in (out / "figures").iterdir()} == {"convergence.png", "deformed.png", "interfaces.png", "time.png"}
    assert np.isfinite(read_history(out)["law_residual"]).all()

    again = Solution.read(out)
    assert isinstance(again.fields.interfaces, InterfaceFields)
    text = report(out).read_text()
    for part in ("Interface laws", "| not held | block 0-0-1", "penetration", "tolerance: {law:", "figures/interfaces.png", "inside one part"):
        assert part in text, part


@pytest.mark.long
def test_pictures_without_vtk(loose, tmp_path):
    names = [p.name for p in write_figures(ResultsFolder(tmp_path), jsonable(loose.summary), {}, fields_of(loose))]
    assert names == ["time.png", "deformed.png", "interfaces.png"]
