"""Fields that ranks write: a piece each, and what puts the pieces together is what one process writes."""

import io
import resource
import threading

import meshio
import numpy as np
import pytest
from pyvista import read
from quick import late
from ranks_case import CASES
from threads import among

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.recovery import on_mesh
from orchestrator.method.setup import Part
from orchestrator.method.stopping.element_problems import estimator_of
from orchestrator.results import whole
from orchestrator.results.extremes import extremes
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields, write_piece
from orchestrator.results.ranks import Piece
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.whole import BLOCK
from orchestrator.results.whole import arrays
from orchestrator.scene.build import build_scene


def same_arrays(one, several):
    """Both are what numpy writes, in one order, to the bit but for sums that round otherwise."""
    arrays = dict(np.load(several))
    np.savez(packed := io.BytesIO(), **arrays)
    assert packed.getvalue() == several.read_bytes()
    found = dict(np.load(one))
    assert list(found) == list(arrays)
    for name, values in found.items():
        assert values.dtype == arrays[name].dtype
        assert np.array_equal(values, arrays[name]) if name != "discretisation_error" else np.allclose(values, arrays[name], rtol=1e-12, atol=0)


def met_of(scene, rng):
    """Any fields of the interfaces that are not perfect; None where all are."""
    opening = scene.opening
    if not opening:
        return None
    shown = [i.shown for i in opening]
    offsets, steps = np.cumsum([0, *map(len, shown)]), scene.steps
    (nodes, others), n = (np.concatenate([scene.side_nodes(i, side)[c] for i, c in zip(opening, shown)]) for side in (0, 1)), offsets[-1]
    scalars, vectors = rng.normal(size=(7, steps, n)), rng.normal(size=(2, steps, n, 3))
    return InterfaceFields(
        np.array([i.name for i in opening]), np.array([i.law.name for i in opening]), np.array([i.subdomains for i in opening]), offsets, nodes,
        others, np.concatenate([np.searchsorted(c, i.shown_triangles) + a for i, c, a in zip(opening, shown, offsets)]),
        np.repeat(np.arange(len(opening)), [len(i.shown_triangles) for i in opening]), rng.normal(size=(n, 3)), *rng.normal(size=(2, n)),
        scalars[0], vectors[0], scalars[1], vectors[1], rng.integers(3, size=(steps, n)).astype(np.int32), np.arange(3),
        np.array(["open", "stick", "slip"]), np.array(["#000000"] * 3), rng.normal(size=(steps, len(opening), 3)), scalars[2],
        {"damage": scalars[3]}, *scalars[4:6], points=scene.mesh.nodes[np.stack([nodes, others])], index=np.arange(len(opening)))


MANY = {"blackbox": {"element": "P2"}, "loads": [{"body_force": [1e3, 0, 2e3]}]}


@pytest.mark.parametrize("case, more, ranks, block", [
    ("perfect", {}, 3, BLOCK), late("perfect", {}, 2, 700), late("perfect", {}, 4, 1), ("contact on ten nodes", {}, 3, BLOCK),
    late("contact on ten nodes", {}, 2, 700), ("contact on ten nodes", {}, 4, 1), ("perfect", MANY, 3, BLOCK), late("perfect", MANY, 2, 700),
    late("perfect", MANY, 4, 1)])
