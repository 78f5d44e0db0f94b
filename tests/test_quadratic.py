"""Ten-node tets from end to end: mesh, loads, black box, soles, patch tests, whole runs, files."""

import numpy as np
import pytest
from pyvista import CellType, read
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from blackbox_case import box, chain, difference, settings
from in_process import FREEFEM
from method_case import CLAMP, CUBES, close, config, irregular, method, naked_beside, solved
from quadratic_case import assemble_ten, with_middles
from quick import quick

from orchestrator.blackbox.start import make_blackbox
from orchestrator.results.fields.fields import Fields, read_npz
from orchestrator.results.fields.files import write_fields
from orchestrator.results.folder import ResultsFolder
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

P2 = {"blackbox": {**FREEFEM, "element": "P2"}}  # quicker here than in process
STEEL = [{"young": 200e3, "poisson": 0.3}]


# --- mesh and loads ---------------------------------------------------------------------------------------


# --- the black box ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("transport", quick(["pipe", "file"], "pipe"))
def test_freefem_answers_in_our_numbering(transport):
    """Stiffness, traces and fields of randomly numbered models, one of them with a padded mesh."""
    models = [box((3, 2, 2), "a"), box((2, 2, 3), "b", seed=1), chain(64)]
    models = [with_middles(model, seed) for seed, model in enumerate(models)]
    with make_blackbox(settings(element="P2", transport=transport)) as blackbox:
        blackbox.load(models)
        rng = np.random.default_rng(0)
        forces = {i: rng.standard_normal((2, m.fixed.size)) for i, m in enumerate(models)}
        on_trace = {i: rng.standard_normal((2, len(m.trace))) for i, m in enumerate(models)}
        stiffness, fields, traces = blackbox.stiffness(models), blackbox.fields(forces), blackbox.traces(on_trace)
    for i, model in enumerate(models):
        k = assemble_ten(model)
        assert difference(stiffness[i], k) < 1e-12
        free = np.flatnonzero(~model.fixed)
        solve = spla.splu(k[free][:, free].tocsc()).solve
        assert (fields[i][:, model.fixed.ravel()] == 0).all()
        assert difference(fields[i][:, free], solve(forces[i][:, free].T).T) < 1e-8
        full = np.zeros((2, model.fixed.size))
        full[:, model.trace] = on_trace[i]
        exact = np.zeros_like(full)
        exact[:, free] = solve(full[:, free].T).T
        assert difference(traces[i], exact[:, model.trace]) < 1e-8


@pytest.mark.parametrize("kind", quick(["layer", "symmetric", "springs", "overlap"], "overlap"))
@pytest.mark.long
def test_what_is_factorised_is_the_sum(tmp_path, kind):
    """The extended subdomains' answers satisfy (K_E + Σ NᵀkN) u = f to rounding."""
    made = config(mesh=irregular(tmp_path / "box.meshb"), subdomains={"metis": 7}, **P2, **method({"kind": kind}))
    with naked_beside(made) as (scene, blackbox, d, naked):
        rng, forces = np.random.default_rng(0), {}
        for s, count in zip(scene.subdomains, d.made.node_counts):
            forces[s.index] = np.zeros((1, 3 * count))
            forces[s.index][0, : s.fixed.size] = np.where(s.fixed.ravel(), 0.0, rng.standard_normal(s.fixed.size))
        answers = blackbox.fields(forces)
    robin = sp.csr_array(d.space.scatter @ d.stage.direction.k @ d.space.scatter.T)
    for s, part, trace, own in zip(scene.subdomains, d.space.boundary, d.made.traces, naked):
        u, f = (x[s.index][0, : s.fixed.size] for x in (answers, forces))
        sole = np.zeros(len(u))
        sole[trace] = robin[part][:, part] @ u[trace]
        left = np.where(s.fixed.ravel(), 0.0, own @ u + sole - f)
        assert np.abs(left).max() <= 1e-12 * (abs(own) @ np.abs(u)).max()
        assert np.abs(sole).max() > 1e-3 * np.abs(f).max() and (d.stage.direction.diagonal > 0).all()


# --- patch tests ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_pure_bending_is_exact(tmp_path):
    """σ_xx = 10 (z − 1): a quadratic displacement, prescribed at both ends and found in between."""
    made = config(mesh=irregular(tmp_path / "box.meshb"), subdomains=CUBES["subdomains"], **P2, materials=STEEL,
                  **method(tolerance={"error": 1e-10}),
                  boundary=[CLAMP, {"on": {"plane": "x", "at": 4.0}, "displacement": [0.0, 0.0, 0.0]}])
    scene = build_scene(made)
    x, y, z = (scene.mesh.nodes - [0, 1, 1]).T
    exact = 10 / 200e3 * np.stack([x * z, -0.3 * y * z, -0.5 * (x**2 + 0.3 * (z**2 - y**2))], axis=1)
    scene.prescribed[:] = np.where(scene.fixed, exact, 0.0)
    for s in scene.subdomains:
        s.prescribed[:] = scene.prescribed[:, s.nodes]
    found = solve(made, scene)
    assert found.converged
    assert close(found.displacement[0], exact, 1e-8)
    fields = fields_of(found)
    corners = scene.mesh.nodes[scene.mesh.cells[:, :4], 2] - 1
    assert close(fields.corner_stress(0)[:, :, 0], 10 * corners, 1e-7)
    assert close(fields.stress(0)[:, 0], 10 * corners.mean(axis=1), 1e-7)
    assert close(fields.nodal_von_mises(0), 10 * np.abs(scene.mesh.nodes[scene.mesh.cells, 2] - 1), 1e-6)


# --- whole runs -------------------------------------------------------------------------------------------


# --- files and pictures -----------------------------------------------------------------------------------


def fields_of(found) -> Fields:
    return Fields.of(found.scene, found.displacement)


def test_field_files(tmp_path):
    """fields.npz comes back; the .vtu has quadratic tets in VTK's order, with stress and its peak."""
    found = solved(reference=False, **P2)
    fields = fields_of(found)
    write_fields(ResultsFolder(tmp_path), fields)
    again = read_npz(tmp_path)
    assert again.cells.shape[1] == 10 and np.array_equal(again.displacement, found.displacement)
    grid = read(tmp_path / "fields" / "step_0001.vtu")
    assert set(grid.celltypes) == {CellType.QUADRATIC_TETRA}
    assert grid.volume == pytest.approx(4.0) and grid.compute_cell_sizes()["Volume"].min() > 0
    assert (grid.cell_data["von_mises_max"] >= grid.cell_data["von_mises"] * (1 - 1e-12)).all()
    np.testing.assert_allclose(grid.cell_data["stress"], fields.stress(0), rtol=1e-12)


# --- contact ----------------------------------------------------------------------------------------------
