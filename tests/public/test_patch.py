"""Constant pressure and rigid motions on faces that are bent, held in part, round, or six-node."""

from itertools import product

import numpy as np
import pytest
from helpers import HELD, STEEL, box, bricks, groove, on, rollers, solved, stopped, written

PRESSURE = 500.0
SMOOTH = {"law": "contact", "friction": 0.0}
P1, P2 = ({"element": element, "workers": 1} for element in ("P1", "P2"))


@pytest.mark.parametrize("grains, h, code", [(5, 0.4, P1), pytest.param(3, 0.6, P2, marks=pytest.mark.long)],
                         ids=["P1", "P2"])
def test_grains_with_bent_faces_under_constant_pressure(grains, h, code):
    """Forces of a pressure are along the area vectors of the faces around a node, pair by pair."""
    squeezed = [{"on": f"{axis}max", "pressure": PRESSURE} for axis in "xyz"]
    mesh = {"polycrystal": {"grains": grains, "size": 1.0, "h": h, "seed": 298}}
    found = solved({"name": "grains", "mesh": mesh, "subdomains": "groups", "materials": [STEEL],
                    "interfaces": [SMOOTH], "boundary": [*rollers("x", "y", "z"), *squeezed],
                    "blackbox": code, "method": {"tolerance": {"error": 3e-11}}})
    strain = -PRESSURE / STEEL["young"] * (1 - 2 * STEEL["poisson"])
    for body, moved in zip(found.scene.subdomains, found.parts):
        exact = strain * found.scene.mesh.nodes[body.nodes]
        assert np.abs(moved[0] - exact).max() <= 1e-9 * abs(strain)
    faces = found.interfaces
    assert faces.pressure[faces.areas > 0] == pytest.approx(PRESSURE)


def all_quarters(body):
    """Return the body that a quarter between the planes x = 0 and y = 0 is of."""
    nodes, tets = body
    signs = [np.array([a, b, 1]) for a, b in product((1, -1), repeat=2)]
    every = np.concatenate([nodes * sign for sign in signs])
    _, first, place = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    sides = [(tets if sign.prod() > 0 else tets[:, [1, 0, 2, 3]]) + k * len(nodes)
             for k, sign in enumerate(signs)]
    return every[first], place.reshape(-1)[np.concatenate(sides)]


def domed(nodes):
    """Bend the lower face of a block, most in its middle."""
    x, y, z = nodes.T
    return np.c_[x, y, z + 0.2 * (x**2 + y**2) * (0.6 - z) / 0.6]


def raised(nodes):
    """Bend the upper face of a block up in its middle."""
    x, y, z = (nodes - [0, 0, 0.5]).T
    return np.c_[x, y, z - 0.1 * (x**2 + y**2) * (0.5 + z) / 0.5]


def pressed(tmp_path, lower, upper, pushed, whole, **more):
    """Return a body pressed on another by what its upper face is moved by; a quarter, with planes of
    symmetry, or the whole."""
    top, low = upper[0][:, 2].max(), lower[0][:, 2].min()
    lower, upper = map(all_quarters, (lower, upper)) if whole else (lower, upper)
    return solved({"name": "pressed", "mesh": written(tmp_path / "d.msh", block=lower, dome=upper),
                   "subdomains": "groups", "materials": [STEEL],
                   "boundary": [{"on": on("z", low), "displacement": HELD},
                                {"on": on("z", top), "displacement": pushed},
                                *([] if whole else rollers("x", "y"))],
                   "method": {"tolerance": {"error": 1e-9}, "max_iterations": 200}, **more})


def dome(tmp_path, counts, code, friction, whole):
    """Return a dome pressed on a block, or, of ten-node tets, a block on a dome."""
    shapes = (raised, np.asarray) if code is P2 else (lambda x: x - [0, 0, 0.5], domed)
    lower = bricks([1, 1, 0.5], [counts[0]] * 2 + [1], shapes[0])
    upper = bricks([0.8, 0.8, 0.6], [counts[1]] * 2 + [1], shapes[1])
    contact = {"between": ["dome", "block"], "law": "contact", "friction": friction,
               "gap": "geometry", "within": 0.3}
    return pressed(tmp_path, lower, upper, [[0, 0, -0.01], [0, 0, -0.02]], whole,
                   interfaces=[contact], blackbox=code)


@pytest.mark.parametrize("counts, code, friction",
                         [((3, 2), P1, 0.3), ((2, 3), P2, 0.0)],
                         ids=["P1 with friction", "P2"])
