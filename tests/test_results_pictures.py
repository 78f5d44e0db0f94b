"""Pictures of the structure: what one sees, and the process that draws."""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import results_case as case
from pictures import is_drawn, pixels, share
from processes import gone

from orchestrator.errors import InputError
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.artist import Artist, CannotDraw, drawn
from orchestrator.results.figures.plotting import exaggeration
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.figures.pictures import compose, deformed, draw as draw_view, fitted, interfaces, outer_surface, shares
from orchestrator.results.figures.plotting import RED
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import View
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.sources import bricks

# one process opens the window in which all draw
in_a_window = pytest.mark.xdist_group("window")


@pytest.fixture(scope="session")  # a process that leaves the module in between would begin anew
def draw():
    """From a picture and the place of a load step to what is seen (rows, columns, 3)."""
    program = "from orchestrator.results.figures.figures import warm_up; warm_up()"
    if subprocess.run([sys.executable, "-c", program], capture_output=True).returncode:  # VTK would crash here too
        pytest.skip("VTK can draw neither with X nor with EGL on this machine")
    from orchestrator.results.figures.pictures import draw

    return draw


def every(fields) -> np.ndarray:
    return np.arange(len(fields.cells))


# --- what is drawn ----------------------------------------------------------------------------------------


def test_the_surface_is_the_outer_one_turned_outward_and_parted_by_subdomains():
    fields = case.fields()
    surface = outer_surface(fields, every(fields))
    triangles, nodes = surface.regular_faces, np.asarray(surface.points)
    normal = area_vectors(nodes, triangles)
    assert len(triangles) == 2 * (2 * 4 + 4 * 12) and np.linalg.norm(normal, axis=1).sum() == pytest.approx(2 * (3 + 3 + 1))
    assert (np.einsum("ij,ij->i", normal, nodes[triangles].mean(axis=1) - [1.5, 0.5, 0.5]) > 0).all()
    np.testing.assert_array_equal(nodes, fields.nodes[fields.nodal.split[0][surface["place"]]])
    lines = deformed(replace(fields, displacement=0 * fields.displacement), View({})).lines[0]
    on_border = np.isin(np.asarray(lines.points)[:, 0].round(9), [1.0, 2.0])
    on_edges = (np.isin(np.asarray(lines.points).round(9), [0.0, 1.0, 3.0]) & [True, True, True]).sum(axis=1) >= 2
    assert on_border.any() and (on_border | on_edges).all()


def test_colours_go_from_zero_to_the_peak_and_shapes_are_those_told():
    fields = case.fields()
    picture = deformed(fields, View({}))
    shape, = picture.surfaces
    values = fields.nodal.von_mises(1)
    assert picture.limits == (0.0, values.max()) and picture.headings == ["load step 2 of 2"]
    place = shape["place"]
    np.testing.assert_array_equal(shape["colour"], values[place])
    factor = exaggeration(fields, every(fields), [1])
    node = fields.nodal.split[0][place]
    np.testing.assert_allclose(shape.points, fields.nodes[node] + factor * fields.displacement[1][node])
    assert f"displacements × {factor:g}" in picture.told and any(text.startswith("peak von Mises stress") for text in picture.told)
    asked = deformed(fields, View({"peak_stress": {"load_step": 1}}))
    assert asked.headings == ["load step 1 of 2"] and asked.limits[1] == fields.nodal.von_mises(0).max()


def test_a_peak_beyond_the_rest_has_a_colour_of_its_own():
    """The scale holds 99 % of what is seen: a corner of stiffer matter, stressed a thousand times, leaves the rest its colours."""
    mesh = bricks(np.array([8.0, 8.0, 8.0]), np.array([20, 20, 20]), "cube")
    stretched = 1e-3 * mesh.nodes[None] * [1.0, 0.0, 0.0]
    far = np.linalg.norm(mesh.nodes[mesh.cells].mean(axis=1) - [8.0, 0.0, 8.0], axis=1)

    def picture(stiff):
        lame = np.tile(np.where(far < 0.7, stiff, 1.0)[:, None], 2)
        return deformed(Fields(mesh.nodes, mesh.cells, np.zeros(len(mesh.cells), int), lame, stretched), View({}))

    with Artist() as artist:  # a process that draws may end, as where there is no display
        def done(*job):
            artist.begin(*job)
            try:
                return artist.finish()
            except CannotDraw:
                pytest.skip("VTK can draw neither with X nor with EGL on this machine")

        with_peak, without = done(fitted, picture(1000.0)), done(fitted, picture(1.0))
        seen = done(draw_view, with_peak, 0, 300)
    assert with_peak.beyond and with_peak.limits[1] < 0.5 * with_peak.surfaces[0]["colour"].max()
    assert 0 < share(seen, RED) < 0.05
    assert not without.beyond and without.limits[1] == pytest.approx(without.surfaces[0]["colour"].max())


