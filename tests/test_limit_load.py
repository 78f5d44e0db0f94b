"""Limit loads: the cone problem beside closed forms and a linear program, and what runs make of it."""

import numpy as np
import pytest
from benchmarks.problems.limits import wedge
from boxes import boxed
from contact_case import BOTTOM, contact
from in_process import IN_PROCESS
from test_keeping import stopped_and_resumed
from scipy.optimize import linprog

from orchestrator.config.load import config_from
from orchestrator.laws.points import Carries
from orchestrator.method.stopping.carrying_points import Reach
from orchestrator.method.stopping.cone_problem import failing, unresisted
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.conditions.rigid import motions_about

CORNERS = np.array([[x, y, -0.5] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
UP = np.repeat(np.array([[0.0], [0.0], [1.0]]), 4, axis=1)


def standing(carries: Carries, normal: np.ndarray = UP, points: np.ndarray = CORNERS) -> Reach:
    """A cube, body 1, that touches the ground, body 0, at some points."""
    J = np.concatenate([np.zeros((len(points), 3, 6)), motions_about(points, np.zeros(3), 1.0)], axis=2)
    return Reach.of(J, np.tile([0, 1], (len(points), 1)), np.zeros(len(points), int), normal, carries)


def load(*components: float) -> np.ndarray:
    return np.array([np.zeros(6), np.pad(np.array(components, float), (0, 6 - len(components)))])


def motion(reach: Reach, loads: np.ndarray, before: np.ndarray = load(0)):
    return failing(reach, loads, before, np.zeros(2))


@pytest.mark.parametrize("share", [0.9, 0.999, 1.001, 2.0])
def test_a_box_on_an_incline_slides_where_it_is_steeper_than_friction(share):
    friction, steep = 0.3, np.arctan(share * 0.3)
    reach, weight = standing(Carries.pressed(UP, friction)), load(np.sin(steep), 0, -np.cos(steep))
    found, pulled = motion(reach, weight), motion(reach, weight, load(0, 0, -np.cos(steep)))
    if share < 1:
        assert found is None and pulled is None
        return
    assert found.factor == pytest.approx(0, abs=1e-8)  # no weight stays, however small
    assert pulled.factor == pytest.approx(1 / share, rel=1e-7)  # pressed first, then pulled
    assert pulled.y[1] / pulled.y[1, 0] == pytest.approx([1, 0, friction, 0, 0, 0], abs=1e-6)
    assert not motion(reach, 1e6 * weight) is None and motion(reach, 1e6 * weight).lacking == pytest.approx(found.lacking, rel=1e-6)


@pytest.mark.parametrize("before, after", [(-2.0, -1.5), (0.9, 0.5), (0.5, -0.6)])
def test_no_share_is_told_of_loads_that_are_too_large_all_the_while(before, after):
    """A box pulled beyond its friction is pulled less, or the other way: no part of the load step is what is carried."""
    reach = standing(Carries.pressed(UP, 0.3))
    assert motion(reach, load(before, 0, -1)) is not None
    found = motion(reach, load(after, 0, -1), load(before, 0, -1))
    assert found.y[1, 0] * after > 0
    if before * after > 0:
        assert np.isnan(found.factor)
    else:  # on the way the load is small enough, up to the friction of the other direction
        assert before + found.factor * (after - before) == pytest.approx(-0.3, rel=1e-6)


def test_what_tips_over_tips_over():
    """A cube pulled at height h above its middle tips at W/2 / (1/2 + h) if friction holds."""
    reach, height = standing(Carries.pressed(UP, 5.0)), 0.25
    limit = 0.5 / (0.5 + height)
    assert motion(reach, load(0.999 * limit, 0, -1, 0, 0.999 * limit * height)) is None
    found = motion(reach, load(1.5 * limit, 0, -1, 0, 1.5 * limit * height), load(0, 0, -1))
    assert found.factor == pytest.approx(1 / 1.5, rel=1e-6) and found.y[1, 4] > 0.5 * np.linalg.norm(found.y[1])


def test_every_kind_of_law_has_its_limit():
    anything, pull = Carries.anything(4), load(0.3, 0, 1.0)
    assert motion(standing(anything), pull) is None
    glue = Carries.anything(4)  # up to a force of 0.2 at each corner, pushed any
    glue.limit, glue.side = np.full(4, 0.2), np.full(4, -1.0)
    assert motion(standing(glue), load(0, 0, -50.0)) is None
    assert motion(standing(glue), load(0, 0, 1.0)).factor == pytest.approx(0.8, rel=1e-6)
    assert motion(standing(glue), load(2.0, 0, -1.0), load(0, 0, -1)).factor == pytest.approx(0.4, rel=1e-6)
    strings = Carries.pressed(UP, side=1.0, limit=np.inf)  # pull alone, and anything across
    assert motion(standing(strings), load(0.3, 0, 1.0)) is None and motion(standing(strings), load(0, 0, -1.0)) is not None
    bolt = Carries.anything(4)  # pulls with a force of 3, no more and no less, and holds across
    bolt.motions, bolt.works = UP[None], np.full((1, 4), 3.0)
    assert motion(standing(bolt), load(0.5, 0, 3.0)) is None
    assert motion(standing(bolt), load(0, 0, 4.0)).factor == pytest.approx(0.75, rel=1e-6)
    assert motion(standing(Carries.pressed(UP)), load(1e-3, 0, -1.0)).factor == pytest.approx(0, abs=1e-8)


def test_friction_of_pressures_that_are_there():
    """Whatever presses, friction is that of the pressures; an open gap holds nothing that is not near it."""
    pressed = standing(Carries.pressed(UP, 0.3)).at_pressures(np.full(4, 0.25), np.zeros(4), np.ones(4))
    assert motion(pressed, load(0.299, 0, -7.0)) is None
    assert motion(pressed, load(0.6, 0, -7.0), load(0, 0, -7.0)).factor == pytest.approx(0.5, rel=1e-6)
    points, normal = np.vstack([CORNERS, [[0.5, 0.0, 0.0]]]), np.column_stack([UP, [-1.0, 0.0, 0.0]])
    for apart, held in ((0.01, True), (1.5, False)):  # a stop in the way, of what may move by 1
        beside = standing(Carries.pressed(normal, 0.3), normal, points).at_pressures(
            np.r_[np.full(4, 0.25), 0.0], np.r_[np.zeros(4), apart], np.ones(5))
        assert (motion(beside, load(0.6, 0, -1.0)) is None) == held, apart
    above = standing(Carries.pressed(UP, 0.3))  # nothing touches yet: it may land, and friction will hold it
    assert motion(above.at_pressures(np.zeros(4), np.full(4, 0.5), np.ones(4)), load(0.29, 0, -1.0)) is None
    assert motion(above.at_pressures(np.zeros(4), np.full(4, 1.5), np.ones(4)), load(0.29, 0, -1.0)) is not None


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_cube_makes_way_for_what_presses_it_aslant_unless_friction_jams_it(share):
    """Pressed at 45° onto the ground it jams where the angle of friction is half of that, whatever it weighs."""
    points, normal = np.vstack([CORNERS, [[0.0, 0.0, 0.5]]]), np.column_stack([UP, np.array([1.0, 0.0, -1.0]) / np.sqrt(2)])
    reach = standing(Carries.pressed(normal, share * np.tan(np.pi / 8)), normal, points)
    given = np.zeros((5, 3, 1))
    given[4, :, 0] = -1e-3 * normal[:, 4]  # what presses goes that far
    reach.J = np.concatenate([reach.J, given], axis=2)
    found = unresisted(reach, 2)
    if share > 1:
        assert found is None
    else:
        assert found[1, 0] > 0.5 and not found[0].any()


@pytest.mark.parametrize("wall", [False, True])
def test_a_run_tells_that_bodies_make_way_for_what_is_prescribed(wall):
    """A box pushed along carries nothing, unless there is a wall in its way; ended before it has settled, a run says why."""
    held = [{"on": "xmin", "displacement": [1e-2, 0, 0]}, *([{"on": "xmax", "displacement": [0, 0, 0]}] if wall else [])]
    row = {"mesh": {"box": {"size": [3, 1, 1], "cells": [6, 2, 2]}}, "subdomains": {"grid": [3, 1, 1]}, "boundary": held}
    made = contact(0.1, **row, method={"tolerance": {"error": 1e-8}, "max_iterations": 1})
    found = solve(made, build_scene(made))
    assert found.stop_reason == ("max_iterations" if wall else "limit load")
    if not wall:
        limit = found.summary["limit_load"][0]
        assert limit["prescribed"] and {m["body"] for m in limit["motions"]} == {"block 1-0-0", "block 2-0-0"}
        assert all(m["shift"][0] > 0.9 * np.linalg.norm(m["shift"]) for m in limit["motions"])
        assert "make way" in limit["sentence"] and "Lower" not in limit["sentence"]
        more = made.model_copy(update={"method": made.method.model_copy(update={"max_iterations": 30})})
        assert solve(more, found.scene).converged  # nothing is carried, and that is found


def test_no_friction_is_a_linear_program():
    """Bodies at random that touch at random: balanced where a linear program finds forces, and the motion shows it where not."""
    rng, seen = np.random.default_rng(5), set()
    for _ in range(40):
        bodies, count = 4, rng.choice([12, 24, 36])
        ends = np.array([rng.choice(bodies, 2, replace=False) for _ in range(count)])
        normal = rng.normal(size=(3, count))
        normal /= np.linalg.norm(normal, axis=0)
        J = np.concatenate([s * np.array([motions_about(rng.normal(size=(1, 3)), np.zeros(3), 1.0)[0] * (e > 0) for e in side])
                            for s, side in zip((-1, 1), ends.T)], axis=2)
        loads = rng.normal(size=(bodies, 6)) * (np.arange(bodies) == 1)[:, None]
        loads[0] = 0
        found = failing(Reach.of(J, ends, np.zeros(count, int), normal, Carries.pressed(normal)), loads, 0 * loads, np.zeros(bodies))
        along = np.einsum("cp,pcj->pj", normal, J)
        matrix = np.zeros((bodies, 6, count))
        for p, (one, two) in enumerate(ends):
            matrix[one, :, p] -= along[p, :6]
            matrix[two, :, p] -= along[p, 6:]
        there = linprog(np.zeros(count), A_eq=matrix.reshape(-1, count), b_eq=loads.ravel()).status == 0
        assert (found is None) == there
        seen.add(there)
        if found is not None:
            d = np.einsum("pj,pj->p", along, np.concatenate([found.y[ends[:, 0]], found.y[ends[:, 1]]], axis=1))
            assert d.min() >= -1e-6 and np.sum(loads * found.y) > 0
    assert seen == {True, False}


def test_a_run_that_obeys_the_laws_to_its_tolerance_is_no_balance_where_a_light_body_slides_off():
    """Two stacks on an incline, tan a = 2 μ: what holds the heavy one, whose top is held, is no measure of the light one."""
    parts = [boxed(name, [1, 1, 0.5], [2, 2, 1], at)
             for name, at in (("base", [0, 0, 0]), ("pressed", [0, 0, 0.5]), ("ground", [3, 0, 0]), ("box", [3, 0, 0.5]))]
    made = contact(0.2, mesh=None, parts=parts, subdomains="groups",
                   boundary=[BOTTOM, {"on": {"box": [[0, 0, 1], [1, 1, 1]]}, "displacement": [0, 0, -1e-2]}],
                   loads=[{"body_force": [0.4e-3, 0, -1e-3]}], method={"tolerance": {"error": 1e-2}})
    found = solve(made, build_scene(made))
    assert found.stop_reason == "limit load" and [m["body"] for m in found.summary["limit_load"][0]["motions"]] == ["box"]


def test_a_jammed_wedge_on_which_nothing_acts_any_more_stays(tmp_path):
    """No forces at all balance it as well, but no way leads there: load steps one by one say what stays."""
    made = wedge(tmp_path, 0.0, 1) | {"blackbox": IN_PROCESS, "method": {"tolerance": {"law": 1e-6}}}
    one_by_one = {**made, "method": {**made["method"], "increment": 1}}
    pressed, alone = (
        solve(config, build_scene(config)) for config in map(config_from, (made, one_by_one)))
    assert pressed.converged and pressed.summary["status_counts"]["open"] == [0, 0, 0]
    kept = np.abs(alone.energy[1:])
    assert (kept > 0.1 * alone.energy[0]).all()
    assert np.abs(pressed.energy[1:] - kept).max() <= 1e-4 * kept.max()
    assert [found["why"] for found in pressed.summary["load_path"]] == ["a body is let go"]


@pytest.mark.long
def test_a_jammed_wedge_that_is_let_go_and_pulled_stays(tmp_path):
    """Solved together the load steps settle with the wedge out, where no way leads: they are solved again one by one, and again where a
    run is gone on with."""
    made = config_from({**wedge(tmp_path, 0.05, 1), "blackbox": IN_PROCESS, "method": {"tolerance": {"law": 1e-4}}})
    solved = solve(made, build_scene(made))
    counts = solved.summary["status_counts"]
    assert solved.converged and counts["open"] == [0, 0, 0] and counts["stick"][2] > 0 and counts["slip"][0] > 0
    numbers = [event.iteration for event in solved.iterated.history]
    assert numbers == list(range(1, solved.iterations + 1))
    resumed, heard = stopped_and_resumed(tmp_path / "resumed", made, solved.scene, [3, solved.iterations - 12, solved.iterations - 2])
    assert resumed.converged and abs(resumed.iterations - solved.iterations) <= 3
    assert max(np.abs(u - v).max() for u, v in zip(solved.parts, resumed.parts)) <= 1e-3 * max(np.abs(u).max() for u in solved.parts)


def test_a_torque_beyond_the_friction_of_a_coupled_face_is_a_limit_load():
    """A coupling that presses a knob and leaves it free to turn holds no torque: its ground is no part of the knob."""
    plate = {"name": "plate", "mesh": {"box": {"size": [3, 3, 1], "cells": [3, 3, 1]}}}
    knob = {"name": "knob", "mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 2]}}, "move": {"translate": [1, 1, 1]}}
    turned = {"kind": "distributed", "displacement": [0, 0, -0.001], "rotation": [0, 0, None], "moment": [0, 0, 50.0]}
    made = config_from({
        "name": "knob", "subdomains": "groups", "parts": [plate, knob], "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": "plate/zmin", "displacement": [0, 0, 0]}, {"on": "knob/zmax", "coupling": turned}],
        "interfaces": [{"between": "auto", "law": "contact", "friction": 0.3}]})
    assert solve(made).stop_reason == "limit load"
