"""Pictures of surfaces: what one sees, whoever draws them, and the process that does."""

import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import results_case as case
from matplotlib.colors import ListedColormap, to_rgb
from PIL import Image
from pictures import pixels, share
from processes import gone

from orchestrator.errors import InputError
from orchestrator.scene.elasticity import von_mises
from orchestrator.results.figures import artist as artists
from orchestrator.results.figures import surface
from orchestrator.results.figures.artist import Artist, CannotDraw, drawn
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.figures.exaggeration import exaggeration
from orchestrator.results.figures.flat import laid_flat
from orchestrator.results.figures.pictures import PALETTE, codes, deformed, interfaces
from orchestrator.results.figures.view import Camera, DPI, Look, View
from orchestrator.results.figures.sheet import compose
from orchestrator.results.figures.surface import skin
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.mesh.geometry import area_vectors


# one process opens the window in which all draw
in_a_window = pytest.mark.xdist_group("window")


@pytest.fixture(scope="session")  # a process that leaves the module in between would begin anew
def draw():
    """From a view to its picture (rows, columns, 3)."""
    program = "from orchestrator.results.figures.figures import warm_up; warm_up()"
    if subprocess.run([sys.executable, "-c", program], capture_output=True).returncode:  # VTK would crash here too
        pytest.skip("VTK can draw neither with X nor with EGL on this machine")
    from orchestrator.results.figures.sheet import draw

    return draw


def seen(view, chosen=slice(None)):
    """The share of the picture that some triangles fill, none of which hides another."""
    flat = view.camera.project(view.points)
    flat[:, 2] = 0
    area = np.linalg.norm(area_vectors(flat, view.triangles[chosen]), axis=1).sum()
    return area / (view.camera.width * view.camera.height)


# --- what one sees ----------------------------------------------------------------------------------------


