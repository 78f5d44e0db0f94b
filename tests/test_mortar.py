"""Interfaces whose sides are meshed each on its own: the operators, and fields that must pass through them unchanged."""


import numpy as np
import pytest
from quick import quick
from benchmarks.monolithic import Monolithic
from in_process import IN_PROCESS
from mortar_case import POISSON, TURN, TWO, YOUNG, blocks, free_mesh, there

from orchestrator.errors import InputError
from orchestrator import config_from
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.interfaces.mortar.operators import make_mortar
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.opposite import Triangles

# --- two surfaces ---------------------------------------------------------------------------------------------


def square(n, seed, turned=False):
    """A unit square of 2 n² triangles, inner nodes moved about: nodes (m, 3) and triangles, upwards or downwards."""
    x = np.linspace(0, 1, n + 1)
    p = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((n + 1, n + 1))], axis=-1).reshape(-1, 3)
    inner = ((p[:, :2] > 0) & (p[:, :2] < 1)).all(axis=1)
    p[inner, :2] += np.random.default_rng(seed).uniform(-0.25, 0.25, (inner.sum(), 2)) / n
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    t = np.concatenate([np.c_[a, a + n + 1, a + n + 2], np.c_[a, a + n + 2, a + 1]])
    return p, t[:, [0, 2, 1]] if turned else t


def curved(p):
    """On a surface that bends both ways."""
    return np.c_[p[:, :2], 0.15 * p[:, 0] ** 2 - 0.1 * p[:, 0] * p[:, 1]]


def surfaces(n, m, shape=lambda p: p, seeds=(1, 2), move=(0, 0, 0), reach=0.5) -> Surfaces:
    """Two squares, far from the origin and turned."""
    (p, t), (q, s) = square(n, seeds[0]), square(m, seeds[1], turned=True)
    x = there(np.vstack([shape(p), shape(q) + move]), TURN) + [3, -2, 1]
    sides = t, s + len(p)
    room = np.full(len(t), reach / n)
    return Surfaces.of(x, sides, tuple(np.arange(len(side)) for side in sides),
                       find_segments(*(Triangles.of(x[side]) for side in sides), room))


def mortar_of(two: Surfaces, held=0, crossed=0):
    """Its operators; every so many of the slave's nodes prescribed in a component, or crossed by other interfaces."""
    free = tuple(np.ones((len(x), 3), bool) for x in two.points)
    cross = np.zeros(len(two.points[0]), bool)
    if held:
        free[0][::held, 1] = False
    if crossed:
        cross[1::crossed] = True
    return make_mortar(two, free, cross)


def test_overlaps_fill_the_square():
    """Whatever the two meshes: their overlaps have the area of what is common, each facet's those of the facet."""
    for n, m, move, area in ((10, 31, 0, 1), (31, 10, 0, 1), (12, 12, 0, 1), (9, 14, 0.3, 0.49)):
        two = surfaces(n, m, move=(move, move, 0))
        assert abs(two.segments.area.sum() - area) < 1e-14
        if not move:
            assert np.abs(np.bincount(two.segments.slave, two.segments.area) / two.area - 1).max() < 1e-12
        for side in (two.segments.on_slave, two.segments.on_master):
            assert side.min() > -1e-12 and np.abs(side.sum(axis=2) - 1).max() < 1e-12


@pytest.mark.parametrize("held, crossed", [(0, 0), (3, 0), (0, 4), (5, 4)])
@pytest.mark.parametrize("shape, move", [(lambda p: p, (0, 0, 0)), (lambda p: p, (0.3, 0.3, 0)), (curved, (0, 0, 0)),
                                         (curved, (0, 0, 0.02))], ids=["plane", "in part", "curved", "apart"])
def test_rigid_motions_open_nothing_and_moments_are_opposite(shape, move, held, crossed):
    for n, m in ((6, 17), (17, 6)):
        two = surfaces(n, m, shape, move=move)
        mortar, (x1, x2) = mortar_of(two, held, crossed), two.points
        rng = np.random.default_rng(5)
        for matrix, x in ((mortar.first, x1), (mortar.second, x2)):
            shift = np.tile(rng.standard_normal(3), len(x))
            assert np.abs(matrix @ shift - np.resize(shift, matrix.shape[0])).max() < 1e-12  # rows sum to 1
        spin = rng.standard_normal(3)
        jump = mortar.second @ np.cross(spin, x2).ravel() - mortar.first @ np.cross(spin, x1).ravel()
        assert np.abs(jump).max() < 1e-12 * np.abs(x1).max()
        q = rng.standard_normal(3 * len(mortar))
        f1, f2 = (mortar.first.T @ q).reshape(-1, 3), -(mortar.second.T @ q).reshape(-1, 3)
        assert np.abs(f1.sum(axis=0) + f2.sum(axis=0)).max() < 1e-12 * np.abs(f1).sum()
        moments = np.cross(x1, f1).sum(axis=0) + np.cross(x2, f2).sum(axis=0)
        assert np.abs(moments).max() < 1e-12 * np.abs(np.cross(x1, f1)).sum()
        assert mortar.area.min() > 0 and abs(mortar.area.sum() - two.segments.area.sum()) < (
            1e-3 if shape is curved else 1e-12)  # of bent faces what is seen along the normals
        if shape is not curved:
            linear = rng.standard_normal((3, 3))
            there_and_here = mortar.second @ (x2 @ linear).ravel() - mortar.first @ (x1 @ linear).ravel()
            assert np.abs(there_and_here).max() < 1e-12 * np.abs(x1 @ linear).max()
        assert np.abs(mortar.gap - (mortar.gap if shape is curved else move[2])).max() < 1e-12