def test_a_quarter_is_the_whole(counts, code, friction, tmp_path):
    """Slave nodes on planes of symmetry carry their laws in the components that are free."""
    quarter, whole = (dome(tmp_path, counts, code, friction, part).interfaces
                      for part in (False, True))
    force, own = (x.resultant.sum(axis=1)[:, 2] for x in (whole, quarter))
    assert own == pytest.approx(force / 4, rel=1e-7)
    peak, seen = (x.pressure.max(axis=1) for x in (whole, quarter))
    assert seen == pytest.approx(peak, rel=1e-7)


BONDED = {"law": "perfect"}
JOINED = {"bonded": (BONDED, P2, 0.0), "bonded, P1, over a gap": (BONDED, P1, 0.02),
          "jump": ({"law": "jump", "jump": [0, 0, 0.003]}, P2, 0.0),
          "elastic": ({"law": "elastic", "stiffness_n": 1e6, "stiffness_t": 4e5}, P2, 0.0)}


@pytest.mark.parametrize("law, code, gap", JOINED.values(), ids=JOINED)
def test_a_quarter_of_bodies_joined_apart_is_the_whole(law, code, gap, tmp_path):
    """Points on planes of symmetry have the components that are free, beside others that have all;
    some hand on theirs, as little of the slave is covered there."""
    bodies = [bricks([x, y, h], [n, n, 1], lambda nodes, z=z: nodes + [0, 0, z])
              for x, y, h, n, z in ((1, 1, 0.5, 3, -0.5), (0.9, 0.8, 0.6, 2, gap))]
    joint = {"between": ["block", "dome"], "slave": "block", "tolerance": 0.1, **law}
    quarter, whole = (pressed(tmp_path, *bodies, [0, 0, -0.01], part,
                              interfaces=[joint], blackbox=code) for part in (False, True))
    assert 4 * quarter.reactions[:2, :, 2] == pytest.approx(whole.reactions[:2, :, 2], rel=1e-8)
    if law is not BONDED:
        peak, seen = (x.interfaces.pressure.max(axis=1) for x in (whole, quarter))
        assert seen == pytest.approx(peak, rel=1e-8)


def bowed(nodes):
    """Lift a block's nodes by what its mating face is curved, less the farther away."""
    x, y, z = nodes.T
    return np.c_[x, y, z + 0.15 * (1 - x**2 - 0.5 * y**2) * (1 - 2 * np.abs(z))]


@pytest.mark.parametrize("code", [P1, P2], ids=["P1", "P2"])
def test_a_quarter_of_curved_bonded_bodies_is_the_whole(code, tmp_path):
    """Nodes on planes of symmetry are fitted within these; couples across are no imbalance."""
    bodies = [bricks([1, 1, 0.5], [n, n, 1], lambda x, z=z: bowed(x + [0, 0, z]))
              for n, z in ((3, -0.5), (2, 0.0))]
    joint = {"between": ["block", "dome"], **BONDED}
    quarter, whole = (pressed(tmp_path, *bodies, [0, 0, -0.01], part,
                              interfaces=[joint], blackbox=code) for part in (False, True))
    assert 4 * quarter.reactions[:2, :, 2] == pytest.approx(whole.reactions[:2, :, 2], rel=1e-5)


@pytest.mark.parametrize("code, held", [(P1, HELD), (P2, [None, 0, 0])],
                         ids=["P1, altogether", "P2, in part"])
def test_supports_on_contact_faces_leave_constant_pressure_as_it_is(code, held):
    """A third of the slave's face is held, where uniform strain leaves it."""
    third = {"box": [[-0.01, -0.01, 0.99], [0.34, 1.01, 1.01]]}
    bodies = [box("low", [1, 1, 1], (2, 2, 2)), box("high", [1, 1, 1], (3, 3, 2), [0, 0, 1])]
    pressed = [{"on": face, "pressure": PRESSURE} for face in ("low/zmin", "high/zmax")]
    found = solved({"name": "held", "parts": bodies, "subdomains": "groups", "blackbox": code,
                    "materials": [{"young": STEEL["young"], "poisson": 0.0}],
                    "interfaces": [{"between": ["low", "high"], **SMOOTH, "slave": "high"}],
                    "boundary": [{"on": third, "part": "high", "displacement": held},
                                 *rollers("x", "y"), *pressed],
                    "method": {"tolerance": {"law": 1e-8}}})
    strain = PRESSURE / STEEL["young"]
    for body, moved in zip(found.scene.subdomains, found.parts):
        exact = -strain * (found.scene.mesh.nodes[body.nodes][:, 2] - 1)
        assert np.abs(moved[0, :, 2] - exact).max() < 1e-8 * strain


