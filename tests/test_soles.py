"""Soles: the matter glued to interfaces, its shape and the stiffness FreeFEM gives it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from method_case import CUBES, METIS, PULL, box_of, config, irregular, layered, method, prepared
from quick import quick

from orchestrator.blackbox.models import Matter, extended_model, sides_by_subdomain, sole_model
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.model import Material
from orchestrator.scene.soles.facets import THIN, WALL, Facets, between, facets_of, stiffer
from orchestrator.scene.soles.make import make_soles, prisms

YOUNG, POISSON = 200e3, 0.3
KINDS = ["layer", "symmetric"]


def settings(**changes):
    """The ``method.sole`` section of a configuration."""
    return SimpleNamespace(**{"kind": "layer", "modulus_ratio": 1.0, "thickness": "auto", "poisson": "auto", **changes})


def patch(cells=(3, 2), h=1.0, fold=180.0, thickness=1.0, seed=None):
    """Facets of a rectangle folded along its middle line x = 0, open by ``fold`` degrees on the side of +1."""
    nx, ny = cells
    x, y = np.meshgrid(np.arange(-nx, nx + 1) * h, np.arange(ny + 1) * h, indexing="ij")
    half = np.radians(fold) / 2
    points = np.stack([x * np.sin(half), y, np.abs(x) * np.cos(half)], -1).reshape(-1, 3)
    if seed is not None:
        points[:, :2] += np.random.default_rng(seed).uniform(-0.2, 0.2, (len(points), 2)) * h
    i, j = (a.ravel() for a in np.meshgrid(np.arange(2 * nx), np.arange(ny), indexing="ij"))
    a = i * (ny + 1) + j
    b = a + ny + 1
    triangles = np.r_[np.c_[a, b, b + 1], np.c_[a, b + 1, a + 1]]
    count = len(triangles)
    return Facets(points, triangles, np.full((count, 3), YOUNG), np.full(count, POISSON), np.full(len(points), thickness))


def volumes(facets, sole):
    return tet_volumes(np.vstack([facets.points, sole.points]), sole.cells)


def triangles_of(cells):
    """Faces of tets and how many tets have each."""
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    return np.unique(faces, axis=0, return_counts=True)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mesh", quick(["slices", "cubes", "irregular"], "irregular"))
def test_extended_stiffness_is_the_sum(tmp_path, mesh, kind):
    """K of the extended mesh = K_E + Σ NᵀkN on all free dofs of a subdomain (paper, section 3.2)."""
    changes = {"slices": {}, "cubes": CUBES,
               "irregular": {**METIS, "mesh": irregular(tmp_path / "box.meshb")} if mesh == "irregular" else {}}[mesh]
    made = config(**changes, **method(sole={"kind": kind}))
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        soles = make_soles(scene, made.method.sole)
        sides = sides_by_subdomain(scene)
        extended = [extended_model(scene, s, sides[s.index], soles) for s in scene.subdomains]
        naked = [extended_model(scene, s, [], soles) for s in scene.subdomains]
        with_soles, without = blackbox.stiffness(extended), blackbox.stiffness(naked)
    k = sp.csr_array(d.space.scatter @ d.stage.direction.k @ d.space.scatter.T)
    for s, part, trace, whole, own in zip(scene.subdomains, d.space.boundary, d.made.traces, with_soles, without):
        free = np.flatnonzero(~s.fixed.ravel())
        spread = sp.csr_array((np.ones(len(trace)), (np.searchsorted(free, trace), np.arange(len(trace)))),
                              shape=(len(free), len(trace)))
        expected = own[free][:, free] + spread @ k[part][:, part] @ spread.T
        assert abs(whole[free][:, free] - expected).max() <= 1e-12 * abs(expected).max()
        assert abs(expected - own[free][:, free]).max() > 0.01 * abs(expected).max()


def test_symmetric_soles_are_the_same_from_both_sides():
    """k_E = k_E' bit for bit on all trace dofs; a layer is not the same from the two sides, by more than 5 %."""
    for kind in KINDS:
        made = config(**METIS, **method(sole={"kind": kind}))
        scene = build_scene(made)
        with box_of(made) as blackbox:
            direction = prepared(made, scene, blackbox).stage.direction
        difference = abs(direction.k - direction.other)
        if kind == "symmetric":
            assert difference.max() == 0
        else:
            assert difference.max() > 0.05 * abs(direction.k).max()


