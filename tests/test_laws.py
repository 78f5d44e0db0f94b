"""Laws in general: what every one must keep, and a law of the user's own from the documentation to the results."""

import re
from pathlib import Path

import numpy as np
import pytest
from method_case import config, solved

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.laws.base import Law, Stages, Written
from orchestrator.laws.contact import Contact, OPEN, SLIP, STICK
from orchestrator.laws.contact_loops import forces, slopes
from orchestrator.laws.elastic import Elastic, SLACK, SPRUNG, TAUT
from orchestrator.laws.points import BONDED, Hold, Points, Status, table
from orchestrator.method.iterated import load_cases
from orchestrator.registry import DEFAULT_LAW, GROUND, LAWS
from orchestrator.scene.build import build_scene

ROOT = Path(__file__).parents[1]
COUNT = 200
ENTRIES = {"perfect": {}, "contact": {"friction": 0.3, "gap": 0.02}, "jump": {"jump": [0.1, -0.2, 0.3]},
           "elastic": {"stiffness_n": 2.0, "stiffness_t": 0.7}}


def points_of(law: Law, random) -> Points:
    """Pairs with normals and search directions of all kinds."""
    normal = random.normal(size=(3, COUNT))
    normal /= np.linalg.norm(normal, axis=0)
    length, area = random.uniform(0.3, 1.0, COUNT), random.uniform(0.5, 2.0, COUNT)
    return Points(normal, *random.uniform(0.5, 3.0, (2, COUNT)), area,
                  law.parameters(np.arange(COUNT), length, area))


def assert_consistent(name: str, keys: dict) -> None:
    """The derivative is that of the force by central differences, statuses are declared.

    Pairs that change their status within a difference are left out, few as they are.
    """
    law = LAWS[name].of(LAWS[name].Parameters(law=name, **keys), COUNT, 1.0)
    random = np.random.default_rng(4)
    points, (F, previous) = points_of(law, random), random.normal(size=(2, 3, COUNT))
    answer = law.force(points, F, previous, derivative=True)
    found = np.zeros((3, 3, COUNT))
    found[..., answer.active] = answer.derivative
    step, same = 1e-6, np.ones(COUNT, bool)
    for i, axis in enumerate(np.eye(3)):
        ahead, behind = (law.force(points, F + sign * step * axis[:, None], previous) for sign in (1, -1))
        same &= (ahead.status == answer.status) & (behind.status == answer.status)
        assert (ahead.force - behind.force)[:, same] / (2 * step) == pytest.approx(found[:, i, same], abs=1e-7)
    assert same.mean() > 0.95 and set(answer.status.tolist()) <= set(law.statuses)


SPRINGS = {"stiffness_n": 2.0, "stiffness_t": 0.7}


def answered(name: str, **keys):
    """A law's points, what it answers there, the jumps d = (F − f̂) / keq that come with it, and where friction stuck before."""
    law = LAWS[name].of(LAWS[name].Parameters(law=name, **keys), COUNT, 1.0)
    random = np.random.default_rng(9)
    points, (F, previous) = points_of(law, random), random.normal(size=(2, 3, COUNT))
    answer = law.force(points, F, previous)
    return law, points, answer, points.compliance(F - answer.force), previous


def test_bonds_and_jumps_leave_the_jump_that_is_given():
    *_, d, _ = answered("perfect")
    assert np.abs(d).max() < 1e-12
    *_, d, _ = answered("jump", jump=[0.1, -0.2, 0.3])
    assert d == pytest.approx(np.repeat([[0.1], [-0.2], [0.3]], COUNT, 1), abs=1e-12)


@pytest.mark.parametrize("tension_only", [False, True])
def test_springs_carry_their_stiffness_times_the_stretch(tension_only):
    law, points, answer, d, _ = answered("elastic", **SPRINGS, tension_only=tension_only)
    stretch, n = points.along(d), points["across"] / points.area
    assert n == pytest.approx(np.full(COUNT, 0.7))
    taut = points["taut"] / points.area
    assert (taut > 0.7).all() and (taut < 2.7).all()  # the rest of a shortened normal lies in the interface
    normal = np.where(tension_only & (stretch < 0), points["slack"], points["taut"])
    wanted = points["across"] * points.across(d) + normal * stretch * points.normal
    assert answer.force == pytest.approx(wanted, rel=1e-12, abs=1e-13)
    if tension_only:
        assert (answer.status == SLACK)[stretch < 0].all() and (answer.status == TAUT)[stretch >= 0].all()
        assert (points["slack"] < points["taut"]).all()
    else:
        assert (points["slack"] == points["taut"]).all() and (answer.status == SPRUNG).all()


