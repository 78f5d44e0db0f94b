"""Laws between parts beside their closed forms, mostly in scenes that elements represent
exactly."""

import numpy as np
import pytest
from helpers import (CONFIGS, HELD, OPEN, STEEL, box, bricks, on, rollers, run, solved, stopped,
                     written)

YOUNG, LENGTH, PULL = 1000.0, 2.0, 10.0
EXACT = {"method": {"tolerance": {"error": 1e-8}}}
ROUNDING = 1e-7  # what a tolerance of 1e-8 leaves in values that are sums of a few terms


def bars(law: dict, end: dict, count: int = 2, **changes) -> dict:
    """Bars of 2 × 1 × 1 in a row, ν = 0, the first held, the last led or pulled."""
    return {"name": "bars",
            "mesh": {"box": {"size": [LENGTH * count, 1, 1], "cells": [2 * count, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": count}},
            "materials": [{"young": YOUNG, "poisson": 0.0}],
            "boundary": [{"on": "xmin", "displacement": HELD}, {"on": "xmax", **end}],
            "interfaces": [law],
            **EXACT, **changes}


def blocks(top: list[dict], law: dict, **changes) -> dict:
    """Two blocks of side 1, one on the other, the lower held below."""
    return {"name": "blocks", "mesh": {"box": {"size": [1, 1, 2], "cells": [2, 2, 4]}},
            "subdomains": {"slices": {"axis": "z", "count": 2}},
            "materials": [{"young": YOUNG, "poisson": 0.0}],
            "boundary": [{"on": "zmin", "displacement": HELD},
                         *({"on": "zmax", **entry} for entry in top)],
            "interfaces": [law], **EXACT, **changes}


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_bonded_bars_are_one_bar(element):
    """δ = σ L/E, energy σ² V/2E."""
    code = {"element": element, "workers": 1}
    found = solved(bars({"law": "perfect"}, {"traction": [PULL, 0, 0]}, count=4, blackbox=code))
    assert found.displacement[0, :, 0].max() == pytest.approx(PULL * 4 * LENGTH / YOUNG,
                                                              rel=ROUNDING)
    assert found.energy == pytest.approx([PULL**2 * 4 * LENGTH / (2 * YOUNG)], rel=ROUNDING)
    assert found.reactions[0, 0] == pytest.approx([-PULL, 0, 0], abs=ROUNDING * PULL)


@pytest.mark.parametrize("stiffness", [1.0, 250.0, 1e7])
def test_elastic_springs_in_a_row(stiffness):
    """δ = σ (2L/E + 1/k), whether the spring is soft or nearly rigid."""
    law = {"law": "elastic", "stiffness_n": stiffness, "stiffness_t": 0.4 * stiffness}
    found = solved(bars(law, {"traction": [PULL, 0, 0]}))
    exact = PULL * (2 * LENGTH / YOUNG + 1 / stiffness)
    assert found.displacement[0, :, 0].max() == pytest.approx(exact, rel=ROUNDING)
    assert found.interfaces.gap == pytest.approx(np.full((1, 9), PULL / stiffness), rel=ROUNDING,
                                                 abs=ROUNDING * exact)
    assert found.interfaces.pressure == pytest.approx(np.full((1, 9), -PULL), rel=ROUNDING)


def test_elastic_springs_in_shear():
    """τ = u / (2L/G + 1/k_t), normals kept by planes above and below."""
    sides = [{"on": name, "displacement": [0, None, None]} for name in ("zmin", "zmax")]
    problem = bars({"law": "elastic", "stiffness_n": 250.0, "stiffness_t": 40.0},
                   {"displacement": [0, 0, 0.3]})
    found = solved(problem, boundary=[*problem["boundary"], *sides])
    stress = 0.3 / (2 * LENGTH / (YOUNG / 2) + 1 / 40.0)
    assert found.interfaces.friction_traction[0, :, 2] == pytest.approx(np.full(9, stress),
                                                                        rel=ROUNDING)
    assert found.interfaces.slip[0, :, 2] == pytest.approx(np.full(9, stress / 40.0), rel=ROUNDING)


@pytest.mark.parametrize("pull", [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]])
def test_elastic_springs_on_steps(pull):
    """F = k A d with all the area of a cut that runs along tets, whichever way rigid halves go."""
    law = {"law": "elastic", "stiffness_n": 2.0, "stiffness_t": 2.0}
    found = solved(bars(law, {"displacement": pull}), materials=[{"young": 1e9, "poisson": 0.0}],
                   mesh={"box": {"size": [2 * LENGTH, 1, 1], "cells": [5, 2, 2]}},
                   subdomains={"grid": [2, 1, 1]})
    a, b, c = np.moveaxis(found.interfaces.points[0][found.interfaces.triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area > 1.2
    assert found.reactions[1, 0] == pytest.approx(2.0 * area * np.array(pull), abs=1e-6)


def test_elastic_springs_of_tension_only():
    """Slack where pushed, so that sides pass through each other; springs where pulled."""
    law = {"law": "elastic", "stiffness_n": 250.0, "stiffness_t": 100.0, "tension_only": True}
    found = solved(bars(law, {"displacement": [[-0.05, 0, 0], [0.05, 0, 0], [-0.1, 0, 0]]}))
    stress = 0.05 / (2 * LENGTH / YOUNG + 1 / 250.0)
    assert found.reactions[1, :, 0] == pytest.approx([0, stress, 0], abs=ROUNDING * stress)
    assert found.interfaces.gap[[0, 2]] == pytest.approx(np.repeat([[-0.05], [-0.1]], 9, axis=1),
                                                         rel=ROUNDING)


def test_glue_softens_and_breaks():
    """Traction rises to 10 with stiffness 4000, falls to 0 at .04, returns along the secant."""
    k, strength, toughness, stiff = 4000.0, 10.0, 0.2, YOUNG / 2
    first, last = strength / k, 2 * toughness / strength
    law = {"law": "cohesive", "stiffness": k, "strength": strength, "toughness": toughness}
    falls = strength / (last - first)
    led = [0.01, 0.03, 0.012, 0.06, -0.01]
    # on the falling branch E/L (u − d) = (δ₁ − d) falls
    d = (stiff * led[1] - falls * last) / (stiff - falls)
    secant = falls * (last - d) / d
    expected = [led[0] * stiff * k / (stiff + k), falls * (last - d),
                led[2] * stiff * secant / (stiff + secant), 0,
                led[4] * stiff * k / (stiff + k)]
    problem = bars(law, {"displacement": [[u, 0, 0] for u in led]},
                   mesh={"box": {"size": [2, 1, 1], "cells": [4, 2, 2]}})
    found = solved(problem)
    assert found.reactions[1, :, 0] == pytest.approx(expected, abs=1e-5 * strength)
    assert found.summary["status_counts"]["broken"] == [0, 0, 0, 9, 9]


def test_a_jump_moves_what_hangs_on_it():
    """Beside the bonded solution the far block moves by the jump, without further strain."""
    jump, end = np.array([0.001, -0.002, 0.003]), {"traction": [5.0, 0.0, -20.0]}
    bonded = solved(bars({"law": "perfect"}, end))
    moved = solved(bars({"between": ["slice 0", "slice 1"], "law": "jump", "jump": jump.tolist()},
                        end))
    for there, here, amount in zip(bonded.sides, moved.sides, (0.0, 1.0)):
        assert here - there == pytest.approx(np.broadcast_to(amount * jump, there.shape),
                                             abs=ROUNDING * np.abs(there).max())


def test_a_jump_between_held_ends():
    """Two springs E A/L in a row are stretched by a jump of 1, 0 and −2 hundredths."""
    law = {"law": "jump", "between": ["slice 0", "slice 1"], "jump": [0, 0, 0.01],
           "history": "steps"}
    found = solved(blocks([{"displacement": HELD}], law, histories={"steps": [1, 0, -2]}))
    assert found.reactions[1, :, 2] == pytest.approx(-YOUNG / 2 * np.array([0.01, 0, -0.02]),
                                                     abs=ROUNDING * YOUNG)


def test_a_gap_closes_before_it_carries():
    """p = E (u − g)/2L once the led end has come farther than the gap."""
    law = {"law": "contact", "friction": 0.2, "gap": 0.01}
    found = solved(blocks([{"displacement": [[0, 0, -0.005], [0, 0, -0.03], [0, 0, -0.005]]}], law))
    assert found.reactions[1, :, 2] == pytest.approx([0, -YOUNG * 0.02 / 2, 0],
                                                     abs=ROUNDING * YOUNG)
    assert found.summary["status_counts"]["open"] == [9, 0, 9]
    assert found.interfaces.gap[0] == pytest.approx(np.full(9, 0.005), rel=ROUNDING)


def test_an_interference_presses():
    """p = E δ/2L at every node and load step, growing with its history."""
    law = {"law": "contact", "friction": 0.2, "gap": -0.01, "history": "steps"}
    found = solved(blocks([{"displacement": HELD}], law, histories={"steps": [1, 0.5, 3]}))
    expected = YOUNG * 0.01 / 2 * np.array([1, 0.5, 3])
    assert found.interfaces.pressure == pytest.approx(np.repeat(expected[:, None], 9, axis=1),
                                                      rel=ROUNDING)
    assert np.abs(found.interfaces.friction_traction).max() < ROUNDING * expected.max()


def test_friction_grows_to_its_limit_and_stays():
    """Pressed by 10 and led: T grows with u, is μ N once all slides, less after it turns back."""
    led = [[x, 0, None] for x in (1e-3, 2e-3, 0.5, 1.0, 1.0 - 1e-3)]
    law = {"law": "contact", "friction": 0.2}
    problem = blocks([{"displacement": led}, {"pressure": 10.0}], law)
    found = solved(problem, method={"tolerance": {"error": 1e-6}})
    drag = found.reactions[1, :, 0]
    assert drag[1] == pytest.approx(2 * drag[0], rel=1e-4) and 0 < drag[1] < 2.0
    # directions of slip differ by as much as the blocks yield, 2.0 · 2L/GA, over 0.5 of the lead
    assert drag[2:4] == pytest.approx([2.0, 2.0], rel=0.5 * (2.0 * 2 / 500 / 0.5)**2)
    assert drag[4] < 2.0 - 0.5 * drag[0]
    counts = found.summary["status_counts"]
    assert counts["stick"] == [9, 9, 0, 0, 9] and counts["slip"] == [0, 0, 9, 9, 0]
    sheared = np.linalg.norm(found.interfaces.friction_traction[3], axis=1)
    assert sheared == pytest.approx(0.2 * found.interfaces.pressure[3], rel=1e-6), "at every node"


@pytest.mark.parametrize("share, carried", [(0.98, True), (1.02, False)])
def test_a_box_on_an_incline(share, carried):
    """Its weight is inclined by a, tan a = share · μ: it stays below 1 and slides above."""
    friction, weight = 0.3, 4.0
    problem = {"name": "incline",
               "parts": [box("slope", [4, 4, 1], [4, 4, 1]),
                         box("crate", [2, 2, 1], [2, 2, 1], [1, 1, 1])],
               "subdomains": "groups", "materials": [STEEL],
               "boundary": [{"on": "slope/zmin", "displacement": HELD}],
               "loads": [{"on": "crate",
                          "body_force": [weight / 4 * share * friction, 0, -weight / 4]}],
               "interfaces": [{"law": "contact", "friction": friction}],
               "method": {"tolerance": {"error": 1e-6}}}
    found = stopped(problem)
    assert found.converged == carried
    if carried:
        assert found.reactions[0, 0] == pytest.approx([-weight * share * friction, 0, weight],
                                                      abs=1e-5 * weight)
    else:
        assert found.stop_reason == "limit load"
        assert found.summary["limit_load"][0]["motions"][0]["body"] == "crate"


@pytest.mark.long
def test_hertz(tmp_path):
    """A cylinder on a block: half-width to half an element, largest pressure as well as that."""
    summary = run(CONFIGS / "hertz.yaml", tmp_path / "out")
    with np.load(tmp_path / "out" / "fields.npz") as f:
        x, z, pressure = *f["nodes"][f["interface_nodes"]][:, [0, 2]].T, f["pressure"]
    h, radius, effective = 0.01, 2.0, 200e3 / (2 * (1 - 0.3**2))
    for t, (force, p) in enumerate(zip(np.array(summary["reactions"])[0, :, 2], pressure)):
        force = 2 * force / 0.02  # both halves, per length
        a = np.sqrt(4 * force * radius / (np.pi * effective))
        p0 = 2 * force / (np.pi * a)
        line = np.unique(np.round(x[p > 0], 9))
        assert line.max() - h / 2 <= a <= line.max() + 1.5 * h, (t, a / h)
        assert p.max() == pytest.approx(p0, rel=0.5 * h / a), (t, a / h)


def ring(inner: float, outer: float, cells: tuple[int, int, int]):
    """A quarter of a ring, one element thick."""
    def bent(x):
        r, angle = inner + x[:, 0] * (outer - inner), x[:, 1] * np.pi / 2
        return np.c_[r * np.cos(angle), r * np.sin(angle), 0.2 * x[:, 2]] * (1 - 1e-15)

    nodes, tets = bricks([1, 1, 1], cells, bent)
    nodes[np.abs(nodes) < 1e-12] = 0.0
    return nodes, tets


def test_shrunk_ring(tmp_path):
    """Lamé in plane strain; elements half as large are nearer.

    δ = p b (1 − ν²)/E ((c² + b²)/(c² − b²) + (b² + a²)/(b² − a²))
    """
    a, b, c, fit = 1.0, 2.0, 3.0, 0.002
    yields = (c**2 + b**2) / (c**2 - b**2) + (b**2 + a**2) / (b**2 - a**2)
    exact = fit * 200e3 / (1 - 0.3**2) / b / yields
    found = []
    for n in (4, 8):
        mesh = written(tmp_path / f"{n}.msh", hub=ring(a, b, (n, 2 * n, 1)),
                       ring=ring(b, c, (n, 2 * n, 1)))
        solution = solved({"name": "shrunk", "mesh": mesh, "subdomains": "groups",
                           "materials": [STEEL],
                           "boundary": [*rollers("x", "y", "z"), *rollers("z", at=0.2)],
                           "interfaces": [{"law": "contact", "friction": 0.0, "gap": -fit}],
                           "method": {"tolerance": {"error": 1e-6}}})
        pressed = solution.interfaces
        assert not np.any(pressed.status == OPEN)
        found.append(np.average(pressed.pressure[0], weights=pressed.area))
    coarse, fine = np.abs(np.array(found) - exact)
    assert fine <= coarse / 2 and fine <= abs(found[1] - found[0]), (found, exact)


@pytest.mark.parametrize("then, share", [("locked", 3 / 4), ("force", 0.0)])
def test_a_bolt_takes_its_share(then, share):
    """Once locked it takes k_b/(k_b + k_s) of a pull; nothing while its force is kept."""
    columns = [box("bolt", [1, 1, 3], [1, 1, 3], [1, 0, 0]), box("left", [0.5, 1, 3], [1, 1, 3]),
               box("right", [0.5, 1, 3], [1, 1, 3], [2.5, 0, 0])]
    found = solved({
        "name": "bolted", "parts": columns, "subdomains": "groups",
        "materials": [{"young": YOUNG, "poisson": 0.0},
                      {"young": 3 * YOUNG, "poisson": 0.0, "on": "bolt"}],
        "boundary": [{"on": on("z", 0), "displacement": HELD},
                     {"on": on("z", 3), "displacement": [HELD, [0, 0, 0.06], HELD]}],
        "histories": {"tighten": [1, 1, 1]},
        "bolts": [{"on": "bolt", "cut": on("z", 2), "force": 100.0, "history": "tighten",
                   "then": then}], **EXACT})
    (bolt,) = found.summary["bolts"]
    total = found.reactions[1, :, 2]
    sleeves = YOUNG * 0.06 / 3
    assert bolt["force"] == pytest.approx([100, 100 + sleeves * share / (1 - share), 100],
                                          rel=ROUNDING)
    assert total == pytest.approx([100, bolt["force"][1] + sleeves, 100], rel=ROUNDING)
    assert bolt["shortening"][0] == pytest.approx(100 * 3 / (3 * YOUNG), rel=ROUNDING)
