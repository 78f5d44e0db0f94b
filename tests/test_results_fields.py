"""Stress recovery against closed forms, and the field files read back."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest
import results_case as case

from orchestrator.errors import InputError
from orchestrator.scene import stress as recovery
from orchestrator.scene import stress_loops
from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.results.fields.piece import estimated
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields
from orchestrator.scene.stress import principal
from orchestrator.results.fields.npz import read_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.mesh.geometry import shape_gradients


def stress_of(mesh, displacement, material=case.STEEL):
    gradients, _ = shape_gradients(mesh.nodes, mesh.cells)
    return recovery.stress(recovery.strain(gradients, mesh.cells, displacement), case.lame(mesh, material))


def test_volumes_fill_the_box():
    mesh = case.box_mesh()
    volumes = shape_gradients(mesh.nodes, mesh.cells)[1]
    assert (volumes > 0).all() and volumes.sum() == pytest.approx(3.0, rel=1e-14)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_uniform_tension(axis):
    mesh, sigma = case.box_mesh(), 10.0
    strains = np.full(3, -case.STEEL.poisson * sigma / case.STEEL.young)
    strains[axis] = sigma / case.STEEL.young
    found = stress_of(mesh, mesh.nodes * strains)
    expected = np.zeros(6)
    expected[axis] = sigma
    np.testing.assert_allclose(found, np.tile(expected, (len(mesh.cells), 1)), atol=1e-11)
    np.testing.assert_allclose(recovery.von_mises(found), sigma, rtol=1e-12)


@pytest.mark.parametrize("position, i, j", [(3, 0, 1), (4, 1, 2), (5, 0, 2)])
def test_pure_shear_in_vtk_order(position, i, j):
    mesh, gamma = case.box_mesh(), 1e-4
    displacement = np.zeros_like(mesh.nodes)
    displacement[:, i] = gamma * mesh.nodes[:, j]
    found = stress_of(mesh, displacement)
    mu = case.STEEL.lame[1]
    expected = np.zeros(6)
    expected[position] = mu * gamma
    np.testing.assert_allclose(found, np.tile(expected, (len(mesh.cells), 1)), atol=1e-11)
    np.testing.assert_allclose(recovery.von_mises(found), np.sqrt(3) * mu * gamma, rtol=1e-12)


def test_rigid_motion_has_no_stress():
    mesh = case.box_mesh()
    displacement = np.array([1.0, -2.0, 0.5]) + np.cross([1e-3, -2e-3, 3e-3], mesh.nodes)
    assert np.abs(stress_of(mesh, displacement)).max() < 1e-9 * case.STEEL.young * 1e-3


def test_millimetres_and_metres_agree():
    mm, m = case.box_mesh(), case.box_mesh()
    m.nodes = mm.nodes * 1e-3
    u = case.bending(mm)[-1]
    in_mpa = stress_of(mm, u)
    in_pa = stress_of(m, u * 1e-3, case.Material(case.STEEL.young * 1e6, case.STEEL.poisson))
    np.testing.assert_allclose(in_pa * 1e-6, in_mpa, atol=1e-10 * np.abs(in_mpa).max())


def test_nodal_average_does_not_mix_materials():
    mesh = case.box_mesh()
    group = case.slices(mesh, 2)
    volumes = shape_gradients(mesh.nodes, mesh.cells)[1]
    values = np.where(group == 1, 7.0, 3.0)
    average, node, corner = recovery.nodal_average(mesh.cells, [np.tile(values[:, None], 4)], volumes, group)
    np.testing.assert_allclose(average[0][corner], values[:, None] * np.ones(4), rtol=1e-14)
    np.testing.assert_array_equal(node[corner], mesh.cells)
    assert average.shape == (1, len(mesh.nodes) + 9)  # the 3 × 3 nodes between the halves count twice


def test_field_files_round_trip(tmp_path):
    mesh, folder = case.box_mesh(), ResultsFolder(tmp_path)
    folder.write("fields/step_0003.vtu", "of an earlier run")
    u = case.bending(mesh)
    written = Fields(mesh.nodes, mesh.cells, case.slices(mesh), case.lame(mesh), u)
    write_fields(folder, written)

    assert sorted(p.name for p in (tmp_path / "fields").iterdir()) == ["fields.pvd", "step_0001.vtu", "step_0002.vtu"]
    sets = ET.parse(tmp_path / "fields/fields.pvd").getroot().findall("Collection/DataSet")
    assert [(float(s.get("timestep")), s.get("file")) for s in sets] == [(1, "step_0001.vtu"), (2, "step_0002.vtu")]
    for step in range(2):
        grid = meshio.read(tmp_path / "fields" / sets[step].get("file"))
        np.testing.assert_array_equal(grid.points, mesh.nodes)
        np.testing.assert_array_equal(grid.cells_dict["tetra"], mesh.cells)
        np.testing.assert_array_equal(grid.point_data["displacement"], u[step])
        np.testing.assert_array_equal(grid.cell_data["subdomain"][0], case.slices(mesh))
        np.testing.assert_allclose(grid.cell_data["stress"][0], stress_of(mesh, u[step]), rtol=1e-13)
        np.testing.assert_allclose(grid.cell_data["von_mises"][0], written.von_mises(step), rtol=1e-13)

    read = read_npz(tmp_path)
    for name in ("nodes", "cells", "subdomain", "lame", "displacement"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


def test_vtk_reads_the_vtu(tmp_path):
    reader = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridReader()
    mesh = case.box_mesh()
    write_fields(ResultsFolder(tmp_path), case.fields())
    reader.SetFileName(str(tmp_path / "fields/step_0001.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfCells() == len(mesh.cells)
    assert grid.GetCellData().GetArray("stress").GetNumberOfComponents() == 6
    assert grid.GetPointData().GetArray("displacement").GetNumberOfComponents() == 3


def test_no_fields_and_damaged_fields(tmp_path):
    assert read_npz(tmp_path) is None
    (tmp_path / "fields.npz").write_bytes(b"PK\x03\x04 half")
    with pytest.raises(InputError, match="fields.npz"):
        read_npz(tmp_path)


def test_compiled_stresses_and_their_estimate_are_the_others():
    """Where something opens, loops are compiled; two matters, bodies apart; of equal and of unknown stresses too."""
    apart = case.opened()
    lame = apart.lame * np.linspace(1, 2, len(apart.cells)).round(1)[:, None]
    f = replace(apart, lame=lame, joined=np.arange(len(apart.numbering.nodes)))
    plain = replace(f, joined=None).opened
    assert f.opened.compiled and not plain.compiled
    one = Estimator(plain.nodes, plain.cells, f.joined, plain.material, plain.lame)([plain.displacement])
    found = estimated(f)
    assert found.relative == pytest.approx(one.relative, rel=1e-12) and one.relative > 0.01
    np.testing.assert_allclose(found.cells, one.cells, atol=1e-12 * one.cells.max())
    assert estimated(replace(f, part=(f.cells.mean(axis=1) > 20).astype(int), parts=("a", "b"))) is None, "nodal stresses tell parts apart"
    assert estimated(replace(f, joined=None)) is None
    np.testing.assert_allclose(f.opened.volumes, plain.volumes, rtol=1e-12)
    for step in range(f.steps):
        largest = np.abs(plain.stress(step)).max()
        np.testing.assert_allclose(f.opened.stress(step), plain.stress(step), atol=1e-12 * largest)
    sigma = np.vstack([f.nodal.stress(1), np.zeros(6), [1, 1, 1, 1e-9, 0, 0], [2.0] * 6, [3, 1, 2, 0, 0, 5], [1, 1, 1, 1, 1, np.nan]])
    np.testing.assert_allclose(stress_loops.principal(sigma), principal(sigma), atol=1e-13 * np.nanmax(np.abs(sigma)))
    warm = replace(f, thermal=np.full((2, len(f.cells), 4), 1e-3)).opened
    np.testing.assert_allclose(warm.stress(1) - plain.stress(1), -1e-3 * (3 * lame[:, :1] + 2 * lame[:, 1:]) * [1, 1, 1, 0, 0, 0],
                               atol=1e-11 * np.abs(lame).max())
