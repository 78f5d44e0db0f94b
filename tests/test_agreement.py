"""What is prescribed agrees, in whatever directions, across jumps, round circuits of them and on both sides of interfaces, or is
refused."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS

from orchestrator import build_scene, config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.conditions.agreement import residual

HELD = [0, 0, 0]
FRAME = {"axis": "z", "at": [-1, -1, 0]}
LOW, LEFT, WALL = ({"on": on, "displacement": row} for on, row in (("zmin", [None, None, 0]), ("xmin", [0, None, None]), ("a/xmin", HELD)))
FINE = {"b": 3}  # cells of b along each edge: nodes that do not match
STEPS = {"histories": {"h": [0.0, 1.0]}}
TWIST, HINGE = ({"motion": {"rotate": {"axis": axis, "degrees": 0.1, "about": about}}}
                for axis, about in (("z", HELD), ("y", [2.0, 0.3, 0.0])))


def box(*boundary, **changes) -> dict:
    return {"name": "box", "mesh": {"box": {"size": [2, 1, 1], "cells": [4, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
            "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": list(boundary), "blackbox": IN_PROCESS, **changes}


def blocks(names, laws, *boundary, cells=None, **changes) -> dict:
    """Cubes that touch: a beside b, and below them c and d."""
    places = dict(zip("abcd", ([0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0])))
    made = box(*boundary, subdomains={"groups": True}, interfaces=laws, **changes)
    del made["mesh"]
    return {**made, "parts": [boxed(n, cells=[(cells or {}).get(n, 2)] * 3, at=places[n]) for n in names]}


def turned(degrees, digits, *boundary) -> dict:
    """The box turned about z, and the hinge on its edge with coordinates of so many digits."""
    angle = np.deg2rad(degrees)
    matrix = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    axis, about = (np.round(matrix @ v, digits).tolist() for v in ([0, 1, 0], [2, 0.3, 0]))
    made = box({"on": "p/zmin", "symmetry": True}, {"on": "p/xmax", "motion": {"rotate": {"axis": axis, "degrees": 0.1, "about": about}}},
               {"on": "p/xmin", "displacement": HELD})
    mesh = made.pop("mesh")
    return {**made, "parts": [{"name": "p", "mesh": mesh, "move": {"rotate": {"axis": "z", "degrees": degrees}}}]}


def radial(on, value, **more) -> dict:
    return {"on": on, "displacement": [value, None, None], "frame": FRAME, **more}


def jump(a, b, by, **more) -> dict:
    return {"law": "jump", "between": [a, b], "jump": by, **more}


BOND, TOUCH, UP = {"law": "perfect"}, {"law": "contact"}, [0, 0, 0.01]
SOUND = {
    "a plane through the axis": box({"on": "xmin", "displacement": HELD}, radial("xmax", 0.0), LOW),
    "two of three directions": box(LOW, LEFT, {"on": "ymin", "displacement": [None, 0.01, None]}, radial("xmax", 0.02)),
    "the same in two entries": box(LOW, {"on": "xmin", "displacement": [None, 0, None]}, radial("xmax", 0.01), radial("ymax", 0.01)),
    "a jump that both sides make": blocks("ab", [jump("a", "b", UP)], WALL, {"on": "a/zmin", "displacement": [None, None, 0]},
                                          {"on": "b/zmin", "displacement": [None, None, 0.01]}),
    "a jump along what is free": blocks("ab", [jump("a", "b", [0.01, 0, 0])], WALL, {"on": "*/zmin", "displacement": [None, None, 0]}),
    "a cut that goes through": blocks("abcd", [BOND, jump("a", "b", UP), jump("c", "d", UP)], WALL),
    "a circuit that closes": blocks("abcd", [BOND, jump("a", "b", UP), jump("b", "d", [0.01, 0, 0]), jump("c", "d", UP),
                                             jump("a", "c", [0.01, 0, 0])], WALL),
    "jumps beside what opens": blocks("abcd", [TOUCH, jump("a", "b", UP), jump("c", "d", [0, 0, 0.02])], WALL,
                                      {"on": "c/xmin", "displacement": HELD}),
    "one turn of both sides": blocks("ab", [BOND], {"on": "a/ymin", **TWIST}, {"on": "b/ymin", **TWIST}, cells=FINE),
    "a jump of unlike meshes": blocks("ab", [jump("a", "b", UP)], WALL, {"on": "*/ymin", "displacement": [None, 0, None]}, cells=FINE),
    "sides that part": blocks("ab", [TOUCH], {"on": "a/ymin", "displacement": HELD}, {"on": "b/ymin", "displacement": [0.01, 0, 0]}),
    "sides that slide": blocks("ab", [TOUCH], {"on": "a/ymin", "displacement": HELD}, {"on": "b/ymin", "displacement": UP}, cells=FINE),
    "a press fit of nearly a tenth": blocks("ab", [{**TOUCH, "gap": -0.099}], WALL, {"on": "b/xmax", "displacement": HELD}),
    "one in thin plates, edge on edge": {**blocks("ab", [{**TOUCH, "gap": -0.04}], WALL), "parts": [
        boxed(name, [1, 1, 0.1], cells=[2, 2, 1], at=[x, 0, 0]) for x, name in enumerate("ab")]},
    "a hinge in a plane": box({"on": "zmin", "symmetry": True}, {"on": "xmin", "displacement": HELD}, {"on": "xmax", **HINGE}),
    "a turned hinge": turned(37, 15), "a hinge of six digits": turned(37, 6), "a hinge far away": turned(211.3, 9),
}
REFUSED = {  # and the entries that are named
    "an edge held otherwise": (box(radial("xmax", 0.1), {"on": "zmin", "displacement": HELD}), "boundary[0] and boundary[1]"),
    "two directions give the third": (box({"on": "zmin", "displacement": [0, 0, None]}, {"on": "xmin", "displacement": HELD},
                                          {"on": "xmax", "displacement": [None, 0.02, None], "frame": FRAME}),
                                          "boundary[0] and boundary[2]"),
    "one frame, two values": (box({"on": "xmin", "displacement": HELD}, radial("xmax", 0.01), radial("ymax", 0.02)),
                              "boundary[1] and boundary[2]"),
    "from the second step on": (box({"on": "xmin", "displacement": HELD}, {"on": "zmin", "displacement": [0, 0, None]},
                                    radial("xmax", 0.01, history="h"), **STEPS), "load step 2"),
    "three axes": (box(LEFT, radial("xmax", 0.01),
                       {"on": "ymax", "displacement": [None, 0.01, None], "frame": {"axis": "z", "at": [-3, -1, 0]}},
                       {"on": "zmax", "displacement": [0.05, None, None], "frame": {"axis": "z", "at": [-2, -7, 0]}}),
                       "boundary[1] and boundary[2] and boundary[3]"),
    "a coupled surface": (box({"on": "xmin", "displacement": HELD},
                              {"on": "xmax", "coupling": {"displacement": [0.01, 0, 0], "rotation": HELD}}, radial("zmin", 0.0),
                              subdomains={"groups": True}), "boundary[1] and boundary[2]"),
    "a jump held on both sides": (blocks("ab", [jump("a", "b", UP)], WALL, {"on": "*/zmin", "displacement": [None, None, 0]}),
                                  "the jump of interfaces[0]"),
    "a jump the other way": (blocks("ab", [jump("b", "a", UP)], WALL, {"on": "a/zmin", "displacement": [None, None, 0]},
                                    {"on": "b/zmin", "displacement": [None, None, 0.01]}), "boundary[1] and boundary[2], with the jump"),
    "a jump at the second step": (blocks("ab", [jump("a", "b", UP, history="h")], WALL, {"on": "*/zmin", "displacement": [None, None, 0]},
                                         **STEPS), "load step 2"),
    "a jump and a frame": (blocks("ab", [jump("a", "b", [0, 0.01, 0])], WALL, radial("*/zmin", 0.02)), "the jump of interfaces[0]"),
    "a jump that ends inside": (blocks("abcd", [BOND, jump("a", "b", UP)], WALL), "closed circuit"),
    "a circuit that stays open": (blocks("abcd", [BOND, jump("a", "b", UP), jump("c", "d", [0, 0, 0.02])], WALL),
                                  "interfaces[1] and interfaces[2]"),
    "unlike meshes, unlike values": (blocks("ab", [BOND], {"on": "a/ymin", "displacement": HELD},
                                            {"on": "b/ymin", "displacement": [0, 0.01, 0]}, cells=FINE), "law: perfect forbids, by 0.01"),
    "two turns": (blocks("ab", [BOND], {"on": "a/ymin", **TWIST}, {"on": "b/ymin", "displacement": HELD}, cells=FINE),
                  "boundary[0] and boundary[1]"),
    "a jump of unlike meshes": (blocks("ab", [jump("a", "b", UP)], WALL, {"on": "*/zmin", "displacement": [None, None, 0]}, cells=FINE),
                                "law: jump forbids"),
    "sides pressed into each other": (blocks("ab", [TOUCH], {"on": "a/ymin", "displacement": HELD},
                                             {"on": "b/ymin", "displacement": [-0.01, 0, 0]}), "law: contact forbids, by 0.01"),
    "and of unlike meshes": (blocks("ab", [TOUCH], {"on": "a/ymin", "displacement": HELD},
                                    {"on": "b/ymin", "displacement": [-0.01, 0, 0], "history": "h"}, cells=FINE, **STEPS), "load step 2"),
    "a press fit that is held": (blocks("ab", [{**TOUCH, "gap": -0.01}], {"on": "*/ymin", "displacement": HELD}), "law: contact forbids"),
    "a press fit in another unit": (blocks("ab", [{**TOUCH, "gap": -0.5}], WALL, {"on": "b/xmax", "displacement": HELD}),
                                    "which is 50% of what the thinner part measures there, 1"),
    "and of unlike meshes, at the second step": (blocks("ab", [{**TOUCH, "gap": -0.02, "history": "h"}], WALL, cells=FINE,
                                                        histories={"h": [1.0, 6.0]}), "an interference of 0.12 between"),
    "a hinge beside the plane": (box({"on": "zmin", "symmetry": True}, 
                                    {"on": "xmax", "motion": {"rotate": {"axis": "y", "degrees": 0.1, "about": [2.01, 0, 0]}}}),
                                    "uz = 0 and 1.7"),
}


@pytest.mark.parametrize("what", SOUND)
def test_what_agrees_is_accepted(what):
    build_scene(config_from(SOUND[what]))


@pytest.mark.parametrize("what", REFUSED)
def test_contradictions_are_told_with_their_entries(what):
    data, words = REFUSED[what]
    with pytest.raises(InputError) as caught:
        build_scene(config_from(data))
    [problem, *_] = [p for p in caught.value.problems if words in p.found] or [caught.value.problems[0]]
    assert problem.path[0] in ("boundary", "interfaces") and words in problem.found and problem.expected and problem.cure, str(problem)


def test_what_another_entry_moves_counts_along_a_direction():
    """u_r = 0.02 on a face of whose edge u_y = 0.01 is prescribed: u_x there is what is left."""
    solution = solve(config_from(box(LOW, LEFT, {"on": "ymin", "displacement": [None, 0.01, None]}, radial("xmax", 0.02))))
    x, u = solution.scene.mesh.nodes[:45], solution.displacement[0, :45]  # the ground's nodes come last
    face = x[:, 0] == 2.0
    r = (x[face] + [1, 1, 0]) * [1, 1, 0]
    assert solution.converged
    assert np.sum(u[face] * r, axis=1) / np.linalg.norm(r, axis=1) == pytest.approx(np.full(9, 0.02), abs=1e-7)
    assert u[x[:, 1] == 0, 1] == pytest.approx(np.full(15, 0.01), abs=1e-12)


def test_least_squares_of_groups_are_those_of_each():
    random = np.random.default_rng(5)
    group, e, g = random.integers(0, 4, 20), random.normal(size=(20, 3)), random.normal(size=(2, 20))
    e[group == 2] = e[group == 2][0]  # directions that are one
    each = residual(e, g, group)
    for one in range(4):
        own = group == one
        best = np.linalg.lstsq(e[own], g[:, own].T, rcond=1e-9)[0]
        assert each[:, own] == pytest.approx(g[:, own] - (e[own] @ best).T, abs=1e-12)