@pytest.mark.parametrize("direction", [1, -1])
def test_neighbouring_prisms_agree_on_diagonals(direction):
    """The layer is a conforming mesh: its boundary is the two faces and the rim, two triangles per rim edge."""
    facets = patch(seed=2)
    sole = prisms(facets, direction)
    faces, count = triangles_of(sole.cells)
    edges = np.sort(facets.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rim = int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())
    assert count.max() == 2
    assert int((count == 1).sum()) == 2 * len(facets.triangles) + 2 * rim
    area = np.linalg.norm(facets.area_vectors, axis=1).sum()
    assert volumes(facets, sole).min() > 0
    assert volumes(facets, sole).sum() == pytest.approx(area * 1.0, rel=1e-14)
    outer = sole.points[:, 2]
    assert np.allclose(outer, direction, rtol=0, atol=1e-14), "outer face one thickness away, on the right side"


@pytest.mark.parametrize("fold, thickness", [(120, 2.0), (90, 1.0), (60, 0.5), (60, 5.0), (30, 1.0), (10, 5.0)])
def test_concave_creases_do_not_invert(fold, thickness):
    """Where prisms would invert the layer shrinks, or gets outer nodes of its own, but never turns over."""
    facets = patch(cells=(4, 4), fold=fold, thickness=thickness)
    for direction in (1, -1):
        sole = prisms(facets, direction)
        assert volumes(facets, sole).min() > 1e-4 * 0.5 * thickness / 3
        assert set(sole.cells[sole.cells >= len(facets.points)]) == {
            len(facets.points) + i for i in range(len(sole.points))}, "no outer vertex is an orphan"


def test_too_sharp_creases_get_outer_nodes_of_their_own():
    """Facets no shrinking can save stand on their own prism, at the wanted thickness and modulus."""
    facets = patch(cells=(4, 4), fold=10, thickness=5.0)
    sole = prisms(facets, 1)
    assert len(sole.points) > len(facets.points)
    prism_volume = volumes(facets, sole).reshape(-1, 3).sum(axis=1)
    area = np.linalg.norm(facets.area_vectors, axis=1)
    full = np.isclose(prism_volume, area * 5.0, rtol=1e-12)
    assert full.any() and np.all(sole.young.reshape(-1, 3)[full & (sole.young[::3] == YOUNG)] == YOUNG)


def test_modulus_is_the_ratio_times_the_larger_side(tmp_path):
    """E_S = ratio · max(E_E, E_E'), ν_S = min(ν, ν', 0.3), on both sides (method.sole's reasons)."""
    scene = build_scene(config(mesh=layered(tmp_path / "two.meshb", [0, 1]), subdomains="groups", materials=[
        {"young": 1.0, "poisson": 0.45}, {"young": 1000.0, "poisson": 0.25, "on": "*2"}]))
    facets = facets_of(scene, scene.interfaces[0], settings(modulus_ratio=0.5), "layer")
    assert np.all(facets.young == 500) and np.all(facets.poisson == 0.25)
    assert np.all(facets_of(scene, scene.interfaces[0], settings(poisson=0.1), "layer").poisson == 0.1)


