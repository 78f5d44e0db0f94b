"""Ten-node tets from end to end: mesh, loads, black box, soles, patch tests, whole runs, files."""

import meshio
import numpy as np
import pytest
from pyvista import CellType, read
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from blackbox_case import box, chain, difference, settings
from contact_case import BOTTOM, TOP, contact, contacts, converged, monolithic, two_boxes, written
from in_process import FREEFEM
from method_case import CLAMP, CUBES, METIS, close, config, irregular, method, naked_beside, saved, solved
from quadratic_case import assemble_ten, with_middles
from test_contact_verification import ROLLERS, YOUNG, assert_agrees
from quick import late, quick

from orchestrator.blackbox.start import make_blackbox
from orchestrator.results.figures.pictures import deformed, outer_surface
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.files import write_fields
from orchestrator.results.fields.npz import read_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.sources import bricks

P2 = {"blackbox": {**FREEFEM, "element": "P2"}}  # quicker here than in process
STEEL = [{"young": 200e3, "poisson": 0.3}]


# --- mesh and loads ---------------------------------------------------------------------------------------


def test_corners_keep_their_numbers_and_every_edge_has_its_middle(tmp_path):
    mesh = {"mesh": irregular(tmp_path / "box.meshb")}
    linear, scene = build_scene(config(**mesh)), build_scene(config(**mesh, **P2))
    n, cells, nodes = len(linear.mesh.nodes), scene.mesh.cells, scene.mesh.nodes
    assert np.array_equal(nodes[:n], linear.mesh.nodes) and np.array_equal(cells[:, :4], linear.mesh.cells)
    assert np.array_equal(scene.cell_subdomain, linear.cell_subdomain)
    for column, (i, j) in enumerate([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)], 4):
        assert close(nodes[cells[:, column]], (nodes[cells[:, i]] + nodes[cells[:, j]]) / 2, 1e-15)
    assert len(np.unique(nodes.round(9), axis=0)) == len(nodes), "an edge has more than one middle"
    for interface in scene.interfaces:
        points, triangles = scene.points(interface), interface.triangles
        assert close(points[triangles[:, 3:]], (points[triangles[:, :3]] + points[triangles[:, [1, 2, 0]]]) / 2, 1e-15)


def test_loads_do_the_work_of_what_they_stand_for(tmp_path):
    """Body force, traction and pressure against every product of two coordinates, integrated by hand."""
    body, pull, press, size = np.array([1.0, -2.0, 0.5]), np.array([3.0, 1.0, -1.0]), 7.0, np.array([4.0, 2.0, 2.0])
    scene = build_scene(config(
        mesh=irregular(tmp_path / "box.meshb"), **P2, loads=[{"body_force": body.tolist()}],
        boundary=[CLAMP, {"on": {"plane": "x", "at": 4.0}, "traction": pull.tolist()},
                  {"on": {"plane": "z", "at": 2.0}, "pressure": press}]))

    def mean(a, b, side=None):
        """Of the product of coordinates a and b over the box, or over the side where one is largest."""
        first = [size[c] if c == side else size[c] / 2 for c in (a, b)]
        return first[0] * first[1] if a != b or a == side else size[a] ** 2 / 3

    for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)):
        work = (scene.mesh.nodes[:, a] * scene.mesh.nodes[:, b]) @ scene.loads[0]
        expected = 16 * mean(a, b) * body + 4 * mean(a, b, 0) * pull + [0, 0, -8 * mean(a, b, 2) * press]
        assert close(work, expected, 1e-12)


# --- the black box ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("transport", ["pipe", "file"])
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
def test_uniform_tension_is_exact(tmp_path):
    """A linear field on an irregular mesh: displacement and stress to the tolerance."""
    found = solved(mesh=irregular(tmp_path / "box.meshb"), subdomains={"metis": 7}, **P2, materials=STEEL,
                   **method(tolerance={"error": 1e-10}), boundary=[
                       {"on": {"plane": "x", "at": 0.0}, "displacement": [0, None, None]},
                       {"on": {"plane": "y", "at": 0.0}, "displacement": [None, 0, None]},
                       {"on": {"plane": "z", "at": 0.0}, "displacement": [None, None, 0]},
                       {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 0.0, 0.0]}])
    assert found.converged
    assert close(found.displacement[0], found.scene.mesh.nodes * [5e-5, -1.5e-5, -1.5e-5], 1e-8)
    sigma = fields_of(found).corner_stress(0)
    assert close(sigma, np.broadcast_to([10.0, 0, 0, 0, 0, 0], sigma.shape), 1e-7)


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