def test_points_that_are_left_out():
    """No point where interfaces cross, where a node is prescribed altogether, where little is
    covered; their area goes to others."""
    two = surfaces(8, 13, move=(0.05, 0, 0))  # the last row of facets is covered by .6, its outer nodes by less
    mortar = mortar_of(two, held=3, crossed=4)
    count = len(two.points[0])
    gone = np.zeros(count, bool)
    gone[1::4] = True
    assert not gone[mortar.points].any()
    assert np.isin(np.flatnonzero(~gone)[::3][:9], mortar.points).all()  # held in one component
    assert abs(mortar.area.sum() - 0.95) < 1e-12 and mortar.live.all()
    free = tuple(np.ones((len(x), 3), bool) for x in two.points)
    free[0][::3] = False
    mortar = make_mortar(two, free, np.zeros(count, bool))
    assert not np.isin(np.arange(count)[::3], mortar.points).any()
    assert abs(mortar.area.sum() - 0.95) < 1e-12
    strip = surfaces(8, 13, move=(0.9, 0, 0))  # an eighth of a facet's width: nothing but rims
    assert 0 < len(mortar_of(strip)) and abs(mortar_of(strip).area.sum() - 0.1) < 1e-12


def test_a_slit_of_a_facet():
    """What is covered of a facet may be as narrow as rounding: no weight grows."""
    for width in (1e-3, 1e-6, 1e-9, 1e-13):
        two = surfaces(4, 4, move=(0.75 - width, 0, 0), seeds=(1, 1))
        mortar = mortar_of(two)
        assert abs(mortar.area.sum() - (0.25 + width)) < 1e-6 and np.abs(mortar.second.data).max() < 5
        assert np.abs(np.asarray(mortar.second.sum(axis=1)) - 1).max() < 1e-9


def test_a_slave_that_is_prescribed_altogether():
    """Of two sides the one with free nodes is the slave; where the user names the other, nothing would be left of the bond."""
    meshes = {n: {"box": {"size": [1, 1, 0.5], "cells": [c, c, 1]}} for n, c in (("a", 2), ("b", 3))}
    held = [{"on": "a/zmax", "displacement": [0, 0, 0]}, {"on": "a/zmin", "displacement": [0, 0, 0]}]
    (interface,) = build_scene(blocks(TWO, meshes, turn=None, held=held)).interfaces
    assert interface.subdomains == (1, 0) and len(interface.mortar) == 16
    with pytest.raises(InputError) as caught:
        build_scene(blocks(TWO, meshes, turn=None, held=held, law={"slave": "a"}))
    (wrong,) = caught.value.problems
    assert "no node of a" in wrong.found and "slave: b" in wrong.cure and wrong.path == ("interfaces", 0)


def test_a_slice_of_one_element_carries():
    """In plane strain every node of either side is held across: points have the other two
    components."""
    meshes = {n: {"box": {"size": [1, 1, 0.5], "cells": [c, 1, 1]}} for n, c in (("a", 2), ("b", 3))}
    held = [{"on": "a/zmin", "displacement": [None, 0, 0]}, {"on": "*/xmin", "symmetry": True},
            {"on": "b/zmax", "pressure": 100.0},
            *({"on": {"plane": "y", "at": y}, "displacement": [None, 0, None]} for y in (0.0, 1.0))]
    solved = solve(blocks(TWO, meshes, turn=None, held=held, method={"tolerance": {"error": 1e-9}}))
    (interface,) = solved.scene.interfaces
    live = interface.mortar.live
    assert len(live) == 6 and not live[:, 1].any() and live[:, 2].all()
    for s, u in zip(solved.scene.subdomains, solved.parts):
        exact = -100 * (1 - POISSON**2) / YOUNG * solved.scene.mesh.nodes[s.nodes][:, 2]
        assert solved.converged and np.abs(u[0, :, 2] - exact).max() < 1e-8 * np.abs(exact).max()


# --- fields that must pass ------------------------------------------------------------------------------------