def test_modulus_beside_contact_is_near_the_softer_side():
    """√E is the harmonic mean of √E₁ and √E₂: equal moduli bit for bit, four times the softer beside a rigid body."""
    assert np.array_equal(between(np.array([0.1, 70e3, 1 / 3]), np.array([0.1, 70e3, 1 / 3])), [0.1, 70e3, 1 / 3])
    assert np.allclose(between(np.array([100.0, 1.0]), np.array([1.0, 1e16])), [(2 / 1.1) ** 2, 4.0])


def test_a_spring_is_one_nodes_alone():
    """In a thin layer the stiffness at a node is that of the tets which stand above it."""
    facets = patch(thickness=THIN)
    each = 10.0 ** np.random.default_rng(3).integers(0, 3, len(facets.points))
    found = []
    for young in (np.full_like(facets.young, YOUNG), YOUNG * each[facets.triangles]):
        sole = prisms(replace(facets, young=young), +1)
        model = sole_model("sole", facets.points, sole, 0)
        found.append(Matter.of(model).stiffness().diagonal()[: 3 * len(each)].reshape(-1, 3))
    assert found[1] / found[0] == pytest.approx(np.repeat(each[:, None], 3, axis=1), rel=0.1)


@pytest.mark.parametrize("soft", [0, 1])
def test_beside_contact_the_softer_body_counts_node_by_node(soft):
    """A node that any stiff cell touches on both sides gets a stiff spring, though each facet has a soft side."""
    stiff, x = 1e3, 2.0
    scene = build_scene(config(mesh={"box": {"size": [4, 1, 1], "cells": [2, 2, 2]}}, subdomains={"grid": [1, 1, 2]},
                               interfaces=[{"law": "contact"}]))
    middle = scene.mesh.nodes[scene.mesh.cells[:, :4]].mean(axis=1)
    scene = replace(scene, materials=[Material(1.0, 0.3), Material(stiff, 0.3)],
                    cell_material=((middle[:, 0] > x) == (middle[:, 2] > 0.5)).astype(int))
    scene = replace(scene, subdomains=[replace(s, material=scene.cell_material[s.cells]) for s in scene.subdomains])
    interface, = scene.interfaces
    made = facets_of(scene, interface, settings(contact_ratio=1.0), "springs", soft)
    points, corner = made.points[made.triangles], made.young / made.young.min()
    at = np.isclose(points[..., 0], x)
    assert corner[at].min() > 100 and corner[~at].max() < 10


def test_springs_are_stiffer_where_interfaces_meet_and_beside_what_is_prescribed():
    """By the area of all interfaces of a body at a node; twice where one side alone yields. Uniform pressure between two
    blocks asks for springs in proportion to their areas: there nothing is changed."""
    contact = [{"law": "contact", "friction": 0.2}]
    two = build_scene(config(subdomains={"slices": {"axis": "x", "count": 2}}, interfaces=contact))
    assert (stiffer(two, two.interfaces[0], 0) == 1).all()
    clamp = {"on": {"box": [[-0.1, -0.1, -0.1], [0.1, 1.1, 2.1]]}, "displacement": [0, 0, 0]}  # half of the face
    many = build_scene(config(**CUBES, interfaces=contact, boundary=[clamp, PULL]))
    seen = 0
    for i in many.interfaces:
        x, factor = many.side_points(i, 0), stiffer(many, i, 0)
        assert factor == pytest.approx(stiffer(many, i, 1))
        met = sum(np.isclose(x[:, axis], 1.0) for axis in (1, 2)) + np.isclose(x[:, :1], [1, 2, 3]).any(axis=1)
        held = [many.subdomains[e].fixed[nodes].any(axis=1) for e, nodes in zip(i.subdomains, i.nodes)]
        wall = held[0] != held[1]
        seen += wall.sum()
        assert factor[(met == 1) & ~wall] == pytest.approx(1) and factor[(met == 1) & wall] == pytest.approx(WALL)
        assert (factor[(met == 2) & ~wall] > 1.2).all() and (factor[met == 3] > 1.5).all()
    assert seen == 6  # three nodes on the clamp's rim, of two interfaces