def test_each_nodes_status_fills_its_share():
    """At the first, the middle and the last load step, and at that of the peak."""
    fields = case.opened({1: [0, 0, 0, 0, 1, 2, 2, 2, 2]})
    i, picture = fields.interfaces, interfaces(fields, View({}))
    assert picture.kinds == ["open", "stick", "slip"] and picture.headings == ["load step 1 of 2", "load step 2 of 2"]
    assert picture.told == ["1 interface, undeformed"]
    last, area = picture.surfaces[1], np.linalg.norm(area_vectors(fields.nodes[i.nodes], i.triangles), axis=1)
    drawn = np.linalg.norm(area_vectors(np.asarray(last.points), last.regular_faces), axis=1)
    assert drawn.sum() == pytest.approx(area.sum())
    for kind in range(3):
        third = area @ (i.status[1][i.triangles] == kind).mean(axis=1)
        assert drawn[last.cell_data["colour"] == kind].sum() == pytest.approx(third) and third > 0
    parts = shares(np.random.default_rng(0).random((5, 3, 3)))
    areas = np.linalg.norm(np.cross(parts[..., 1, :] - parts[..., 0, :], parts[..., 2, :] - parts[..., 0, :]), axis=-1)
    assert np.allclose(areas, areas.mean(axis=(1, 2), keepdims=True))
    assert interfaces(case.fields(), View({})) is None


# --- what one sees ----------------------------------------------------------------------------------------


@pytest.mark.long
@in_a_window
def test_colours_are_those_of_the_statuses(draw, tmp_path):
    """Seen from where all of the interface is seen, each status has its share of the pixels; the figure names them."""
    fields = case.opened({1: [0, 0, 0, 0, 1, 2, 2, 2, 2]})
    picture, i = interfaces(fields, View({})), fields.interfaces
    alone = replace(picture, lines=[line.extract_points(np.zeros(0, int)) for line in picture.lines])
    seen = draw(alone, 1, 600)
    shown = [share(seen, i.kind_colours[i.kind_names == name][0]) for name in picture.kinds]
    drawn = np.linalg.norm(area_vectors(np.asarray(picture.surfaces[1].points), picture.surfaces[1].regular_faces), axis=1)
    wanted = np.array([drawn[picture.surfaces[1].cell_data["colour"] == kind].sum() for kind in range(3)])
    assert np.array(shown) / sum(shown) == pytest.approx(wanted / wanted.sum(), abs=0.03) and sum(shown) > 0.2
    figure = compose(picture, "made_up")
    assert [text.get_text() for text in figure.legends[0].get_texts()] == picture.kinds
    figure.savefig(tmp_path / "figure.png", dpi=160)
    assert is_drawn(tmp_path / "figure.png", figure)


# --- who draws --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_another_process_draws(tmp_path, draw):
    """It tells what hinders it, and does not outlive its job."""
    folder, job = ResultsFolder(tmp_path), (case.summary(), case.history(), case.opened())
    names = [path.name for path in drawn(write_figures, folder, *job)]
    assert names == ["convergence.png", "time.png", "deformed.png", "interfaces.png"]
    assert pixels(tmp_path / "figures/deformed.png").std() > 5

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
    with Artist() as artist:
        process = artist._process and artist._process.pid
        if how != "is no program":
            os.kill(process, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
        artist.begin(write_figures, ResultsFolder(tmp_path), case.summary(ballast="x" * 10**6), case.history(), case.fields())
        with pytest.raises(CannotDraw, match="was not done" if how == "hangs" else "cannot draw"):
            artist.finish(0.5 if how == "hangs" else 60.0)
    assert (process is None or gone([process])) and not (tmp_path / "figures").exists()
