"""What pictures of surfaces are made of: faces, lines, values, colour limits, a camera."""

import re
from dataclasses import replace

import numpy as np
import pytest
import results_case as case

from orchestrator.results.figures import surface
from orchestrator.results.figures.exaggeration import exaggeration
from orchestrator.results.figures.pictures import deformed, spread
from orchestrator.results.figures.view import colour_limits
from orchestrator.scene.mesh.geometry import area_vectors


def test_surface_of_a_box():
    mesh = case.box_mesh((6, 2, 2))
    faces, cell = surface.outer_faces(mesh.nodes, mesh.cells)
    assert len(faces) == 2 * (2 * 4 + 4 * 12)
    assert (mesh.cells[cell][:, None] == faces[:, :, None]).any(axis=2).all()
    outward = mesh.nodes[faces].mean(axis=1) - mesh.nodes[mesh.cells[cell]].mean(axis=1)
    assert (np.einsum("ij,ij->i", outward, area_vectors(mesh.nodes, faces)) > 0).all()
    assert np.linalg.norm(area_vectors(mesh.nodes, faces), axis=1).sum() == pytest.approx(2 * (3 + 3 + 1))


def test_lines_of_a_box():
    mesh = case.box_mesh((6, 2, 2))
    faces, cell = surface.outer_faces(mesh.nodes, mesh.cells)
    sharp = surface.edges(mesh.nodes, faces)
    assert len(sharp) == 4 * (6 + 2 + 2)
    length = np.linalg.norm(np.diff(mesh.nodes[sharp], axis=1), axis=2).sum()
    assert length == pytest.approx(4 * (3 + 1 + 1))
    parted = surface.edges(mesh.nodes, faces, case.slices(mesh)[cell])
    middles = mesh.nodes[parted].mean(axis=1)
    between = np.isin(middles[:, 0], [1.0, 2.0])
    assert between.sum() == 2 * 4 * 2 and len(parted) == len(sharp) + between.sum(), "two rings of edges, each once"
    assert len(surface.edges(mesh.nodes, faces, sharp=180.0)) == 0, "no rim"
    rim = surface.edges(mesh.nodes, faces[mesh.nodes[faces, 0].max(axis=1) == 0], sharp=180.0)
    assert len(rim) == 8 and (mesh.nodes[rim, 0] == 0).all()


def test_edges_of_the_bounding_box():
    ends = surface.box_edges(np.array([[0.0, 0, 0], [1, 2, 3], [0.5, 1, 1]]))
    assert sorted(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)) == [1] * 4 + [2] * 4 + [3] * 4


def test_view_of_the_step_with_the_largest_displacement():
    fields = case.fields()
    sheet = deformed(fields)
    view, = sheet.views
    assert sheet.headings == ["load step 2 of 2"]
    size = np.linalg.norm(np.ptp(fields.nodes, axis=0))
    factor = float(re.search(r"× ([\d.e+]+)", sheet.caption)[1])
    largest = np.linalg.norm(fields.displacement[-1], axis=1).max()
    assert factor * largest / size == pytest.approx(0.1, rel=0.05)
    low, high = view.camera.project(view.points).min(axis=0), view.camera.project(view.points).max(axis=0)
    assert (2 * np.maximum(high, -low)[:2] <= [view.camera.width, view.camera.height]).all()
    moved = fields.nodes + factor * fields.displacement[1]
    assert {tuple(p) for p in view.points.round(9)} <= {tuple(p) for p in moved.round(9)}


def test_values_are_those_of_the_nodes():
    """Cut into two materials of different stress: none is smeared over the border."""
    mesh = case.box_mesh()
    lame, half = case.lame(mesh), case.slices(mesh, 2)
    lame[half == 1] *= 3
    stretched = type(case.fields())(mesh.nodes, mesh.cells, case.slices(mesh), lame, 1e-3 * mesh.nodes[None] * [1, 0, 0])
    view, = deformed(stretched).views
    middle = mesh.nodes[:, 0].max() / 2 + 0.05
    left, right = (view.values[view.triangles[(view.points[view.triangles, 0].mean(axis=1) < middle) == side]] for side in (1, 0))
    np.testing.assert_allclose(right, 3 * left.max(), rtol=1e-9)
    assert np.ptp(left) < 1e-9 * left.max()


