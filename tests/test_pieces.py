"""Fields that ranks write: a piece each, and what puts the pieces together is what one process writes."""

import meshio
import numpy as np
import pytest
from pyvista import read
from ranks_case import CASES
from threads import among

from orchestrator.config.load import config_from
from orchestrator.method.setup import Part
from orchestrator.method.stopping.estimators import estimator_of
from orchestrator.results.extremes import extremes
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields, write_piece
from orchestrator.results.ranks import Piece
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.build import build_scene


@pytest.mark.parametrize("case, more", [("perfect", {}), ("contact on ten nodes", {}),
                                        ("perfect", {"blackbox": {"element": "P2"}, "loads": [{"body_force": [1e3, 0, 2e3]}]})])
def test_pieces_make_up_the_whole(case, more, tmp_path):
    scene = build_scene(config_from({"name": "pieces", **CASES[case], **more}))
    rng = np.random.default_rng(0)
    sides = None if case == "perfect" else [rng.standard_normal((scene.steps, len(s.nodes), 3)) for s in scene.subdomains]
    displacement = rng.standard_normal((scene.steps, len(scene.mesh.nodes), 3))
    estimate = estimator_of(scene)([displacement[:, s.nodes] for s in scene.subdomains] if sides is None else sides)
    believed = scene.cell_subdomain != 1
    fields = Fields.of(scene, displacement, sides, None, estimate.cells, believed=believed)
    (tmp_path / "one").mkdir()
    write_fields(ResultsFolder(tmp_path / "one"), fields)
    lost = None if sides is None else scene.cell_subdomain.max() == np.arange(len(scene.subdomains))[None].repeat(scene.steps, axis=0)
    most = extremes(fields.nodal, lost)
    parts = [displacement[:, s.nodes] for s in scene.subdomains] if sides is None else sides

    def write(team):
        part = Part.handed_out(scene, np.arange(len(scene.subdomains)) % 3, team)
        own = [part.scene.subdomains[e] for e in part.space.subdomains]
        known = [u if e % 3 == team.rank else None for e, u in enumerate(parts)]
        piece = Piece.of(part.scene, own, known, sides is not None, part.meeting)
        found = piece.estimate(team.rank == 0)
        ends = piece.extremes(*(() if team.rank else ([1], lost)))
        if team.rank:
            write_piece(piece)
        else:
            write_fields(ResultsFolder(tmp_path / "three"), fields, piece)
            assert found.relative == pytest.approx(estimate.relative, rel=1e-12)
            assert np.allclose(found.cells, estimate.cells, rtol=1e-12, atol=1e-12 * estimate.cells.max())
            assert np.allclose(ends.value, most.value, rtol=1e-12, atol=1e-12 * np.nanmax(most.value), equal_nan=True)
            assert np.array_equal(ends.at, most.at) and np.array_equal(ends.step, most.step)

    assert among(3, write) == [None] * 3
    for step in range(1, scene.steps + 1):
        one = meshio.read(tmp_path / f"one/fields/step_{step:04d}.vtu")
        pieces = [meshio.read(tmp_path / f"three/fields/step_{step:04d}_{rank}.vtu") for rank in range(3)]
        assert all(len(p.cells[0].data) for p in pieces)

        def of_cells(grid):
            centres = grid.points[grid.cells[0].data].mean(axis=1)
            at_nodes = (grid.point_data[name][grid.cells[0].data].reshape(len(centres), -1) for name in sorted(grid.point_data))
            values = np.column_stack([centres, *at_nodes,
                                      *(grid.cell_data[name][0] for name in sorted(grid.cell_data))])
            return values

        whole, parts = of_cells(one), np.concatenate([of_cells(p) for p in pieces])
        order, other = (np.lexsort(np.round(x[:, :3], 9).T) for x in (whole, parts))
        size = np.nanmax(np.abs(whole), axis=0)
        assert np.allclose(whole[order], parts[other], rtol=1e-12, atol=1e-12 * size, equal_nan=True)
        seen = read(tmp_path / f"three/fields/step_{step:04d}.pvtu")
        assert seen.n_cells == len(scene.mesh.cells) and set(seen.cell_data) >= set(one.cell_data)
        assert seen.point_data["displacement"].shape[1] == 3 and seen.cell_data["stress"].shape[1] == 6
    assert "step_0001.pvtu" in (tmp_path / "three/fields/fields.pvd").read_text()