@pytest.mark.parametrize("lower", [pytest.param((3, 3, 1), marks=pytest.mark.long), (4, 3, 1)],
                         ids=["coarse", "in between"])
def test_a_body_of_ten_node_tets_stands_on_its_edge(lower):
    """What presses .06 from the edge of a face is carried, although meshes are apart."""
    bodies = [box("base", [1.2, 1.0, 0.3], lower), box("cap", [1.2, 1.0, 0.3], (5, 5, 1), [0, 0, 0.3])]
    pushed = {"kind": "distributed", "about": [1.14, 0.5, 0.6], "force": [0, 0, -100.0]}
    found = solved({"name": "edge", "parts": bodies, "subdomains": "groups", "blackbox": P2,
                    "materials": [STEEL], "interfaces": [{"law": "contact", "friction": 0.5}],
                    "boundary": [{"on": "base/zmin", "displacement": HELD},
                                 {"on": "cap/zmax", "coupling": pushed}],
                    "method": {"tolerance": {"error": 1e-3}}})
    assert found.interfaces.resultant[0, 0] == pytest.approx([0, 0, -100], abs=1e-3)


def tube(radii, heights, around, seed):
    """Return a ring of bricks between two radii and heights, its nodes unevenly ``around``."""
    even = np.linspace(0, 1, around + 1)
    turns = even.copy()
    turns[1:-1] += np.random.default_rng(seed).uniform(-0.3, 0.3, around - 1) / around

    def bent(x):
        angle = 2 * np.pi * np.interp(x[:, 1], even, turns)
        r, z = (np.interp(x[:, k], [0, 1], ends) for k, ends in ((0, radii), (2, heights)))
        return np.c_[r * np.cos(angle), r * np.sin(angle), z]

    nodes, tets = bricks([1, 1, 1], [1, around, 3], bent)
    _, first, place = np.unique(nodes.round(9), axis=0, return_index=True, return_inverse=True)
    return nodes[first], place.reshape(-1)[tets]


@pytest.mark.parametrize("around, code", [((12, 15), P1), ((12, 12), P2)], ids=["P1 apart", "P2"])
def test_round_fits_without_friction_carry_no_torque(around, code, tmp_path):
    """Normals are the round surface's where a point takes its mean: chords do not wedge."""
    shaft, hub = tube([1, 2], [-1, 2], around[0], 1), tube([2, 3], [0, 3], around[1], around[1] - 11)
    mesh = written(tmp_path / "fit.msh", shaft=shaft, hub=hub)
    torque = {"force": [0, 0, 0], "moment": [0, 0, 1], "about": [0, 0, 3]}
    found = stopped({"name": "fit", "mesh": mesh, "subdomains": "groups", "blackbox": code,
                     "materials": [STEEL], "histories": {"torque": [0.0, 1.0]},
                     "interfaces": [{"between": ["hub", "shaft"], **SMOOTH, "gap": -0.002}],
                     "boundary": [{"on": on("z", -1), "displacement": HELD},
                                  {"on": on("z", 3), "resultant": torque, "history": "torque"}],
                     "method": {"tolerance": {"error": 1e-6}}})
    assert found.summary["stop_reason"] == "limit load" and not found.converged


def test_a_groove_between_faces_turns_freely(tmp_path):
    """Coarse facets hide where a torus ends and a cylinder begins; each has its own normals."""
    turned = {"rotate": {"axis": "z", "degrees": 0.1, "about": [0, 0, 0]}}
    bore = {"box": [[-0.1, -0.1, -0.1], [5.1, 5.1, 14.1]]}
    found = solved({"name": "groove", "subdomains": "groups", "materials": [STEEL],
                    "parts": groove(tmp_path, bore=5),
                    "interfaces": [{"between": ["hub", "shaft"], **SMOOTH, "gap": -0.02}],
                    "boundary": [{"on": bore, "part": "shaft", "displacement": HELD},
                                 {"on": on("z", 14), "part": "hub", "motion": turned}],
                    "blackbox": P2, "method": {"tolerance": {"error": 1e-4}}})
    torque = found.summary["reaction_moments"]["moments"][1][0][2]
    faces = found.interfaces
    assert abs(torque) < 1e-6 * 12 * (faces.pressure * faces.areas).sum()