def missed(law, points, answer, d, previous, normal, across):
    """Forces that differ by something anywhere: what a law measures, and that as the predicted force would have it, per area."""
    by = np.random.default_rng(5).normal(size=d.shape)
    stages = Stages((answer.force + by)[None], d[None], d[None], previous, answer.status[None], {k: x[None] for k, x in answer.own.items()})
    traction, found = law.residuals(points, stages)
    assert traction[0] == pytest.approx(np.linalg.norm(answer.force + by, axis=0) / points.area)
    (found,) = found.values()
    return found[0], np.hypot(points.stiff_n / (points.stiff_n + normal) * points.along(by),
                              points.stiff_t / (points.stiff_t + across) * np.linalg.norm(points.across(by), axis=0)) / points.area


@pytest.mark.parametrize("tension_only", [False, True])
def test_what_springs_miss_is_weighed_by_how_soft_they_are(tension_only):
    law, points, answer, d, previous = answered("elastic", **SPRINGS, tension_only=tension_only)
    normal = np.where(points.along(d) < 0, points["slack"], points["taut"])
    found, wanted = missed(law, points, answer, d, previous, normal, points["across"])
    assert found == pytest.approx(wanted)


def test_springs_beside_prescribed_components():
    """Of a normal shortened to .6 the rest lies in the interface: k = .36 k_n + .64 k_t; where nothing pulls springs are taut."""
    law = Elastic(2.0, 0.7, True)
    taut, slack = law.along(np.array([1.0, 0.6]))
    assert taut == pytest.approx([2.0, 1.168]) and slack == pytest.approx([0.0, 0.448])
    assert not law.joins and law.rigidity == Elastic(0.7, 2.0).rigidity == 0.7 and Elastic(2.0, 0.7).joins
    points = Points(np.eye(3)[:, :2], *np.ones((2, 2)), np.ones(2), law.parameters(np.arange(2), np.ones(2), np.ones(2)))
    answer = law.force(points, np.array([[0.0, 1.0], [1.0, -1.0], [0.0, 0.0]]), np.zeros((3, 2)))
    assert answer.status.tolist() == [TAUT, SLACK] and answer.active is None is answer.derivative


@pytest.mark.parametrize("tension_only", [False, True])
def test_springs_written_to_files_are_checked_node_by_node(tension_only):
    """Pulled, pressed and at rest beside a whole and a shortened normal: closed forms; what breaks them is told by its size."""
    law, length, opening = Elastic(2.0, 0.7, tension_only), np.array([1.0, 0.6, 1.0, 0.6, 1.0]), np.array([0.5, 0.3, -0.5, -0.3, 0.0])
    stiff = np.array([2.0, 1.168, 0.0, 0.448, 2.0] if tension_only else [2.0, 1.168, 2.0, 1.168, 2.0])
    slip = np.random.default_rng(0).normal(size=(1, 5, 3))
    sound = dict(opening=opening[None], slip=slip, pressure=(-stiff * opening / length**2)[None], shear=0.7 * slip,
                 chosen=np.arange(5), length=length)
    assert max(law.violations(Written(**sound), 3.0, 4.0).values()) < 1e-15
    for node in range(5):
        pressure, shear = sound["pressure"].copy(), sound["shear"].copy()
        pressure[0, node] -= 0.1
        shear[0, node] += [0.0, 0.3, 0.4]
        found = law.violations(Written(**sound | {"pressure": pressure, "shear": shear}), 3.0, 4.0)
        assert found == pytest.approx({"the normal springs' law": 0.1 * length[node] / (4.0 + 3.0 * stiff[node]),
                                       "the tangential springs' law": 0.5 / (4.0 + 3.0 * 0.7)})