CASES = {"slices": {"mesh": {"box": {"size": [8, 1, 1], "cells": [16, 2, 2]}},
                    "subdomains": {"slices": {"axis": "x", "count": 8}},
                    "boundary": [CLAMP, {"on": {"plane": "x", "at": 8.0}, "traction": [10.0, 0.0, 0.0]}]},
         "cubes": CUBES, "metis": METIS}


@pytest.mark.parametrize("case", quick(CASES, "cubes"))
def test_the_undecomposed_solution_is_found(case):
    """True error below 1e-8, and at every iteration that has a bound: error ≤ bound ≤ 5 × error."""
    found = solved(**CASES[case], **P2, **method(tolerance={"error": 1e-8}))
    assert found.converged and found.summary["true_error"] <= 1e-8
    assert found.iterations <= {"slices": 16, "cubes": 26, "metis": 34}[case]
    known = [e for e in found.iterated.history if np.isfinite(e.error_bound) and e.true_error > 1e-9]
    assert known and all(e.true_error <= e.error_bound <= 5 * e.true_error for e in known)


@pytest.mark.parametrize("tolerance", quick([1e-1, 1e-4], 1e-4))
@pytest.mark.parametrize("changes", [{"kind": "layer"}, late({"modulus_ratio": 0.02})], ids=["layer", "soft"])
def test_the_bound_holds(tmp_path, tolerance, changes):
    found = solved(mesh=irregular(tmp_path / "box.meshb"), subdomains={"metis": 5}, **P2,
                   **method(changes, tolerance={"error": tolerance}))
    assert found.summary["true_error"] <= found.summary["error_bound"] <= 5 * found.summary["true_error"]


def test_bending_is_far_better_than_with_linear_tets():
    """A cantilever ten times as long as high, two elements through the height: deflection against beam theory."""
    bar = {"mesh": {"box": {"size": [10, 1, 1], "cells": [20, 2, 2]}},
           "subdomains": {"slices": {"axis": "x", "count": 5}},
           "boundary": [CLAMP, {"on": {"plane": "x", "at": 10.0}, "traction": [0.0, 0.0, -1.0]}]}
    slope = 10**3 / (3 * 200e3 / 12) + 10 / (5 / 6 * 200e3 / 2.6)  # bending and shear
    errors = {}
    for element in ("P1", "P2"):
        found = solved(reference=False, **bar, blackbox={"workers": 2, "element": element})
        end = found.scene.mesh.nodes[:, 0] > 10 - 1e-9
        errors[element] = abs(found.displacement[0, end, 2].mean() / slope + 1)
    assert errors["P2"] < 0.015 and errors["P1"] > 0.3, errors


def test_units_and_numbering(tmp_path):
    """Metres instead of millimetres, and shuffled nodes, cells and corners: the same iterations, the same field."""
    mesh, cut = bricks(np.array([4.0, 2.0, 2.0]), np.array([4, 2, 2]), "box"), {"grid": [2, 2, 1]}
    rng = np.random.default_rng(0)
    new = rng.permutation(len(mesh.nodes))
    nodes = np.empty_like(mesh.nodes)
    nodes[new] = mesh.nodes
    cells = new[mesh.cells][rng.permutation(len(mesh.cells))][:, [1, 2, 0, 3]]
    meshio.Mesh(mesh.nodes, [("tetra", mesh.cells)]).write(tmp_path / "plain.meshb")
    meshio.Mesh(nodes, [("tetra", cells)]).write(tmp_path / "shuffled.meshb")
    plain, shuffled = (solved(reference=False, mesh={"file": str(tmp_path / f"{name}.meshb")}, **P2,
                              subdomains=cut) for name in ("plain", "shuffled"))
    metres = solved(reference=False, mesh={"file": str(tmp_path / "plain.meshb"), "scale": 1e-3}, **P2,
                    subdomains=cut, materials=[{"young": 200e9, "poisson": 0.3}],
                    boundary=[CLAMP, {"on": {"plane": "x", "at": 0.004}, "traction": [10e6, 1e6, 0.0]}])
    for other in (shuffled, metres):
        assert other.iterations == plain.iterations
        assert close([e.residual for e in other.iterated.history], [e.residual for e in plain.iterated.history])
    assert close(metres.displacement, plain.displacement / 1000)
    here, there = (np.lexsort(run.scene.mesh.nodes.round(6).T) for run in (plain, shuffled))
    assert close(shuffled.displacement[:, there], plain.displacement[:, here])