def test_view_at_rest():
    fields = case.fields()
    sheet = deformed(type(fields)(fields.nodes, fields.cells, fields.subdomain, fields.lame, 0 * fields.displacement))
    low, high = sheet.views[0].limits
    assert np.isfinite([low, high]).all() and low < high and "drawn × 1 " in sheet.caption


def test_limits_leave_out_what_a_corner_stretches():
    values = np.append(np.linspace(1, 2, 1000), 1e6)
    (low, high), extremes = colour_limits(values)
    assert low == 1 and 1.99 < high < 2.01 and extremes == (1, 1e6)
    assert colour_limits(np.linspace(1, 2, 1000)) == ((1, 2), (1, 2))
    assert colour_limits(np.full(9, 7.0)) == ((0, 14), (7, 7))
    assert colour_limits(np.array([np.nan, 1.0, 2.0])) == ((1, 2), (1, 2)) and colour_limits(np.full(3, np.nan))[0] == (0, 1)
    # a fiftieth of the surface carries a hundred times the rest: the scale is the rest's
    heavy = np.concatenate([np.linspace(0, 1, 980), np.linspace(50, 100, 20)])
    assert colour_limits(heavy)[0][1] < 2 and colour_limits(heavy)[1] == (0, 100)
    assert colour_limits(np.r_[np.linspace(0, 1, 100), np.linspace(50, 99, 100)], np.r_[np.ones(100), np.full(100, 1e-3)])[0][1] < 2


def test_bodies_apart_at_every_step():
    fields = case.opened()
    grid = deformed(fields)
    assert [view.limits for view in grid.views] == 2 * [grid.views[0].limits]
    last = grid.views[1]
    parted = np.unique(last.points.round(9), axis=0)
    assert len(parted) == len(last.points) == len(np.unique(surface.outer_faces(*[fields.nodes, fields.cells])[0])) + 10, \
        "8 nodes of the rim and the one inside are there twice, the one inside is now outside"
    ends = last.lines.reshape(-1, 3).round(9)
    assert {tuple(point) for point in ends} <= {tuple(point) for point in parted}
    assert len(last.lines) == 2 * 4 * (3 + 2 + 2), "each body has edges of its own"
    assert np.linalg.norm(np.diff(last.lines, axis=1), axis=2).max() < 0.6, "and none leads to the other body"
    gap = fields.interfaces.gap[1].max() * exaggeration(fields, [0, 1])
    assert gap > 0.02 * np.linalg.norm(np.ptp(fields.nodes, axis=0))


def test_no_body_is_distorted_or_sunk_by_being_drawn_larger():
    """A small part that is stretched, and faces that touch though a prescribed gap moves them apart, limit the factor."""
    fields = case.fields()
    size, ends = np.linalg.norm(np.ptp(fields.nodes, axis=0)), np.array([1.0, 0, 0])
    free = exaggeration(fields, [1])
    stretched = replace(fields, displacement=np.where(fields.nodes[:, :1] > 2.9, 0.2, 0.0) * ends + 0 * fields.displacement)
    assert exaggeration(stretched, [1]) * 0.2 <= 0.2 * np.linalg.norm([1, 1, 1]) < 0.1 * size * 1.05 and free > 0
    opened = case.opened({1: [2] * 9})
    parted = exaggeration(opened, [0, 1]) * opened.interfaces.gap[1].max()
    assert 0.009 * size < parted <= 0.0101 * size, "they slip: what is drawn between them is not there"
    assert f"touch drawn up to {parted:.3g} apart" in deformed(opened).caption and "apart" not in deformed(case.opened()).caption


def test_the_most_loaded_step_and_the_last_are_drawn():
    assert spread(4, 3, 1) == [0, 1, 3] and spread(4, 3, 2) == [0, 2, 3]
    assert spread(9, 6, 4)[-1] == 8 and 4 in spread(9, 6, 4) and len(spread(9, 6, 4)) == 6 and spread(2, 6, 1) == [0, 1]