@pytest.mark.parametrize("friction, gap, some_stick", [(0.8, -0.4, True), (0.3, 0.4, False), (0.0, 0.0, False)])
def test_contact_obeys_signorini_and_coulomb(friction, gap, some_stick):
    _, points, answer, d, previous = answered("contact", friction=friction, gap=gap)
    pressure, opening = -points.along(answer.force), points["gap"] + points.along(d)
    assert pressure.min() > -1e-12 and opening.min() > -1e-12 and np.abs(pressure * opening).max() < 1e-12
    shear, slip = points.across(answer.force), points.across(d - previous)
    size, most = np.linalg.norm(shear, axis=0), points["friction"] * pressure
    assert (size <= most + 1e-12).all()
    sticks, slides = answer.status == STICK, answer.status == SLIP
    assert np.abs(slip[:, sticks]).max(initial=0.0) < 1e-12 and size[slides] == pytest.approx(most[slides], abs=1e-12)
    work = (shear * slip).sum(axis=0)
    assert work == pytest.approx(size * np.linalg.norm(slip, axis=0) * ~sticks, abs=1e-12)  # friction is along the slip
    assert np.abs(answer.force[:, answer.status == OPEN]).max(initial=0.0) == 0
    assert {OPEN, SLIP} <= set(answer.status.tolist()) and sticks.any() == some_stick


@pytest.mark.parametrize("name, keys", [("elastic", SPRINGS), ("elastic", {**SPRINGS, "tension_only": True}),
                                        ("contact", {"friction": 0.3, "gap": 0.02})])
def test_residuals_are_nothing_where_a_law_holds_and_grow_with_what_it_misses(name, keys):
    law, points, answer, d, previous = answered(name, **keys)

    def residual(force, jump):
        stages = Stages(force[None], jump[None], d[None], previous, answer.status[None])
        return max(float(np.abs(values).max()) for values in law.residuals(points, stages)[1].values())

    assert residual(answer.force, d) < 1e-12
    small, large = (residual(answer.force + size * points.normal, d + size * points.normal) for size in (1e-3, 1e-2))
    assert 1e-5 < small < 0.2 * large


WRITTEN = {"pressure": [0.0, 2.0, 2.0, 0.0], "opening": [0.3, -0.1, -0.1, 0.0], "shear": [0.0, 1.0, 0.6, 0.0]}  # μ = .5, gap .1


@pytest.mark.parametrize("change, broken", [
    ({}, {}), ({"opening": [0.3, -0.15, -0.1, 0.0]}, {"penetration": 0.05 / 2}),
    ({"opening": [0.3, -0.1, -0.1, -0.14]}, {"penetration": 0.04 / 2}),
    ({"pressure": [0.0, 2.0, 2.0, -0.4]}, {"tension": 0.1}), ({"shear": [0.0, 1.2, 0.6, 0.0]}, {"Coulomb's cone": 0.05}),
    ({"shear": [0.2, 1.0, 0.6, 0.0]}, {"Coulomb's cone": 0.05}),
    ({"pressure": [0.2, 2.0, 2.0, 0.0]}, {"complementarity": 0.05}), ({"opening": [0.3, 0.1, -0.1, 0.0]}, {"complementarity": 0.1})])
def test_what_contact_forbids_is_found_node_by_node(change, broken):
    """Closed forms at four nodes, open, slipping, sticking and touching: lengths over 2, pressures over 4."""
    given = {name: np.array([values]) for name, values in (WRITTEN | change).items()}
    shear = given["shear"][..., None] * [0.6, 0.8, 0.0]
    written = Written(given["opening"], np.zeros((1, 4, 3)), given["pressure"], shear, np.arange(4), np.ones(4))
    found = Contact(0.5, np.full(4, 0.1)).violations(written, 2.0, 4.0)
    assert {name: value for name, value in found.items() if value > 1e-15} == pytest.approx(broken)