def test_parts_with_separate_coincident_nodes(tmp_path):
    """Two blocks numbered apart, bonded node by node, mid-edge nodes included: the solution of one mesh."""
    mesh = bricks(np.array([4.0, 1.0, 1.0]), np.array([8, 2, 2]), "box")
    mesh.volume = (mesh.nodes[mesh.cells].mean(axis=1)[:, 0] > 2).astype(int)
    whole = solved(reference=False, mesh=saved(mesh, tmp_path / "one.meshb"), subdomains="groups", **P2)
    keys, cells = np.unique(mesh.cells + len(mesh.nodes) * mesh.volume[:, None], return_inverse=True)
    mesh.nodes, mesh.cells = mesh.nodes[keys % len(mesh.nodes)], cells.reshape(-1, 4)
    apart = solved(reference=False, mesh=saved(mesh, tmp_path / "two.meshb"), subdomains="groups", **P2)
    assert [len(i.global_nodes) for i in apart.scene.interfaces] == [25]
    assert close(apart.iterated.bound.energy, whole.iterated.bound.energy, 1e-9)
    end = [run.scene.mesh.nodes[:, 0] > 4 - 1e-9 for run in (apart, whole)]
    assert close(apart.displacement[0, end[0]].sum(axis=0), whole.displacement[0, end[1]].sum(axis=0), 1e-5)


def test_reactions_and_several_steps():
    """Two load steps under traction, weight and a moved support: forces balance at each."""
    found = solved(**P2, histories={"up": [0.5, 1.0]}, loads=[{"body_force": [0, 0, -0.1]}], boundary=[
        {"on": {"plane": "x", "at": 0.0}, "displacement": [[0, 0, 0], [0, 0, 1e-3]]},
        {"on": {"plane": "x", "at": 4.0}, "traction": [10, 1, 0], "history": "up"}])
    assert found.summary["true_error"] <= found.summary["error_bound"] <= 1e-6
    held, pulled = np.array(found.summary["reactions"])
    assert close(held + pulled, np.tile([0, 0, 0.4], (2, 1)), 1e-6)


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


def test_pictures_show_every_node_of_the_surface():
    found = fields_of(solved(reference=False, **P2))
    surface = outer_surface(found, np.arange(len(found.cells)))
    nodes, triangles = np.asarray(surface.points), surface.regular_faces
    extent = np.ptp(nodes, axis=0)
    quarters = area_vectors(nodes, triangles)
    assert np.linalg.norm(quarters, axis=1).sum() == pytest.approx(2 * (extent.prod() / extent).sum())
    assert len(triangles) % 4 == 0 and (np.einsum("ij,ij->i", nodes[triangles].mean(axis=1) - nodes.mean(axis=0), quarters) > 0).all()
    assert {tuple(p) for p in nodes.round(9)} >= {tuple(p) for p in found.nodes[found.nodes[:, 0] == found.nodes[:, 0].min()].round(9)}
    shape, = deformed(found, {}).surfaces
    assert np.isfinite(shape["colour"]).all() and len(shape.regular_faces) == len(triangles)


# --- contact ----------------------------------------------------------------------------------------------

SMALL = {"two blocks": {"mesh": {"box": {"size": [1, 1, 1], "cells": [3, 3, 4]}}, "subdomains": {"grid": [1, 1, 2]}},
         "four blocks": {"mesh": {"box": {"size": [1, 1, 1], "cells": [4, 2, 4]}}, "subdomains": {"grid": [2, 1, 2]}}}


@pytest.mark.parametrize("name, friction", [late("two blocks", 0.0), ("two blocks", 0.3), late("four blocks", 0.2)])
def test_monolithic_contact_agrees(name, friction):
    """Pressed, sheared, let go: the independent formulation, cold and from our solution.

    The interface between the four blocks' upper and lower halves meets the moved top: corners there are prescribed.
    """
    assert_agrees(contact(friction, **SMALL[name], **P2), loose=False)


