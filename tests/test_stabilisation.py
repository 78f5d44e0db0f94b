"""Contacts that are stabilised: bodies that nothing else holds have a place, and those that are held do not notice."""


import numpy as np
import pytest
from contact_case import BOTTOM, CASES, TOP, contact, converged
from method_case import box_of, prepared
from quick import quick
from test_contact_verification import slider
from test_keeping import stopped_and_resumed

from orchestrator.method.coarse.load_step import Line, LoadStep
from orchestrator.method.interface.pairs import History
from orchestrator.method.interface.stabilisation import ANEW, cautions, SHARE, stabilisation
from orchestrator.results.summary.lines import summary_rows
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.conditions.supports import loose_bodies

SLID = [BOTTOM, {"on": TOP, "displacement": [[0.0, 0.0, None], [1e-3, 0.0, None]]}, {"on": TOP, "pressure": 100.0}]


def method(**keys):
    return {"tolerance": {"error": 1e-6}, "max_iterations": 300, **keys}


def with_stabilisation(value, **changes):
    """To a law residual: the energy error does not fall below what springs do that stay."""
    return contact(0.2, method=method(contact={"stabilisation": value}, tolerance={"law": 1e-6}), **changes)


# --- which, and how much ----------------------------------------------------------------------------------


def test_bodies_are_loose_that_supports_and_joints_leave_a_motion():
    assert not loose_bodies(build_scene(contact())).any()
    assert loose_bodies(build_scene(contact(boundary=SLID))).tolist() == [False, True]  # free to rise and to tilt
    hung = [{"law": "contact"}, {"between": ["block 0-0-1", "block 0-0-2"], "law": "perfect"}]
    three = {"mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 6]}}, "subdomains": {"grid": [1, 1, 3]}}
    assert not loose_bodies(build_scene(contact(law=hung, **three))).any()
    assert loose_bodies(build_scene(contact(**three))).tolist() == [False, True, False]


@pytest.mark.parametrize("coarse, share", [("auto", ANEW), ("none", SHARE * 1e-4)])
def test_auto_has_springs_where_a_body_is_loose(coarse, share):
    made = contact(0.2, method={"tolerance": {"error": 1e-4}, "coarse": coarse}, mesh={"box": {"size": [1, 1, 1], "cells": [2, 2, 8]}},
                   subdomains={"grid": [1, 1, 4]}, law=[{"law": "contact"}, {"between": ["block 0-0-0", "block 0-0-1"], "law": "perfect"}])
    scene = build_scene(made)
    epsilon = {i.subdomains: e for i, e in zip(scene.interfaces, stabilisation(scene, made.method))}
    assert epsilon == {(0, 1): 0.0, (1, 2): share, (2, 3): share}
    assert not stabilisation(build_scene(contact()), contact().method).any()
    asked = with_stabilisation(1e-5)
    assert stabilisation(build_scene(asked), asked.method).tolist() == [1e-5]  # loose or not


def test_a_number_that_is_felt_is_warned_about():
    assert not cautions(with_stabilisation("auto").method) and not cautions(with_stabilisation(1e-7).method)
    (felt,), (too_much,) = (cautions(with_stabilisation(value).method) for value in (2e-7, 1e-3))
    assert "4e-07" in felt and "40%" in felt and "2e-03" in too_much and "out of reach" in too_much


# --- the blend --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def decomposed():
    made = contact(1.5, method=method(sole={"fit": False}, contact={"stabilisation": 0.05}))
    with box_of(made) as blackbox:
        yield prepared(made, build_scene(made), blackbox)


@pytest.mark.parametrize("anew", [False, True])
def test_the_local_stage_blends_the_laws_with_the_step_before_or_where_points_are(decomposed, anew):
    """Each formula from the other's result: the jump, and what the springs add to the true laws."""
    d, rng = decomposed, np.random.default_rng(3)
    fields = d.stage(1e3 * rng.normal(size=(d.steps, d.space.size)))
    pairs = d.local.pairs
    if anew:
        fields.anchor = rng.normal(size=fields.extended[0].shape)
    local = d.local(fields)
    F = pairs.traces(*fields.extended).predicted()
    before = np.concatenate([np.zeros_like(local.jump[:1]), local.jump[:-1]])
    anchor = pairs.transfer.jump(fields.anchor) if anew else before
    keq = pairs.points.stiffness
    assert len(set(local.status.ravel())) == 3
    for t in range(d.steps):
        law = pairs.force(F[t], History(before[t]), t).force
        assert local.force[t] == pytest.approx(0.95 * law + 0.05 * (F[t] - keq(anchor[t])), abs=1e-9 * np.abs(F).max())
        assert keq(local.jump[t]) == pytest.approx(F[t] - local.force[t], abs=1e-9 * np.abs(F).max())
        assert local.lawful[t] == pytest.approx(law)


def test_the_coarse_problem_blends_them_alike(decomposed):
    """ρ written out at every pair, and the matrix against differences of ρ."""
    coarse, rng = decomposed.coarse, np.random.default_rng(4)
    problem, pairs = coarse.problem, coarse.pairs
    at = problem.fields
    F0 = 100 * rng.normal(size=(3, len(pairs)))
    previous, resultant = 1e-4 * rng.normal(size=F0.shape), rng.normal(size=(2, 12))
    y = 1e-2 * rng.normal(size=(2, 12))
    step = LoadStep(problem.bodies, 0, F0, resultant, History(previous))
    T, F = at.T, at.predicted(F0, y)
    force = 0.95 * pairs.force(F, History(previous), 0).force + 0.05 * (F - pairs.points.stiffness(previous))
    carried = np.einsum("pif,ip->f", T, force).reshape(2, 12)
    rho = resultant + np.einsum("bij,bj->bi", problem.bodies.K0, y) - carried
    assert step.residual(y) == pytest.approx(rho, abs=1e-9 * np.abs(rho).max())
    matrix = problem.bodies.pattern.matrix(step.matrix()).toarray()
    change = 1e-7 * rng.normal(size=(2, 12))
    found = (step.residual(y + change) - step.residual(y - change)) / 2
    assert (matrix @ change.ravel()) == pytest.approx(found.ravel(), abs=1e-5 * np.abs(found).max())


def test_the_work_along_a_line_is_that_of_the_imbalance(decomposed):
    coarse, rng = decomposed.coarse, np.random.default_rng(5)
    F0 = 100 * rng.normal(size=(3, len(coarse.pairs)))
    y, dy, resultant = 1e-4 * rng.normal(size=(2, 12)), 0.1 * rng.normal(size=(2, 12)), rng.normal(size=(2, 12))
    before = 1e-4 * rng.normal(size=F0.shape)
    step = LoadStep(coarse.problem.bodies, 0, F0, resultant, History(before))
    step.residual(y)
    work = Line(step, dy)
    for theta in (0.0, 0.3, 1.0):
        rho = step.residual(y + theta * dy)
        assert work(theta) == pytest.approx(np.vdot(dy, rho), rel=1e-6)
        step.residual(y)
        assert Line(step, dy).end(theta) == pytest.approx(rho, abs=1e-9 * np.abs(rho).max())


# --- what comes of it -------------------------------------------------------------------------------------


def test_what_holds_together_is_left_alone():
    """To the last bit."""
    one, other = (solve(with_stabilisation(value)) for value in ("auto", 0))
    assert one.iterated.iterations == other.iterated.iterations
    assert all(np.array_equal(a, b) for a, b in zip(one.parts, other.parts))


@pytest.mark.long
def test_what_springs_carried_is_told_and_below_the_tolerance():
    grains = {**CASES["ten grains"], "mesh": {"polycrystal": {"grains": 10, "size": 1.0, "h": 0.27}}}
    fine = converged(with_stabilisation("auto", **grains))
    found = fine.summary
    told = found["stabilised"]
    assert 0 < told["force"] <= found["tolerance"] and 0 < told["work"] < 1e-3
    assert told["force"] == pytest.approx(found["residuals"]["stabilisation"], rel=1e-12)
    lost = {name for key in ("detached", "weakly_held") for names in found[key] for name in names}
    assert lost and {name for names in found["detached"] for name in names} <= {n for names in told["bodies"] for n in names}
    rows = dict(summary_rows(found))
    assert next(iter(lost)) in rows["stabilised"] + rows["not held"] and "where stabilisation leaves it" in rows["not held"]
    assert sum(found["coarse_ends"].values()) == found["iterations"] * found["load_steps"]
    other = solve(with_stabilisation(0)).summary
    assert "stabilisation" not in other["residuals"] and other["places"] is None and "places" not in dict(summary_rows(other))
    # to a tolerance a hundred times as large no body is off by more than is told of it
    made = contact(0.2, method={"tolerance": {"error": 1e-4}}, **grains)
    rough = solve(made, fine.scene)
    largest, told = max(np.abs(u).max() for u in rough.sides), rough.summary["places"]
    anywhere = lambda far: np.inf if far is None else far
    told = {"open": anywhere(told["open"]), "bodies": {name: anywhere(far) for name, far in told["bodies"].items()}}
    off = {s.body: np.linalg.norm(u - v, axis=2).max() / largest for s, u, v in zip(fine.scene.subdomains, rough.sides, fine.sides)}
    assert told["bodies"].keys() == off.keys() and told["open"] == max(told["bodies"].values()) == next(iter(told["bodies"].values()))
    assert all(far <= told["bodies"][name] for name, far in off.items())
    held = [told["bodies"][s.body] for s in fine.scene.subdomains if s.fixed.any()]
    assert max(held) < 100 * 1e-4  # what supports hold stays there


@pytest.mark.parametrize("tolerance", quick([{"error": 1e-3}, {"law": 1e-3}], {"error": 1e-3}))
def test_a_body_that_nothing_holds_has_no_place(tolerance):
    """A block that is pressed on another one: friction holds it, without friction nothing does across."""
    held, free = (solve(slider(0.0, friction, method=method(tolerance=tolerance))).summary["places"]["bodies"] for friction in (0.2, 0.0))
    assert held.keys() == free.keys() == {"block 0-0-0", "block 0-0-1"} and max(held.values()) < 0.1
    assert free["block 0-0-1"] is None and free["block 0-0-0"] < 0.1


def test_a_load_beyond_the_limit_is_said_to_have_no_balance():
    """A block pulled by 1.2 times what friction holds: springs carry the fifth that is left over."""
    found = solve(slider(1.2 * 0.2 * 100.0, method=method())).summary
    assert found["stop_reason"] == "limit load" and found["iterations"] < 20
    limit, = found["limit_load"]
    assert limit["load_step"] == 1 and [motion["body"] for motion in limit["motions"]] == ["block 0-0-1"] and not limit["pressures"]
    x, y, z = limit["motions"][0]["shift"]
    # off the surface by friction at least, at every point of a motion that may turn
    assert 0.19 < z / x < 0.3 and abs(y) < 1e-6 * x and limit["factor"] == pytest.approx(0.0, abs=1e-6)
    assert any("block 0-0-1 moves along" in sentence for sentence in found["advice"])


@pytest.mark.long
def test_springs_that_begin_anew_leave_nothing(tmp_path):
    """A block that under light pressure slides farther than springs would allow that stay, on laws that have a balance."""
    far = {"mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 4]}},
           "boundary": [BOTTOM, {"on": TOP, "displacement": [[0.0, 0.0, None], [2e-1, 0.0, None]]}, {"on": TOP, "pressure": 1.0}]}
    made = with_stabilisation("auto", **far)
    one = converged(made)
    assert not one.summary["stabilised"]["weakened"] and one.summary["stabilised"]["force"] < 1e-11
    lawful = converged(with_stabilisation(0, **far))
    largest = max(np.abs(u).max() for u in lawful.parts)
    assert max(np.abs(u - v).max() for u, v in zip(one.parts, lawful.parts)) <= 2e-6 * largest
    # stopped, it goes on as if nothing had happened
    resumed, heard = stopped_and_resumed(tmp_path, made, one.scene, [2, one.iterations - 1])
    assert [event.iteration for event in heard] == list(range(1, one.iterations + 1))
    assert max(np.abs(u - v).max() for u, v in zip(one.parts, resumed.parts)) <= 1e-12 * largest
    # and so it does load step by load step, each of which begins with those of the beginning
    steps = [[0.0, 0.0, None], [2e-2, 0.0, None], [2e-2, 1e-3, None]]
    far["boundary"][1] = {"on": TOP, "displacement": steps}
    each = contact(0.2, method=method(increment=1), **far)
    one = converged(each)
    resumed, heard = stopped_and_resumed(tmp_path / "each", each, one.scene, [one.iterations - 8, one.iterations - 1])
    assert [event.iteration for event in heard] == list(range(1, one.iterations + 1))
    assert resumed.summary["residuals"] == pytest.approx(one.summary["residuals"], rel=1e-9, abs=1e-12, nan_ok=True)
    assert max(np.abs(u - v).max() for u, v in zip(one.parts, resumed.parts)) <= 1e-12 * largest
    # what has no balance loads them as before
    beyond = solve(slider(1.00002 * 0.2 * 100.0, method=method()))
    assert beyond.summary["stop_reason"] == "limit load" and not beyond.converged
    # a number is what it is
    held = solve(with_stabilisation(2.5e-9, **{**far, "boundary": made.boundary}), one.scene)
    assert held.stop_reason == "held by stabilisation alone" and held.summary["stabilised"]["force"] > 2e-6
    assert not held.summary["stabilised"]["weakened"]


@pytest.mark.parametrize("case", quick(CASES, "eight cubes"))
def test_friction_of_one(case):
    assert converged(contact(1.0, method=method(), **CASES[case])).iterated.iterations < 150
