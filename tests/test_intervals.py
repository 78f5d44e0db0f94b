"""Intervals of displacements and forces, against solutions in one piece that share nothing with the method; and forces as delivered."""

from functools import cache

import numpy as np
import pytest
from boxes import boxed
from benchmarks.studies.intervals import LIKE, Exact, inside
from in_process import IN_PROCESS
from method_case import config as bar
from quick import late
from test_bolts import bar as bolted
from test_certificate import FRICTIONLESS, case

from orchestrator import InputError, build_scene, config_from, solve
from orchestrator.results.summary.lines import summary_rows

pytestmark = pytest.mark.xdist_group("intervals")  # scenes are solved once for several tests
ALL = ["reactions", "sections", "resultants", "bolts"]
ROUGH = 1e-2  # an error at which intervals are wide beside rounding
POINTS = [{"name": "inside", "at": [0.3, 0.6, 0.8], "certified": True}, {"name": "side", "on": "xmax", "certified": True},
          {"name": "low", "at": [0.7, 0.2, 0.1], "certified": True},
          {"name": "stressed", "at": [0.7, 0.2, 0.1], "quantity": "stress", "certified": True},
          {"name": "cut", "section": {"plane": "z", "at": 0.25}, "certified": True},
          {"name": "free", "on": "xmax", "quantity": "resultant", "certified": True},
          {"name": "foot", "on": {"plane": "z", "at": 0}, "quantity": "resultant", "certified": True}]


def certified(made, **output):
    """What a run of a configuration has found, and its scene."""
    data = made.complete()
    data["output"] = {"probes": POINTS, "certified": ALL, **output, "fields": False, "figures": False}
    config = config_from({**data, "method": {**data["method"], "tolerance": {"error": ROUGH}}})
    scene = build_scene(config)
    return solve(config, scene), scene


@cache
def frictionless(name):
    return certified(FRICTIONLESS[name]())


def judged(solved, scene):
    """Half widths over the largest value of each kind, where true values are within; kinds that are not known."""
    exact, widths, unknown = Exact(scene), [], 0
    found = solved.summary["intervals"]
    assert found["kind"] == "guaranteed"
    found = {**found, "probes": [one for probe, one in zip(scene.probes, found["probes"]) if probe.quantity != "mean"]}
    exact.scene.probes[:] = [probe for probe in scene.probes if probe.quantity != "mean"]
    every = [(LIKE.get(kind, kind), *(np.asarray(x, dtype=float) for x in values)) for kind, *values in exact.beside(found)]
    for kind, low, high, true in every:
        known, size = np.isfinite(low) & np.isfinite(high), max(np.abs(other).max() for one, _, _, other in every if one == kind)
        unknown += int((~known).sum())
        assert all(inside(kind, *each, size) for each in zip(low[known], high[known], true[known]))
        widths.append(((high - low)[known] / (2 * size)).max(initial=0.0))
    return np.array(widths), unknown


@pytest.mark.parametrize("top", [late({"displacement": [0.01, 0, -0.01]}), {"pressure": 100.0}])
def test_where_a_body_is_that_slides_freely_is_not_known(top):
    """However little asks for it: across, and not where it is pressed."""
    parts = [boxed("low", [1, 1, 0.3], [2, 2, 1]), boxed("amid", [1, 1, 0.3], [3, 3, 1], [0, 0, 0.3]),
             boxed("up", [1, 1, 0.3], [2, 2, 1], [0, 0, 0.6])]
    solved = solve(config_from({
        "name": "plates", "parts": parts, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"law": "contact"}], "boundary": [{"on": "low/zmin", "displacement": [0, 0, 0]}, {"on": "up/zmax", **top}],
        "method": {"tolerance": {"error": ROUGH}}, "output": {"probes": [{"at": [0.4, 0.6, 0.45], "certified": True}]}}))
    known = solved.summary["intervals"]["probes"][0]["values"]
    assert [np.isfinite([known[name]["low"], known[name]["high"]]).all() for name in ("ux", "uy", "uz")] == [False, False, True]


@pytest.mark.parametrize("name", ["loose grains", "a gap", "springs", "P2"])
def test_true_values_are_within(name):
    solved, scene = frictionless(name)
    widths, unknown = judged(solved, scene)
    assert not unknown and 0 < widths.max() <= 30 * solved.error_bound
    means = {probe["name"]: probe["values"] for probe in solved.summary["probes"]}
    for one in solved.summary["intervals"]["probes"]:
        for component, ends in one["values"].items() if one["name"] != "stressed" else ():  # what is delivered is within, too
            told = np.array(means[one["name"]][component])
            assert (np.array(ends["low"]) <= told).all() and (told <= np.array(ends["high"])).all()
    foot, reaction = (one["values"] if "values" in one else one for one in (
        solved.summary["intervals"]["probes"][-1], solved.summary["intervals"]["reactions"][0]))
    both = np.array([foot["fz"]["low"], foot["fz"]["high"]]), np.array([reaction["low"], reaction["high"]])[..., 2]
    assert np.allclose(*both, atol=0.1 * np.ptp(both[1]))  # one support: the same force, and as sharp
    assert "guaranteed" in dict(summary_rows(solved.summary))["certified"]