def test_contact_beside_perfect_interfaces():
    """Two layers of two glued blocks each: nodes amid edges lie on perfect interfaces too."""
    laws = [{"law": "perfect"}, {"between": ["block *-0", "block *-1"], "law": "contact", "friction": 0.3}]
    made = contact(law=laws, **SMALL["four blocks"], **P2)
    found = converged(made)
    for t, step in enumerate(monolithic(found).solve()):
        assert step.converged
        apart = max(np.abs(u[t] - v).max() for u, v in zip(found.parts, step.parts))
        assert apart <= 1e-6 * max(np.abs(v).max() for v in step.parts)


def test_patch_of_constant_pressure(tmp_path):
    """An irregular contact under a uniform pressure: the exact displacement, every corner its area's share."""
    rollers = [{**entry, "on": name} for entry, name in zip(ROLLERS, ("x", "y", "bottom"))]
    made = contact(0.1, mesh=written(tmp_path / "boxes.msh", two_boxes(0.35)), subdomains="groups", **P2,
                   boundary=[*rollers, {"on": "top", "pressure": 50.0}])
    found = converged(made)
    assert contacts(found).pressure == pytest.approx(50.0, rel=1e-7)
    for s, u in zip(found.scene.subdomains, found.parts):
        exact = found.scene.mesh.nodes[s.nodes] * np.array([0.3, 0.3, -1.0]) * 50 / YOUNG
        assert u[0] == pytest.approx(exact, abs=1e-8 * 50 / YOUNG)


@pytest.mark.long
def test_patch_of_linear_pressure(tmp_path):
    """ν = 0, an irregular contact under p = 100 + 40 x: which is found to .2 % on the mean, its resultant exactly."""
    made = contact(0.0, poisson=0.0, mesh=written(tmp_path / "boxes.msh", two_boxes(0.35)), subdomains="groups", **P2,
                   boundary=[{"on": name, "displacement": [0.0, 0.0, 0.0]} for name in ("bottom", "top")])
    scene = build_scene(made)
    x, _, z = scene.mesh.nodes.T
    z = z - 0.5  # the contact stays plane: u_x = 20 z²/E and no more
    exact = np.stack([20 * z**2, 0 * x, -(100 + 40 * x) * z], axis=1) / YOUNG
    scene.prescribed[:] = np.where(scene.fixed, exact, 0.0)
    for s in scene.subdomains:
        s.prescribed[:] = scene.prescribed[:, s.nodes]
    found = solve(made, scene)
    assert found.converged
    for s, u in zip(scene.subdomains, found.parts):
        assert np.abs(u[0] - exact[s.nodes]).max() < 3e-3 * np.abs(exact).max()
    (interface,), fields = scene.interfaces, found.interfaces
    off, area = fields.pressure[0] - (100 + 40 * scene.points(interface)[interface.shown, 0]), fields.area
    assert np.sqrt(area @ off**2 / area.sum()) < 0.003 * 100 and abs(area @ off) < 1e-6 * 100


def test_press_fit():
    """ν = 0, both ends held, pressed into each other by δ: p = E δ / L."""
    found = converged(contact(0.2, gap=-0.001, poisson=0.0, **SMALL["two blocks"], **P2,
                              boundary=[BOTTOM, {"on": TOP, "displacement": [0, 0, 0]}]))
    assert found.interfaces.pressure == pytest.approx(YOUNG * 0.001, rel=1e-7)


def test_an_imposed_jump_is_one_everywhere():
    """A rigid offset between two blocks, one of them free to follow: no stress, mid-edge nodes included."""
    found = solved(reference=False, mesh={"box": {"size": [2, 1, 1], "cells": [4, 2, 2]}},
                   subdomains={"grid": [2, 1, 1]}, boundary=[CLAMP], interfaces=[{"law": "jump", "jump": [0.01, 0.02, -0.01]}], **P2,
                   **method(tolerance={"error": 1e-9}))
    assert found.converged
    assert close(found.sides[1], np.broadcast_to([0.01, 0.02, -0.01], found.sides[1].shape), 1e-7)
    assert np.abs(found.sides[0]).max() < 1e-9


@pytest.mark.long
def test_contact_in_batches_of_load_steps():
    """What is prescribed beside points goes with its load step."""
    together = converged(contact(0.2, **SMALL["four blocks"], **P2, error=1e-9))
    one_by_one = converged(contact(0.2, **SMALL["four blocks"], **P2, method={
        "tolerance": {"law": 1e-9}, "max_iterations": 1000, "increment": 1}))
    assert close(one_by_one.displacement, together.displacement, 1e-6)