def test_what_is_prescribed_on_both_sides_may_not_close_more_than_the_gap():
    law, normal = Contact(0.0, np.array([0.5, 0.1, 0.2])), np.array([[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])
    jump, known = np.array([[0.0, 0.0, -0.3], [9.0, -0.5, -0.5]]), np.array([[True, True, True], [False, True, True]])
    chosen = np.array([2, 1])
    assert law.forbids(jump, known, normal, chosen) == pytest.approx([0.1, 0.6])
    assert not law.forbids(jump, ~known, normal, chosen).any() and not law.forbids(-jump, known, normal, chosen).any()


def test_what_contact_says_of_its_keys():
    """Press fits, gaps that are read, and what does not go with them."""
    def keys(**given):
        return Contact.Parameters(law="contact", **given)

    assert keys(gap=-0.2).fit == 0.2 and keys(gap=0.2).fit == keys().fit == keys(gap="geometry").fit == 0.0
    assert Contact(0.0, np.array([-0.2, 0.1])).imposed == 0.2 and Contact(0.0, np.array([0.1])).imposed == 0.0
    assert Contact(1.1, np.zeros(1)).caution and not Contact(1.0, np.zeros(1)).caution
    assert Contact(0.0, np.zeros(1)).convex and not Contact(0.1, np.zeros(1)).convex

    def wrong(**raw):
        return [problem[0] for problem in Contact.Parameters.broken(raw)]

    assert wrong(history="ramp") == wrong(history="ramp", gap=0) == wrong(history="ramp", gap="geometry") == ["history"]
    assert wrong(history="ramp", gap=0.1) == [] == wrong(within=1, gap="geometry") == wrong(within=1, between="auto")
    assert wrong(within=1) == wrong(within=1, gap=0.1, between="auto") == ["within"]
    assert Contact.of(keys(gap=0.1), 3, 1.0, np.full(3, 7.0)).distance.tolist() == [0.1] * 3
    assert Contact.of(keys(gap="geometry"), 3, 1.0, np.full(3, 7.0)).distance.tolist() == [7.0] * 3
    assert Contact.of(keys(gap="geometry"), 3, 1.0).distance.tolist() == [0.0] * 3


@pytest.mark.parametrize("miss, grown", [("jump", "penetration"), ("tension", "tension"), ("shear", "cone"), ("slip", "slip_direction")])
def test_each_measure_of_contact_grows_by_what_it_is_named_after(miss, grown):
    law, points, answer, d, previous = answered("contact", friction=0.3, gap=0.02)
    at, (slides,) = answer.status == SLIP, np.nonzero(answer.status == SLIP)
    k, force, jump, told = slides[0], answer.force.copy(), d.copy(), d.copy()
    shear = points.across(force)[:, k] / np.linalg.norm(points.across(force)[:, k])
    if miss == "jump":
        jump[:, k] -= 0.1 * points.normal[:, k]
    elif miss == "tension":
        k = np.flatnonzero(answer.status == OPEN)[0]
        force[:, k] += 0.1 * points.area[k] * points.normal[:, k]
    elif miss == "shear":
        force[:, k] += 0.1 * points.area[k] * shear
    else:
        told[:, k] -= 2 * (points.across(d - previous)[:, k])
    pressure, before = law.residuals(points, Stages(answer.force[None], d[None], d[None], previous, answer.status[None]))
    _, after = law.residuals(points, Stages(force[None], jump[None], told[None], previous, answer.status[None]))
    assert at.any() and pressure == pytest.approx(-(points.along(answer.force) / points.area).min())
    increase = {name: float(np.max(after[name] - before[name])) for name in after}
    wanted = 2 * np.linalg.norm(points.across(force)[:, k]) / points.area[k] * np.linalg.norm(points.across(d - previous)[:, k])
    assert increase[grown] == pytest.approx(wanted if miss == "slip" else 0.1, abs=1e-9)
    assert max(abs(value) for name, value in increase.items() if name != grown) < 1e-9


def test_contact_is_measured_at_the_worst_load_step_with_the_slip_of_each():
    law, points, answer, d, previous = answered("contact", friction=0.3, gap=0.02)
    assert Contact.Parameters(law="contact", pairing="follow").follows
    forces, jumps, status = np.stack([answer.force, answer.force]), np.stack([d, d]), np.stack([answer.status] * 2)
    rests = law.residuals(points, Stages(forces, jumps, jumps, previous, status))[1]  # the second load step slips no more
    assert max(rests.values()) < 1e-12
    slides = answer.status == SLIP
    slip, size = points.across(d - previous), np.linalg.norm(points.across(answer.force) / points.area, axis=0)
    back = np.stack([d, d - slip])  # slips all the way back, against what friction says
    pressure, found = law.residuals(points, Stages(forces, jumps, back, previous, status))
    assert found["slip_direction"] == pytest.approx((2 * size * np.linalg.norm(slip, axis=0))[slides].max())
    deep = jumps - np.array([0.0, 0.1])[:, None, None] * points.normal
    worst = law.residuals(points, Stages(forces * [[[1.0]], [[2.0]]], deep, jumps, previous, status))
    assert worst[0] == pytest.approx(2 * pressure) and worst[1]["penetration"] == pytest.approx(0.1)


@pytest.mark.parametrize("name, keys", [("elastic", SPRINGS), ("contact", {"friction": 0.3, "gap": 0.02}),
                                        ("cohesive", {"stiffness": 3.0, "strength": 0.4, "toughness": 1.0})])
def test_measures_have_the_units_that_they_are_divided_by(name, keys):
    """Forces a times and lengths b times as large: each measure grows by the powers that it says."""
    random, a, b = np.random.default_rng(3), 7.0, 0.01
    law = LAWS[name].of(LAWS[name].Parameters(law=name, **keys), COUNT, 1.0)
    points, (force, jump, answered, before) = points_of(law, random), random.normal(size=(4, 3, COUNT))
    status, own = np.full((1, COUNT), int(SLIP)), {name: random.random((1, COUNT)) for name in law.variables}
    powers = {"gap": b, "friction": 1.0, "first": b, "last": b}  # of all else: stiffnesses
    scaled = Points(points.normal, points.stiff_n * a / b, points.stiff_t * a / b, points.area,
                    {key: value * powers.get(key, a / b)
                     for key, value in law.parameters(np.arange(COUNT), np.ones(COUNT), points.area).items()})
    plain = Points(points.normal, points.stiff_n, points.stiff_t, points.area,
                   law.parameters(np.arange(COUNT), np.ones(COUNT), points.area))
    small, large = (law.residuals(p, Stages(f * force[None], u * jump[None], u * answered[None], u * before, status, own))
                    for p, f, u in ((plain, 1.0, 1.0), (scaled, a, b)))
    assert large[0] == pytest.approx(a * small[0])
    for measure in law.measures:
        assert np.max(small[1][measure.name]) > 0.1
        assert large[1][measure.name] == pytest.approx(a**measure.pressure * b**measure.length * small[1][measure.name]), measure.name


def test_contact_without_friction_on_a_normal_without_shear():
    """Nothing is divided by the shear that there is none of: f = F, and ∂f/∂F = n nᵀ."""
    law, n = Contact(0.0, np.zeros(2)), np.eye(3)[:, :2]
    points = Points(n, *np.ones((2, 2)), np.ones(2), law.parameters(np.arange(2), np.ones(2), np.ones(2)))
    answer = law.force(points, -n, np.zeros((3, 2)), derivative=True)
    assert np.array_equal(answer.force, -n) and (answer.status == SLIP).all()
    assert np.array_equal(answer.derivative, n[:, None] * n) and answer.active.tolist() == [0, 1]
    assert law.force(points, -n, np.zeros((3, 2))).active is None


def test_contact_answers_in_parts_what_it_answers_at_once():
    """Cores take parts of the pairs: none writes beside its own."""
    law = Contact(0.3, np.full(COUNT, 0.02))
    random = np.random.default_rng(7)
    points, (F, previous) = points_of(law, random), random.normal(size=(2, 3, COUNT))
    whole = law.force(points, F, previous, derivative=True)
    given = (*points.search, points["gap"], points["friction"]), F, previous
    force, status, slope = np.full(F.shape, 9.0), np.full(COUNT, 9), np.full(whole.derivative.shape, 9.0)
    forces(50, 120, *given, force, status)
    slopes(10, 20, *given, whole.active, slope)
    own, some = (np.arange(COUNT) >= 50) & (np.arange(COUNT) < 120), np.arange(len(whole.active)) // 10 == 1
    assert np.array_equal(force, np.where(own, whole.force, 9.0)) and np.array_equal(status, np.where(own, whole.status, 9))
    assert np.array_equal(slope, np.where(some, whole.derivative, 9.0))


@pytest.mark.parametrize("name, keys", ENTRIES.items(), ids=ENTRIES)
def test_force_derivative_and_statuses_belong_together(name, keys):
    assert_consistent(name, keys)


def test_a_law_that_tells_nothing_is_on_the_safe_side():
    class Silent(Law):
        pass

    assert not (Silent().convex or Silent().joins or Silent.perfect or Silent.variables)


def test_statuses_of_one_scene_have_one_name_each():
    class Wear(Law):
        name, statuses = "wear", (Status(2, "worn", "#000000", Hold.ALWAYS, Hold.NEVER),)

    assert [s.name for s in table([*LAWS.values(), *GROUND.values()])][:4] == ["open", "stick", "slip", "bonded"]
    with pytest.raises(ValueError, match="law wear: status 2 is called 'worn', but it is 'slip' elsewhere"):
        table([Contact, Wear])
    assert BONDED == 3 and [int(s) for s in table([])] == [3]


def test_no_other_module_asks_for_a_law():
    """Neither for its name nor for its class; but for the law that a scene has where nothing is said."""
    names = "|".join(LAWS)
    others = "|".join(name for name in LAWS if name != DEFAULT_LAW)
    asks = re.compile(rf"[\"']({names})[\"']|\.law\s*[!=]=|law\.name\s*[!=]=|laws\.({others})\b")
    # explain.py, files.py: words of other programs, as FreeFEM's operator jump
    # method.macro.on speaks of all perfect interfaces, method.contact of what is stabilised
    own_words = 'on: Literal["perfect", "all"]', '"contact", "stabilisation"'
    rooms = ("config", "scene", "blackbox", "method", "parallel", "results")
    files = [*(ROOT / "orchestrator").glob("*.py"), *(p for r in rooms for p in (ROOT / "orchestrator" / r).rglob("*.py"))]
    assert len(files) > 100
    assert [f"{p}: {line}" for p in files if p.name not in ("registry.py", "explain.py", "files.py") for line in p.read_text().splitlines()
            if asks.search(line) and not any(word in line for word in own_words) and not line.lstrip().startswith((">>>", "..."))] == []


# --- a law of one's own -----------------------------------------------------------------------------------

YOUNG, VISCOSITY, PULL = 1000.0, 250.0, 10.0
BARS = {"mesh": {"box": {"size": [4.0, 1.0, 1.0], "cells": [4, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": YOUNG, "poisson": 0.0}],
        "boundary": [{"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]},
                     {"on": {"plane": "x", "at": 4.0}, "traction": [PULL, 0.0, 0.0], "history": "pulls"}],
        "histories": {"pulls": [1.0, 1.0, -0.5, 1.0]}, "method": {"tolerance": {"law": 1e-11}}}
LAYER = {"law": "viscous", "viscosity": VISCOSITY}


@pytest.fixture
def viscous(monkeypatch):
    """The example of the documentation, as it stands there."""
    monkeypatch.setattr(LAWS, "_places", dict(LAWS._places))
    monkeypatch.setattr(LAWS, "_known", dict(LAWS._known))
    room = {"__name__": "viscous"}
    exec(re.search(r"```python\n(.*?)```", (ROOT / "docs" / "laws.md").read_text(), re.S).group(1), room)
    LAWS.add("viscous", room["Viscous"])
    return room["Viscous"]


def test_the_law_of_the_documentation(viscous):
    """Equal loads, another jump each time: no load step is left out, though two of them are alike."""
    scene = build_scene(config(**BARS, interfaces=[LAYER]))
    assert load_cases(scene).left_out == 0
    found = solved(reference=False, **BARS, interfaces=[LAYER])
    assert found.iterated.converged, found.iterated.stop_reason
    pulls = PULL * np.array(BARS["histories"]["pulls"])
    jump = np.cumsum(pulls) / VISCOSITY
    far = np.isclose(scene.mesh.nodes[:, 0], 4.0)
    assert found.displacement[:, far, 0] == pytest.approx(np.repeat((4.0 * pulls / YOUNG + jump)[:, None], far.sum(), 1), rel=1e-9)
    assert found.interfaces.counts["viscous"] == [9] * 4 and found.interfaces.laws.tolist() == ["viscous"]
    assert found.interfaces.gap == pytest.approx(np.repeat(jump[:, None], 9, axis=1), rel=1e-9)


def test_its_derivative(viscous):
    assert_consistent("viscous", {"viscosity": 2.0})


def test_its_keys_are_its_own(viscous):
    def told(entry):
        data = config(**{**BARS, "method": {}}).complete()
        with pytest.raises(InputError) as caught:
            config_from({**data, "interfaces": [entry]})
        (problem,) = caught.value.problems
        return problem.path, f"{problem.found} | {problem.expected} | {problem.cure}"

    assert told({"law": "viscous"}) == (
        ("interfaces", 0, "viscosity"),
        "no viscosity | force per area and per displacement in one load step, above 0 | add viscosity")
    assert "a number > 0" in told({**LAYER, "viscosity": -1.0})[1]
    assert told({**LAYER, "law": "contact"}) == (
        ("interfaces", 0, "viscosity"),
        "viscosity with law: contact | viscosity with law: viscous only | remove viscosity, or write law: viscous")
    assert told({**LAYER, "law": "vicsous"})[1].endswith("did you mean 'viscous'?")
    assert "did you mean 'viscosity'" in told({"law": "viscous", "viscosity": 1.0, "viscosty": 2.0})[1]
