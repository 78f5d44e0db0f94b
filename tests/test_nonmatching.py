"""The method where nodes do not match: as fast as where they do, and the solution of the same operators in one piece."""

import numpy as np
import pytest
from quick import late
from contact_case import PATH
from in_process import IN_PROCESS
from benchmarks.monolithic import Monolithic
from mortar_case import FOUR, TWO, blocks

from orchestrator.config.load import config_from
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.problems import assemblies

SLIDES = {"law": "contact", "friction": 0.3}


def boxes(bodies: dict, cells: tuple) -> dict:
    """Structured meshes, of so many cells in every direction."""
    return {name: {"box": {"size": list(map(float, size)), "cells": [n, n, max(1, round(n * size[2] / size[0]))]}}
            for (name, (size, _)), n in zip(bodies.items(), cells)}


def bonded(cells, **changes):
    """A short beam of two parts, bent and pulled."""
    return blocks(TWO, boxes(TWO, cells), turn=None, **changes,
                  held=[{"on": "a/zmin", "displacement": [0, 0, 0]}, {"on": "b/zmax", "traction": [10, 0, 50]}])


def pressed(bodies, cells, law, path=PATH, element="P1", error=1e-9, **method):
    """Pressed, sheared and let go."""
    low, top = ([{"on": f"{name}/{side}", "displacement": move} for name, (size, corner) in bodies.items()
                 if (corner[2] + size[2] * (side == "zmax")) == level]
                for side, level, move in (("zmin", 0, [0, 0, 0]), ("zmax", max(c[2] + s[2] for s, c in bodies.values()), path)))
    return blocks(bodies, boxes(bodies, cells), law=law, turn=None, element=element, held=low + top,
                  method={"tolerance": {"law": error}, "max_iterations": 300, **method})


def energy_norm(whole, u):
    """Of displacements (n, 3) of all nodes, each of which belongs to one part."""
    flat = np.concatenate([u[s.nodes].ravel() for s in whole.scene.subdomains])
    return float(np.sqrt(flat @ (whole.K @ flat)))


@pytest.mark.parametrize("cells", [(2, 6), (6, 2), (5, 6)])
@pytest.mark.long
def test_bonded_parts_take_as_many_stages_and_the_bound_holds(cells):
    """What is delivered has no jump; its distance from the solution of the same operators is bounded, closely."""
    scene = build_scene(bonded(cells))
    assert [i.mortar is None for i in scene.interfaces] == [False]
    whole = Monolithic(scene)
    exact, = whole.solve()
    u = np.zeros_like(scene.mesh.nodes)
    for s, part in zip(scene.subdomains, exact.parts):
        u[s.nodes] = part
    for stages in (1, 3, 6):
        solved = solve(bonded(cells, method={"tolerance": {"error": 1e-9}, "max_iterations": stages}), scene)
        error = energy_norm(whole, solved.displacement[0] - u) / energy_norm(whole, u)
        assert error < solved.error_bound < 2 * error, stages
        apart = whole.pairs.D @ np.concatenate([solved.displacement[0][s.nodes].ravel() for s in scene.subdomains])
        assert np.abs(apart).max() < 1e-12 * np.abs(u).max()
    tight = {"method": {"tolerance": {"error": 1e-6}}}
    alike = bonded((6, 6), **tight)
    assert solve(bonded(cells, **tight), scene).iterations <= 1.2 * solve(alike, build_scene(alike)).iterations


@pytest.mark.parametrize("bodies, cells, law, element", [
    late(TWO, (2, 6), {**SLIDES, "friction": 0.1}, "P1"), late(TWO, (6, 2), {**SLIDES, "friction": 0.0}, "P1"),
    late(TWO, (4, 5), {**SLIDES, "friction": 0.4}, "P1"), late(TWO, (4, 5), {**SLIDES, "gap": 0.002}, "P1"),
    late(TWO, (5, 4), {**SLIDES, "gap": -0.002}, "P1"), late(TWO, (2, 3), SLIDES, "P2"),
    (FOUR, (4, 3, 5, 4), {**SLIDES, "friction": 0.1}, "P1"),
], ids=["fine on coarse", "without friction", "much friction", "gap", "press fit", "ten nodes", "four round an edge"])
def test_contact_is_that_of_one_piece(bodies, cells, law, element):
    """Four load steps with reversal: every status, displacements and forces."""
    made = pressed(bodies, cells, law, element=element)
    scene = build_scene(made)
    assert all(i.mortar is not None for i in scene.interfaces)
    as_in_one_piece(made, scene)


def as_in_one_piece(made, scene):
    """Every load step has the statuses, displacements and forces of the solution without decomposition, which is returned."""
    solved = solve(made, scene)
    assert solved.converged, solved.stop_reason
    local = solved.iterated.local
    start = [([part[t] for part in solved.parts], local.force[t].T) for t in range(scene.steps)]
    for t, step in enumerate(Monolithic(scene).solve(start)):
        assert step.converged
        assert np.array_equal(local.status[t], step.status), t
        far, strong = max(np.abs(part).max() for part in step.parts), np.abs(step.force).max()
        assert max(np.abs(part[t] - theirs).max() for part, theirs in zip(solved.parts, step.parts)) < 1e-6 * far
        assert np.abs(local.force[t].T - step.force).max() <= 1e-6 * strong
    return solved


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.long
def test_a_bolt_in_its_bore_is_that_of_one_piece(friction, tmp_path):
    """Facets that are chords of other polygons about the same circle; turned and pulled there and back."""
    made = config_from({**assemblies.bolt_in_bore(tmp_path, (0.6, 0.8), friction), "blackbox": IN_PROCESS,
                        "method": {"tolerance": {"error": 1e-8}}})
    scene = build_scene(made)
    assert [i.mortar is not None for i in scene.interfaces] == [True]
    assert {0, 2} <= set(as_in_one_piece(made, scene).iterated.local.status.ravel())