@in_a_window
def test_colours_fill_what_they_should(draw):
    """A flat patch of three kinds, seen from the front: each has its share of the pixels, in exactly its colour."""
    colours, x = ["#d0d0d0", "#0072B2", "#E69F00"], np.array([0.0, 1, 3, 6])
    corners = np.array([[[a, 0, 0], [b, 0, 0], [b, 0, 2], [a, 0, 2]] for a, b in zip(x, x[1:])])
    triangles = (4 * np.arange(3)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    camera = Camera(np.array([3.0, 0, 1]), np.array([0.0, -1, 0]), np.array([1.0, 0, 0]), np.array([0.0, 0, 1]), 8.0, 4.0)
    view = View(corners.reshape(-1, 3), triangles, np.repeat([0.0, 1, 2], 4), camera, (-0.5, 2.5),
                palette=ListedColormap(colours), shaded=False)
    picture = draw(view, 3.0)
    assert picture.shape == (240, 480, 3)
    for colour, width in zip(colours, np.diff(x)):
        assert share(picture, colour) == pytest.approx(2 * width / 32, abs=0.006)
    assert share(picture, "white") == pytest.approx(1 - 12 / 32, abs=0.01)
    for column, colour in zip((90, 180, 330), colours):  # from left to right: 60 pixels a unit after one of margin
        assert np.abs(picture[120, column] - 255 * np.array(to_rgb(colour))).max() < 2


@pytest.mark.long
@in_a_window
def test_a_body_fills_its_outline_and_its_lines_are_dark(draw):
    """The bending box from its own camera: shape, colours of the scale, subdomain borders; the same twice."""
    view = deformed(case.fields()).views[0]
    picture = draw(view)
    assert picture.shape == (*view.pixels()[::-1], 3)
    white = share(picture, "white", within=2)
    normal = area_vectors(view.camera.project(view.points), view.triangles)
    assert 1 - white == pytest.approx(seen(view, normal[:, 2] > 0), abs=0.02)
    hue = picture.astype(float)
    coloured = np.ptp(hue, axis=2) > 40
    assert len(np.unique(hue[coloured].round(-1), axis=0)) > 20
    bare = draw(View(**{**vars(view), "lines": view.lines[:0], "outline": view.outline[:0]}))
    darker = bare.sum(axis=2).astype(int) - picture.sum(axis=2)
    on_lines = view.camera.project(view.lines.mean(axis=1))[:, :2] / [view.camera.width, -view.camera.height] + 0.5
    columns, rows = (on_lines * view.pixels()).astype(int).T
    near = np.array([darker[r - 2:r + 3, c - 2:c + 3].max() for r, c in zip(rows, columns)])
    assert (near > 60).mean() > 0.4, "the others are at the back"
    np.testing.assert_array_equal(draw(view), picture)


@pytest.mark.long
@in_a_window
def test_the_deformed_figure_explains_itself(draw):
    sheet = deformed(case.fields())
    view, figure = sheet.views[0], compose(sheet, "made_up")
    scale, = figure.axes
    assert {text.get_text() for text in figure.texts} == {"made_up", "load step 2 of 2", sheet.caption}
    assert {"displacements drawn", "largest displacement", "largest von Mises stress"} <= {
        re.sub(r" [×\d].*", "", told) for told in sheet.caption.split("   ·   ")}
    assert scale.get_xlabel() == "von Mises stress" and scale.get_xlim() == pytest.approx(view.limits)
    figure.canvas.draw()
    shown, picture = np.asarray(figure.canvas.buffer_rgba())[:, :, :3], draw(view)
    rows = [row for row in range(shown.shape[0] - len(picture)) if np.abs(shown[row:row + len(picture)].astype(int) - picture).mean() < 0.5]
    assert rows, "dot for dot, but for the peak's label"


@in_a_window
def test_status_and_pressure_of_interfaces(draw):
    """Each node's status fills its share of the picture, the pressure at the nodes is what the scale ends at."""
    fields = case.opened({1: [0, 0, 0, 0, 1, 2, 2, 2, 2]})
    i, grid = fields.interfaces, interfaces(fields)
    assert grid.headings == [f"load step {step} of 2" for step in (1, 1, 2, 2)] and len(grid.views) == 4
    names = grid.scales[0].names
    assert names == ["open", "stick", "slip"] and grid.scales[1].label == "pressure" and "largest pressure 5" in grid.caption
    status, pressure = grid.views[2], grid.views[3]
    np.testing.assert_allclose(pressure.values, i.pressure[1][i.triangles].ravel())
    assert pressure.limits == pressure.extremes == pytest.approx((0, 5))
    picture = draw(View(**{**vars(status), "lines": status.lines[:0]}))
    area, drawn = (np.linalg.norm(area_vectors(*mesh), axis=1) for mesh in (
        (fields.nodes[i.nodes], i.triangles), (status.points, status.triangles)))
    for place, name in enumerate(names):
        own, mine = i.kind_names == name, status.values[::3] == place
        assert share(picture, i.kind_colours[own][0]) == pytest.approx(seen(status, mine), abs=0.01)
        third = area @ (i.status[1][i.triangles] == i.kinds[own][0]).mean(axis=1)
        assert drawn[mine].sum() / drawn.sum() == pytest.approx(third / area.sum()) and third > 0

    figure = compose(grid, "made_up")
    assert [t.get_text() for t in figure.axes[0].get_xticklabels()] == names
    assert {*grid.headings, "made_up", grid.caption, "a - b\n1 × 1"} == {t.get_text() for t in figure.texts}


def test_round_faces_are_unrolled_and_none_covers_another():
    """A quarter of a cylinder beside a square: true lengths in the names, both upright, neither over the other."""
    i, turn = case.opened().interfaces, np.linspace(0, np.pi / 2, 9)
    round_, z = np.stack(np.meshgrid(turn, [0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 2).T
    normal = np.column_stack([np.cos(round_), np.sin(round_), 0 * z])
    left = 2 * np.arange(8)
    triangles = np.concatenate([np.column_stack([left, left + 2, left + 3]), np.column_stack([left, left + 3, left + 1])])
    square = np.array([[0.0, 9, 0], [0, 10, 0], [0, 10, 1], [0, 9, 1]])
    nodes = np.concatenate([2 * normal * [1, 1, 0] + z[:, None] * [0, 0, 1], square])
    both = replace(i, names=np.array(["a", "b"]), nodes=np.arange(22), offsets=np.array([0, 18, 22]), owner=np.r_[np.zeros(16, int), 1, 1],
                   triangles=np.concatenate([triangles, [[18, 19, 20], [18, 20, 21]]]),
                   normal=np.concatenate([normal, np.tile([1.0, 0, 0], (4, 1))]))
    flat = laid_flat(nodes, both, " mm")
    assert [name for _, name in flat.names] == ["a\n3.14 × 1 mm, unrolled", "b\n1 × 1 mm"]
    one, other = (flat.corners[both.owner == k].reshape(-1, 3) for k in (0, 1))
    (wide, high, _), (width, height, _) = np.ptp(one, axis=0), np.ptp(other, axis=0)
    assert wide == pytest.approx(np.pi * high) and width == pytest.approx(height)
    apart = (one.min(axis=0) > other.max(axis=0)) | (other.min(axis=0) > one.max(axis=0))
    assert apart[:2].any() and flat.frame.min() == 0 and (flat.corners[..., :2] <= flat.frame.max(axis=0)[:2] + 1e-9).all()
    assert len(flat.rims) == 16 + 2 + 4


@pytest.mark.long
@in_a_window
def test_a_cut_shows_the_inside_and_parts_are_chosen(draw):
    """What is in front of the plane goes; the face of the cut has the stress of the inside; the peak is pointed at."""
    fields = replace(case.fields(), part=case.slices(case.box_mesh(), 3), parts=("left", "middle", "right"))
    size, middle = np.ptp(fields.nodes, axis=0), fields.nodes[:, 1].mean()
    for angles, keeps in (((-60.0, 20.0), np.greater_equal), ((60.0, 20.0), np.less_equal)):
        look = Look(cut=(1, middle + 1e-4), angles=angles, units={"length": " mm", "force": " N", "stress": " MPa"})
        seen = skin(fields, [1], look, look.direction)
        assert keeps(seen.points[:, 1] - middle - 1e-4, np.copysign(1e-9, 1 if keeps is np.less_equal else -1)).all()
        flat = np.abs(seen.points[seen.triangles, 1] - middle - 1e-4).max(axis=1) < 1e-9
        area = np.linalg.norm(area_vectors(seen.points, seen.triangles), axis=1)
        x, y, z = np.abs(seen.points[seen.lines].mean(axis=1)[:, :, None] - [0, 1, 2, size[0], middle + 1e-4]).transpose(1, 0, 2) < 1e-9
        on = x[:, :4].any(axis=1) * 1 + y[:, [0, 1, 4]].any(axis=1) + z[:, :2].any(axis=1)
        assert (on >= 2).all(), "lines on edges of the box, of its parts and of the cut alone"
        assert area[flat].sum() == pytest.approx(size[0] * size[2], rel=1e-6)
        values, x = seen.stress[1], seen.points
        inside = fields.nodal.stress(1)
        assert values.max() <= von_mises(inside).max() * (1 + 1e-12) and np.ptp(x[:, 0]) == pytest.approx(size[0])
    sheet = deformed(fields, look)
    assert "cut at y" in sheet.caption and " MPa" in sheet.caption and draw(sheet.views[0]).std() > 5
    alone, = deformed(fields, Look(parts=("left", "r*"))).views
    assert not ((alone.points[:, 0] > 1.1) & (alone.points[:, 0] < 1.9)).any() and len(alone.outline) == 0
    view, = deformed(fields).views
    place, value, visible = view.mark
    nodal = von_mises(fields.nodal.stress(1))
    assert value == nodal.max() and visible in (True, False)
    most = fields.nodal.node[nodal > nodal.max() * (1 - 1e-9)]
    at = fields.nodes[most] + exaggeration(fields, [1]) * fields.displacement[1][most]
    assert np.linalg.norm(at - place, axis=1).min() < 1e-9
    unknown = draw(deformed(replace(fields, believed=fields.part != 1)).views[0])
    assert (np.ptp(unknown.astype(int), axis=2) < 3).mean() > 1.1 * (np.ptp(draw(view).astype(int), axis=2) < 3).mean()


def test_imposed_jumps_are_drawn_apart_from_contact():
    """Bolts' pressure would leave contact's without a colour; zero is on every scale, open faces are grey."""
    fields = case.opened({1: [0, 0, 0, 0, 0, 0, 2, 2, 2]})
    i = fields.interfaces
    assert interfaces(fields, imposed=True) is None
    twice = replace(i.some(np.zeros(2, int)), laws=np.array(["contact", "jump"]), pressure=np.hstack([i.pressure, 1e3 + i.pressure]))
    both = replace(fields, interfaces=twice)
    contact, jumps = interfaces(both), interfaces(both, imposed=True)
    assert contact.views[3].limits[0] == 0 and contact.views[3].limits[1] < 10 and "whose jump is imposed" in jumps.caption
    assert len(jumps.views) == 2 and jumps.views[1].limits[0] < -1e3 and jumps.scales[0].label == "tension"
    grey = np.isnan(contact.views[3].values.reshape(-1, 3)[:, 0])
    assert (grey == (i.status[1][i.triangles] == 0).all(axis=1)).all() and grey.any() and not grey.all()


def test_each_step_has_its_own_scale_on_request_or_one_that_is_given():
    """A step a hundred times as loaded leaves the other dark; what lies beyond a scale that is given is told at its tip."""
    fields = replace(case.opened(), displacement=case.bending(case.box_mesh()) * np.array([0.02, 1])[:, None, None], sides=None)
    for scale, count, same in ((None, 1, True), ("step", 2, False), ((0.0, 50.0), 1, True)):
        sheet = deformed(fields, Look(scale=scale))
        assert len(sheet.scales) == count and (sheet.views[0].limits == sheet.views[1].limits) == same
        assert (sheet.views[0].limits == (0.0, 50.0)) == (scale == (0.0, 50.0)) and sheet.views[1].extremes[1] > 100
    assert sheet.views[0].mark is not None and deformed(fields, Look(steps=(1, 7))).headings == ["load step 2 of 2"]
    assert "load step 1 not drawn" in deformed(fields, Look(steps=(1,))).caption


@pytest.mark.long
@in_a_window
def test_codes_in_colours(draw):
    fields = case.fields()
    used = [{"code": "freefem", "transport": "pipe", "subdomains": [0, 2]}, {"code": "mine", "transport": "file", "subdomains": [1]}]
    assert codes(fields, {"codes": used[:1]}) is None
    sheet = codes(fields, {"codes": used})
    view, = sheet.views
    faces, cell = surface.outer_faces(fields.nodes, fields.cells)
    np.testing.assert_array_equal(view.values.reshape(-1, 3)[:, 0], fields.subdomain[cell] == 1)
    view = replace(view, lines=view.lines[:0], shaded=False)
    picture, front = draw(view), area_vectors(view.camera.project(view.points), view.triangles)[:, 2] > 0
    for k in (0, 1):
        mine = front & (view.values[view.triangles[:, 0]] == k)
        assert share(picture, PALETTE[k]) == pytest.approx(seen(view, mine), abs=0.012)
    figure = compose(sheet, "made_up")
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["freefem (pipe)", "mine (file)"]


# --- who draws --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_another_process_draws(tmp_path, draw):
    """It tells what hinders it, and does not outlive its job."""
    folder, job = ResultsFolder(tmp_path), (case.summary(), case.history(), case.fields())
    names = [path.name for path in drawn(write_figures, folder, *job)]
    assert names == ["convergence.png", "time.png", "deformed.png"]
    picture = draw(deformed(case.fields()).views[0])
    shown = pixels(tmp_path / "figures/deformed.png")
    assert (shown < 250).any(axis=2).sum() > 0.9 * (picture < 250).any(axis=2).sum() and shown.shape[1] == picture.shape[1] == 9 * DPI

    shutil.rmtree(tmp_path / "figures")
    folder.write("figures", "in the way")
    with Artist() as artist, pytest.raises(InputError, match="cannot write figures"):
        artist.begin(write_figures, folder, *job)
        artist.finish()
    assert gone([artist._process.pid])
    with Artist() as idle:
        pass
    assert gone([idle._process.pid])


@pytest.mark.parametrize("how", ["killed", "is no program", "hangs"])
def test_a_process_that_fails_is_noticed(tmp_path, monkeypatch, how):
    """One that hangs has not even read the job, which is more than a pipe takes in."""
    if how == "is no program":
        monkeypatch.setattr(sys, "executable", "/nothing")
    monkeypatch.setattr(artists, "PATIENCE", 0.5 if how == "hangs" else 60.0)
    with Artist() as artist:
        process = artist._process and artist._process.pid
        if how != "is no program":
            os.kill(process, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
        artist.begin(write_figures, ResultsFolder(tmp_path), case.summary(ballast="x" * 10**6), case.history(), case.fields())
        with pytest.raises(CannotDraw, match="was not done" if how == "hangs" else "cannot draw"):
            artist.finish()
    assert (process is None or gone([process])) and not (tmp_path / "figures").exists()