def test_pieces_make_up_the_whole(case, more, ranks, block, tmp_path, monkeypatch):
    monkeypatch.setattr(whole, "BLOCK", block)
    scene = build_scene(config_from({"name": "pieces", **CASES[case], **more}))
    rng = np.random.default_rng(0)

    def any_of(count):  # whose means are without rounding
        return rng.integers(-(2**40), 2**40, (scene.steps, count, 3)) / 2**40

    sides = None if case == "perfect" else [any_of(len(s.nodes)) for s in scene.subdomains]
    displacement = any_of(len(scene.mesh.nodes)) if sides is None else on_mesh(scene, sides)
    estimate = estimator_of(scene)([displacement[:, s.nodes] for s in scene.subdomains] if sides is None else sides)
    believed = scene.cell_subdomain != 1
    met = met_of(scene, rng)
    fields = Fields.of(scene, displacement, sides, met, estimate.cells, believed=believed)
    (tmp_path / "one").mkdir()
    write_fields(ResultsFolder(tmp_path / "one"), fields)
    lost = None if sides is None else scene.cell_subdomain.max() == np.arange(len(scene.subdomains))[None].repeat(scene.steps, axis=0)
    most = extremes(fields.nodal, lost)
    parts = [displacement[:, s.nodes] for s in scene.subdomains] if sides is None else sides

    def write(team):
        part = Part.handed_out(scene, np.arange(len(scene.subdomains)) % ranks, team)
        own = [part.scene.subdomains[e] for e in part.space.subdomains]
        known = [u if e % ranks == team.rank else None for e, u in enumerate(parts)]
        piece = Piece.of(part.scene, own, known, sides is not None, part.meeting)
        if met is not None:
            piece.interfaces = met.some(np.flatnonzero(met.subdomains[:, 0] % ranks == team.rank))
        found = piece.estimate(team.rank == 0)
        piece.disbelieve([1])
        ends = piece.extremes(lost)
        if team.rank:
            write_piece(piece)
        else:
            write_fields(ResultsFolder(tmp_path / "several"), None, piece)
            assert found.relative == pytest.approx(estimate.relative, rel=1e-12)
            assert np.allclose(found.cells, estimate.cells, rtol=1e-12, atol=1e-12 * estimate.cells.max())
            assert np.allclose(ends.value, most.value, rtol=1e-12, atol=1e-12 * np.nanmax(most.value), equal_nan=True)
            assert np.array_equal(ends.at, most.at) and np.array_equal(ends.step, most.step)

    assert among(ranks, write) == [None] * ranks
    same_arrays(tmp_path / "one/fields.npz", tmp_path / "several/fields.npz")
    for step in range(1, scene.steps + 1):
        one = meshio.read(tmp_path / f"one/fields/step_{step:04d}.vtu")
        pieces = [meshio.read(tmp_path / f"several/fields/step_{step:04d}_{rank}.vtu") for rank in range(ranks)]
        assert all(len(p.cells[0].data) for p in pieces)

        def of_cells(grid):
            centres = grid.points[grid.cells[0].data].mean(axis=1)
            at_nodes = (grid.point_data[name][grid.cells[0].data].reshape(len(centres), -1) for name in sorted(grid.point_data))
            values = np.column_stack([centres, *at_nodes,
                                      *(grid.cell_data[name][0] for name in sorted(grid.cell_data))])
            return values

        entire, parts = of_cells(one), np.concatenate([of_cells(p) for p in pieces])
        order, other = (np.lexsort(np.round(x[:, :3], 9).T) for x in (entire, parts))
        size = np.nanmax(np.abs(entire), axis=0)
        assert np.allclose(entire[order], parts[other], rtol=1e-12, atol=1e-12 * size, equal_nan=True)
        seen = read(tmp_path / f"several/fields/step_{step:04d}.pvtu")
        assert seen.n_cells == len(scene.mesh.cells) and set(seen.cell_data) >= set(one.cell_data)
        assert seen.point_data["displacement"].shape[1] == 3 and seen.cell_data["stress"].shape[1] == 6
        if met is not None:
            patch = read(tmp_path / f"one/fields/interface_{step:04d}.vtu")
            pieces = read(tmp_path / f"several/fields/interface_{step:04d}.pvtu")
            order = np.argsort(pieces["interface"], kind="stable")
            assert set(patch.array_names) == set(pieces.array_names) and len({*patch["interface"]}) == len(met.names)
            for name in patch.point_data:
                corners, others = (grid[name][grid.cell_connectivity.reshape(-1, 3)] for grid in (patch, pieces))
                assert np.array_equal(corners, others[order]), name
            assert np.array_equal(patch["interface"], pieces["interface"][order]) and "interface_0001.pvtu" in (
                tmp_path / "several/fields/interfaces.pvd").read_text()
    assert "step_0001.pvtu" in (tmp_path / "several/fields/fields.pvd").read_text()


@pytest.mark.parametrize("fault", ["a rank dies", "the disk is full"])
def test_what_was_there_stays_where_writing_fails(fault, tmp_path):
    """And nothing unfinished is left."""
    scene, folder = build_scene(config_from({"name": "pieces", **CASES["perfect"]})), ResultsFolder(tmp_path)
    whole, parts = np.zeros((scene.steps, len(scene.mesh.nodes), 3)), [np.zeros((scene.steps, len(s.nodes), 3)) for s in scene.subdomains]
    write_fields(folder, Fields.of(scene, whole))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def write(team):
        part = Part.handed_out(scene, np.arange(len(scene.subdomains)) % 2, team)
        piece = Piece.of(part.scene, [part.scene.subdomains[e] for e in part.space.subdomains], parts, False, part.meeting)
        if not team.rank:
            write_fields(folder, None, piece)
        for count, (_, array) in enumerate(arrays(piece)):
            if fault == "a rank dies" and count == 3:
                raise RuntimeError("dies")
            array.whole()

    room = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len((tmp_path / "fields.npz").read_bytes()) // 2 if "disk" in fault else room[0], room[1]))
    try:
        first, _ = among(2, write)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, room)
    assert isinstance(first, threading.BrokenBarrierError if fault == "a rank dies" else InputError)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
