"""Fields that ranks write: a piece each, and what puts the pieces together is what one process writes."""

import meshio
import numpy as np
import pytest
import pyvista
from ranks_case import CASES
from threads import among

from orchestrator.config import config_from
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields, write_piece
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.build import build_scene


@pytest.mark.parametrize("case", ["perfect", "contact on ten nodes"])
def test_pieces_make_up_the_whole(case, tmp_path):
    scene = build_scene(config_from({"name": "pieces", **CASES[case]}))
    rng = np.random.default_rng(0)
    fields = Fields.of(scene, rng.standard_normal((scene.steps, len(scene.mesh.nodes), 3)), None, None,
                       rng.random((scene.steps, len(scene.mesh.cells))))
    (tmp_path / "one").mkdir()
    write_fields(ResultsFolder(tmp_path / "one"), fields)

    def write(team):
        if team.rank:
            write_piece(team)
        else:
            write_fields(ResultsFolder(tmp_path / "three"), fields, team)

    assert among(3, write) == [None] * 3
    for step in range(1, scene.steps + 1):
        one = meshio.read(tmp_path / f"one/fields/step_{step:04d}.vtu")
        pieces = [meshio.read(tmp_path / f"three/fields/step_{step:04d}_{rank}.vtu") for rank in range(3)]
        assert all(len(p.cells[0].data) for p in pieces)

        def of_cells(grid):
            centres = grid.points[grid.cells[0].data].mean(axis=1)
            values = np.column_stack([centres, grid.point_data["displacement"][grid.cells[0].data].reshape(len(centres), -1),
                                      *(grid.cell_data[name][0] for name in sorted(grid.cell_data))])
            return values

        whole, parts = of_cells(one), np.concatenate([of_cells(p) for p in pieces])
        order, other = (np.lexsort(np.round(x[:, :3], 9).T) for x in (whole, parts))
        assert np.allclose(whole[order], parts[other], rtol=1e-12, atol=1e-12)
        seen = pyvista.read(tmp_path / f"three/fields/step_{step:04d}.pvtu")
        assert seen.n_cells == len(scene.mesh.cells) and set(seen.cell_data) >= set(one.cell_data)
        assert seen.point_data["displacement"].shape[1] == 3 and seen.cell_data["stress"].shape[1] == 6
    assert "step_0001.pvtu" in (tmp_path / "three/fields/fields.pvd").read_text()
