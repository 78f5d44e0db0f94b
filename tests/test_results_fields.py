"""Stress recovery against closed forms, and the field files read back."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest
from pyvista import read
import results_case as case

from orchestrator.errors import InputError
from orchestrator.scene import elasticity as recovery
from orchestrator.results.fields.fields import Fields, read_npz
from orchestrator.results.fields.files import write_fields, write_vtu
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.mesh.geometry import shape_gradients


def stress_of(mesh, displacement, material=case.STEEL):
    gradients, _ = shape_gradients(mesh.nodes, mesh.cells)
    return recovery.stress(recovery.strain(gradients, mesh.cells, displacement), case.lame(mesh, material))


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
        np.testing.assert_allclose(grid.cell_data["von_mises"][0], recovery.von_mises(written.stress(step)), rtol=1e-13)

    read = read_npz(tmp_path)
    for name in ("nodes", "cells", "subdomain", "lame", "displacement"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


@pytest.mark.parametrize("points, triangles", [(18, 12), (9, 8), (25, 32)])
def test_meshio_and_vtk_read_every_array_as_it_is(points, triangles, tmp_path):
    """meshio exchanges arrays whose places coincide with those that it gives others: of 18 points, a gap for a displacement."""
    rng = np.random.default_rng(1)
    at = {name: rng.random((points, 3) if wide else points) for name, wide in (
        ("displacement_1", True), ("displacement_2", True), ("gap", False), ("slip", True), ("pressure", False), ("friction", True))}
    at["status"] = rng.integers(5, size=points).astype(np.int32)
    write_vtu(ResultsFolder(tmp_path), "fields/one.vtu", rng.random((points, 3)), rng.integers(points, size=(triangles, 3)), at,
              {"interface": np.arange(triangles, dtype=np.int32)})
    for grid in (meshio.read(tmp_path / "fields/one.vtu"), read(tmp_path / "fields/one.vtu")):
        assert set(grid.point_data) == set(at)
        for name, values in at.items():
            np.testing.assert_array_equal(grid.point_data[name], values)


def test_no_fields_and_damaged_fields(tmp_path):
    assert read_npz(tmp_path) is None
    (tmp_path / "fields.npz").write_bytes(b"PK\x03\x04 half")
    with pytest.raises(InputError, match="fields.npz"):
        read_npz(tmp_path)


def test_heat_that_is_kept_from_expanding_is_a_pressure():
    fields = case.opened()
    warm = replace(fields, thermal=np.full((2, len(fields.cells), 4), 1e-3))
    lost = 1e-3 * (3 * fields.lame[:, :1] + 2 * fields.lame[:, 1:]) * [1, 1, 1, 0, 0, 0]
    np.testing.assert_allclose(warm.stress(1) - fields.stress(1), -lost, atol=1e-11 * np.abs(fields.lame).max())
