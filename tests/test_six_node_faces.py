"""Contact on six-node faces: what a point sees of them, the stiffness of what they carry, and that iterations end."""

import sys
from pathlib import Path

import numpy as np
import pytest
from in_process import IN_PROCESS

from orchestrator import build_scene, config_from, solve
from orchestrator.scene.mesh.geometry import area_vectors, mirrored, node_normals

sys.path.append(str(Path(__file__).parents[1] / "meshes"))
from hertz import LENGTH, RADIUS, cylinder_on_block, write

SIX = {**IN_PROCESS, "element": "P2"}


def patch(n=4, at=lambda x, y: (x, y, 0 * x)):
    """Nodes (m, 3) and six-node triangles of a unit square, as ``at`` bends it between its corners."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij"))
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    corners = np.concatenate([np.c_[a, a + n + 1, a + n + 2], np.c_[a, a + n + 2, a + 1]])
    edges, middle = np.unique(np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    nodes = np.stack(at(x, y), axis=1)
    return np.vstack([nodes, nodes[edges].mean(axis=1)]), np.hstack([corners, len(nodes) + middle.reshape(-1, 3)])


def round_about(x, y):
    return np.sin(0.5 * x), y, np.cos(0.5 * x)


def cone(x, y):
    return (1 + 0.3 * y) * np.sin(0.5 * x), y, (1 + 0.3 * y) * np.cos(0.5 * x)


@pytest.mark.parametrize("shape, leans", [(round_about, False), (cone, True), (lambda x, y: (x, y, 0.3 * x), True)])
def test_normals_at_planes_of_symmetry(shape, leans):
    """Half a cylinder's rim has the whole one's normals; where a face runs into a support at an angle they stay what they are."""
    points, triangles = patch(4, shape)
    along = 1 if shape is cone else 0
    held = np.zeros_like(points, dtype=bool)
    held[np.abs(points[:, along]) < 1e-9, along] = True
    normals = node_normals(points, triangles)
    found = mirrored(normals, area_vectors(points, triangles), triangles, held)
    rim = np.flatnonzero(held[:, along])
    assert len(rim) == 9
    if leans:
        assert found == pytest.approx(normals, abs=1e-12) and (np.abs(normals[rim, along]) > 0.25).all()
    else:
        assert found[rim] == pytest.approx(np.tile([0, 0, 1], (len(rim), 1)), abs=1e-3) and (np.abs(normals[rim, 0]) > 0.03).all()


def test_gaps_are_those_of_the_surfaces(tmp_path):
    """A cylinder above a block: what points see is x²/2R; over chords it would be h²/8R more in the middle of them."""
    h = 0.04
    write(tmp_path / "hertz.msh", cylinder_on_block(h))
    made = config_from({
        "name": "gap", "mesh": {"file": str(tmp_path / "hertz.msh")}, "subdomains": "groups", "blackbox": SIX,
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "gap": "geometry", "within": 0.02}],
        "boundary": [{"on": {"plane": "z", "at": z}, "displacement": [0, 0, 0]} for z in (-LENGTH, LENGTH)]})
    scene = build_scene(made)
    interface, = scene.interfaces
    x, at = scene.points(interface)[:, 0], interface.mortar.points
    at = at[np.abs(x[at]) < 1.5 * h]  # where the mesh is even
    assert len(at) > 6 and interface.law.distance[at] == pytest.approx(x[at] ** 2 / (2 * RADIUS), abs=0.02 * h**2 / (8 * RADIUS))


def test_nodes_without_a_point_are_told_what_is_beside_them():
    """A slave that reaches beyond its master: nodes have the nearest point's, or a mean of what is
    beside them."""
    base, lid = ({"box": {"size": size, "cells": cells}} for size, cells in (([2, 1, 0.5], [5, 3, 1]), ([1, 1, 0.5], [3, 4, 1])))
    solved = solve(config_from({
        "name": "beyond", "parts": [
            {"name": "base", "mesh": base},
            {"name": "lid", "mesh": lid, "move": {"rotate": {"axis": "z", "degrees": 7}, "translate": [0.41, 0, 0.5]}}],
        "subdomains": "groups", "materials": [{"young": 1.0, "poisson": 0.3}], "blackbox": SIX,
        "interfaces": [{"between": "auto", "law": "contact", "friction": 0.3, "slave": "base"}],
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": "lid/zmax", "displacement": [1e-4, 0, -1e-3]}],
        "method": {"tolerance": {"law": 1e-6}}}))
    assert solved.converged
    fields = solved.interfaces
    bare = fields.area == 0
    there, beside = fields.pressure[0, ~bare], fields.pressure[0, bare]
    assert bare.any() and there.min() <= beside.min() and beside.max() <= there.max()