def test_bonds_are_cut():
    """A bar of slices, bonded alone: known by its loads at every cut."""
    sections = [{"name": f"at {x}", "section": {"plane": "x", "at": x}, "certified": True} for x in (1.4, 2.0)]
    solved, scene = certified(bar(), probes=[{"name": "end", "at": [4.0, 0.5, 0.5], "certified": True}, *sections])
    widths, unknown = judged(solved, scene)
    for one in solved.summary["intervals"]["probes"][1:]:  # along an interface, and not: loads behind it are all that counts
        ends = one["values"]
        assert ends["shear"]["low"][0] <= 1.0 <= ends["shear"]["high"][0] and "fx" in dict(summary_rows(solved.summary))["certified"]
        assert np.allclose([ends["normal"]["low"], ends["normal"]["high"]], 10.0, atol=1e-4)
    cuts = solved.summary["intervals"]["sections"]
    assert not unknown and len(cuts) == 3 and widths[-3:].max() < 1e-8  # a rigid end is all that moves, and has no energy
    assert np.allclose([one["low"] for one in cuts], [[[10.0, 1.0, 0.0]]], atol=1e-7)
    ux = solved.summary["intervals"]["probes"][0]["values"]["ux"]
    assert 0 < ux["high"][0] - ux["low"][0] < 4 * ROUGH * ux["high"][0]


def test_mean_stress_behind_faces():
    """Of a bar that is pulled: the same everywhere, over eight faces as over one."""
    solved = solve(config_from({
        "name": "pulled", "mesh": {"box": {"size": [4, 1, 1], "cells": [4, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": 200e3, "poisson": 0.0}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}],
        "output": {"probes": [{"name": "end", "on": "xmax", "of": "stress", "certified": True}], "fields": False, "figures": False}}))
    ends = solved.summary["intervals"]["probes"][0]["values"]
    assert np.allclose([ends["sxx"]["low"], ends["sxx"]["high"]], 10.0, atol=1e-3)
    assert ends["sxx"]["low"][0] <= 10.0 + 1e-9 and 10.0 - 1e-9 <= ends["sxx"]["high"][0]


def test_an_edge_that_bonds_share():
    """What each of them carries there is not determined: no interval is told, but of reactions."""
    solved, scene = certified(case("cubes", law=[{"law": "perfect"}]))
    assert judged(solved, scene)[1] == 4 * 6 * scene.steps  # forces and moments
    assert "not determined" in dict(summary_rows(solved.summary))["certified"]


def test_heated_and_held():
    """A box that cannot expand: −E α ΔT/(1 − 2ν) along all axes, whatever the iterations do."""
    data = bar().complete()
    data["materials"] = [{"young": 200e3, "poisson": 0.3, "expansion": 1e-5}]
    data["boundary"] = [{"on": face, "displacement": [0, 0, 0]} for face in ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")]
    data["loads"] = [{"temperature": 100.0}]
    probe = {"name": "inside", "at": [1.1, 0.3, 0.6], "quantity": "stress", "certified": True}
    solved = solve(config_from({**data, "output": {"probes": [probe], "fields": False, "figures": False}}))
    values = solved.summary["intervals"]["probes"][0]["values"]
    for name, expected in zip(("sxx", "syy", "szz", "sxy", "syz", "sxz", "von_mises"), (-500.0,) * 3 + (0.0,) * 4):
        low, high = values[name]["low"][0], values[name]["high"][0]
        assert low - 1e-6 <= expected <= high + 1e-6 and high - low < 1.0


def test_a_bolt():
    solved, _ = certified(config_from(bolted()), probes=[])
    bolt, = solved.summary["intervals"]["bolts"]
    force = np.array(solved.summary["bolts"][0]["force"])
    low, high = np.array(bolt["low"]), np.array(bolt["high"])
    assert (low <= force * (1 + 1e-9)).all() and (force * (1 - 1e-9) <= high).all() and (high - low).max() < 0.5 * force.max()


@pytest.mark.parametrize("name", ["loose grains", "bonded beside", "P2"])
def test_bodies_are_in_balance(name):
    """By reactions and by what interfaces carry, to rounding, though iterations end early; nothing pulls, nothing is pressed open."""
    solved, scene = frictionless(name)
    total = np.zeros((scene.steps, len(scene.subdomains), 3))
    for k, i in enumerate(scene.interfaces):
        for sign, e in zip((1, -1), i.subdomains):
            total[:, e] += sign * solved.answers.interfaces.resultants.force[:, k]
    held = [s.fixed.any() for s in scene.subdomains]
    size = np.abs(solved.answers.interfaces.resultants.force).max()
    assert np.abs(total[:, ~np.array(held)]).max(initial=0.0) <= 1e-10 * size
    assert np.abs(total.sum(axis=1) + np.sum(solved.reactions, axis=0)).max() <= 1e-10 * size
    fields = solved.fields.interfaces
    opens = np.isin(fields.interface_of_node, np.flatnonzero(fields.laws == "contact"))
    gap, pressure = fields.gap[:, opens], fields.pressure[:, opens]
    assert pressure.min() >= 0 and gap.min() >= -1e-12 and np.abs(np.minimum(gap / 1e-2, pressure / pressure.max())).max() < 0.1
    assert np.abs(fields.friction_traction[:, opens]).max() <= 1e-12 * pressure.max()


REFUSED = {
    "greatest stress": ({"probes": [{"on": "zmax", "quantity": "max", "of": "stress", "certified": True}]}, {}, "max of stress"),
    "extreme": ({"probes": [{"on": "zmax", "quantity": "max", "certified": True}]}, {}, "max of displacement"),
    "path": ({"probes": [{"along": [[0, 0, 0], [0, 0, 1]], "certified": True}]}, {}, "certified"),
    "residual": ({"certified": ["reactions"]}, {"method": {"tolerance": {"law": 1e-3}}}, "knows its energy error"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_interval_is_refused(name):
    output, changes, words = REFUSED[name]
    data = FRICTIONLESS["blocks"]().complete()
    with pytest.raises(InputError) as caught:
        config_from({**data, **changes, "output": output})
    assert words in str(caught.value)