def test_linear_stresses_pass_between_ten_node_tets():
    """Pure bending is a solution of the discrete equations: no jump, and forces of the stress on either side."""
    made = blocks(TWO, {"a": free_mesh([1, 1, 0.5], 0.5), "b": free_mesh([1, 1, 0.5], 0.3)}, turn=None, element="P2",
                  held=[{"on": "b/zmax", "displacement": [0, 0, 0]}])
    scene = build_scene(made)
    x, y, z = (scene.mesh.nodes - [0.5, 0.5, 0.5]).T
    exact = np.c_[-(z**2 + POISSON * (x**2 - y**2)) / 2, -POISSON * x * y, x * z]  # σ_zz = E x
    (interface,), parts = scene.interfaces, [exact[s.nodes] for s in scene.subdomains]
    mortar, whole = interface.mortar, Monolithic(scene)
    u1, u2 = (parts[e][own].ravel() for e, own in zip(interface.subdomains, interface.nodes))
    assert np.abs(mortar.second @ u2 - mortar.first @ u1).max() < 1e-12 * np.abs(exact).max()
    nodal = whole.K @ np.concatenate([u.ravel() for u in parts])
    pull = YOUNG * (scene.side_points(interface, 0)[mortar.points][:, 0] - 0.5) * mortar.normal[:, 2]
    q = (mortar.area[:, None] * pull[:, None] * [0, 0, 1]).ravel()
    for side, force in ((0, mortar.first.T @ q), (1, -(mortar.second.T @ q))):
        e, own, at = interface.subdomains[side], interface.nodes[side], scene.side_points(interface, side)
        inside = ((at[:, :2] > 1e-6) & (at[:, :2] < 1 - 1e-6)).all(axis=1)
        found = nodal[whole.offsets[e]:whole.offsets[e + 1]].reshape(-1, 3)[own]
        assert inside.sum() > 20 and np.abs(found - force.reshape(-1, 3))[inside].max() < 1e-10 * np.abs(found).max()


@pytest.mark.parametrize("young", [YOUNG, YOUNG / 1000], ids=["alike", "1:1000"])
@pytest.mark.long
def test_sizes_and_moduli_that_differ_cost_no_iterations(young):
    """Slices of sizes 1:3, and of moduli 1:1000, against matching ones of the finer size."""
    bodies = {f"s{i}": ([0.5, 1, 1], [0.5 * i, 0, 0]) for i in range(4)}
    fine, coarse = ({"box": {"size": [0.5, 1, 1], "cells": cells}} for cells in ([3, 6, 6], [1, 2, 2]))
    counts = []
    for other in (fine, coarse):
        made = blocks(bodies, {name: (fine, other)[i % 2] for i, name in enumerate(bodies)}, turn=None,
                      held=[{"on": "s0/xmin", "displacement": [0, 0, 0]}, {"on": "s3/xmax", "traction": [3, 1, 2]}],
                      materials=[{"young": YOUNG, "poisson": POISSON}, {"young": young, "poisson": POISSON, "on": ["s0", "s2"]}],
                      method={"tolerance": {"error": 1e-6}})
        scene = build_scene(made)
        assert all((i.mortar is None) == (other is fine) for i in scene.interfaces)
        slaves = {scene.subdomains[i.subdomains[0]].name for i in scene.interfaces if i.mortar is not None}
        assert slaves <= ({"s1", "s3"} if young == YOUNG else {"s0", "s2"}), "the coarser, but the softer before it"
        solved = solve(made, scene)
        assert solved.converged
        counts.append(solved.summary["iterations"])
    assert counts[1] <= 1.2 * counts[0], counts


@pytest.mark.parametrize("error", quick([1e-2, 1e-3], 1e-2))
def test_the_bound_holds_where_soft_fields_of_a_body_come_late(error):
    """Conjugate gradients that seem to have reached the forces' energy told .93 and .87 of the error."""
    def part(name, size, cells, at, degrees, **more):
        return {"name": name, "mesh": {"box": {"size": size, "cells": cells}},
                "move": {"rotate": {"axis": "y", "degrees": degrees}, "translate": at}, **more}

    solved = solve(config_from({
        "name": "contrast", "subdomains": "groups", "histories": {"h": [0.4, 1.0]},
        "materials": [{"young": 200e3, "poisson": 0.0}, {"young": 200e6, "poisson": 0.3, "on": "a"}],
        "parts": [part("a", [2, 2, 3], [2, 2, 3], [0, 0, 0], 0),
                  part("b", [1, 3, 3], [1, 3, 3], [0, 0, 3], 180),
                  part("c", [1, 1, 1], [1, 1, 1], [-0.5, 0, 4], 90, material={"young": 20e3, "poisson": 0.45})],
        "boundary": [{"on": "a/ymin", "displacement": [0, 0, 0]}, {"on": "a/ymax", "traction": [400, -100, 60], "history": "h"},
                     {"on": "c/zmin", "displacement": [1e-3, -5e-4, 0], "history": "h"}],
        "loads": [{"body_force": [0, -20, -10], "history": "h"}],
        "interfaces": [{"between": ["a", "b"], "law": "perfect"}, {"between": ["b", "c"], "law": "perfect"}],
        "method": {"tolerance": {"error": error}}, "blackbox": {**IN_PROCESS, "element": "P2"}}), reference=True)
    assert solved.converged and solved.summary["true_error"] <= solved.error_bound
