"""With what factor the energy error is guaranteed beside Coulomb's friction: against matrices in full, and solutions in one piece."""

import numpy as np
import pytest
from boxes import boxed
from contact_case import BOTTOM, TOP, contact
from in_process import IN_PROCESS
from method_case import box_of, prepared
from mortar_case import TWO, blocks, free_mesh
from quick import late
from test_certificate import GRAINS, NOISE, Exact, certified
from test_law_cohesive import bar

from orchestrator.errors import InputError
from orchestrator.laws.contact import Contact
from orchestrator.method.stopping.friction import OPEN, Friction
from orchestrator.registry import LAWS
from orchestrator.results.summary.lines import summary_rows
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

PRESSED = [0.01, 0, -0.005]


def pressed(friction, cells=2, top=PRESSED, error=1e-6, **changes):
    """Two blocks, held at both ends, in one load step."""
    made = {"mesh": {"box": {"size": [1, 1, 1], "cells": [cells, cells, cells]}}, "subdomains": {"grid": [1, 1, 2]},
            "boundary": [BOTTOM, {"on": TOP, "displacement": [top]}], **changes}
    return contact(friction, method={"tolerance": {"error": error}, "max_iterations": 300}, **made)


def apart(friction, first=0.4, second=0.3, error=1e-6, top=PRESSED):
    """The same meshed apart."""
    held = [{"on": "a/zmin", "displacement": [0, 0, 0]}, {"on": "b/zmax", "displacement": top}]
    return blocks(TWO, {"a": free_mesh(TWO["a"][0], first), "b": free_mesh(TWO["b"][0], second)}, {"law": "contact", "friction": friction},
                  turn=None, held=held, method={"tolerance": {"error": error}, "max_iterations": 300})


SIX = {"blackbox": {**IN_PROCESS, "element": "P2"}}  # six-node faces


HALVES = [boxed(name, [1, 1, 0.5], [2, 2, 2], [0, 0, z]) for name, z in (("soft", 0), ("stiff", 0.5))]
UNLIKE = {"mesh": None, "parts": HALVES, "subdomains": "groups",
          "materials": [{"young": 200e3, "poisson": 0.3}, {"young": 200.0, "poisson": 0.3, "on": "soft"}]}


class Full:
    """All matrices of a decomposition in full: S (B, B), jumps (3, P) of boundary displacements, pressures read off forces."""

    def __init__(self, d):
        self.of = Friction(d.certificate.pairs, d.certificate.stiffness, d.stage)
        unit, pairs = np.eye(len(d.space.global_dof)), d.certificate.pairs
        inverse = d.stage.solve(unit)
        self.S = np.linalg.inv(0.5 * (inverse + inverse.T)) - d.stage.direction.robin(unit)
        jumps = pairs.transfer.jump(d.space.extended(d.space.trace(unit))[0])
        self.jumps, self.across, normal = jumps.reshape(len(unit), -1).T, pairs.points.across(jumps), pairs.points.normal
        forces = (self.of.read @ d.space.trace(unit).T).reshape(3, len(pairs), -1)
        self.pressures = -np.einsum("ip,ipb->pb", normal, forces)
        self.normal = np.hstack([np.diag(along) for along in normal])
        self.rub = self.of.coefficient
        weighted = self.across * np.sqrt(self.rub * self.of.weight)
        root = np.linalg.cholesky(self.S)
        self.of_slips = np.linalg.norm(np.linalg.solve(root, weighted.reshape(len(unit), -1)), 2) ** 2
        read = self.pressures * np.sqrt(self.rub / self.of.weight)[:, None]
        self.of_pressures = np.linalg.eigvalsh(read @ (d.certificate.stiffness @ read.T))[-1]


@pytest.mark.parametrize("made", [pressed(0.1), late(pressed(0.1, 4)), apart(0.1), late(pressed(0.05, **SIX)),
                                  late(pressed(0.05, **SIX, **UNLIKE))])
def test_what_friction_hands_on(made):
    """Both eigenvalues are those of full matrices, from above; and no fields do worse than these say."""
    scene, rng = build_scene(made), np.random.default_rng(0)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        full, softness = Full(d), d.certificate.softness()
        slips, pressures = full.of._of_slips(softness), full.of._of_pressures()
        assert full.of_slips <= slips <= (1 + 2 * OPEN["slips"]) * full.of_slips
        assert full.of_pressures <= (1 + 1e-12) * pressures <= (1 + 2 * OPEN["pressures"]) * full.of_pressures
        factor = d.certificate.factor()
    assert full.pressures @ full.jumps.T == pytest.approx(full.normal, abs=1e-9)  # forces of the pairs alone are read, whatever these are
    q = np.sqrt(slips * pressures)
    assert factor == pytest.approx(1 / np.sqrt(1 - q**2))
    for _ in range(50):
        forces, x = rng.standard_normal(len(full.jumps)), rng.standard_normal(len(full.S))
        y = np.linalg.solve(full.S, full.jumps.T @ forces)
        handed_on = full.rub * np.abs(full.normal @ forces) @ np.linalg.norm((x @ full.across.reshape(len(x), -1)).reshape(3, -1), axis=0)
        assert handed_on <= q * np.sqrt((x @ full.S @ x) * (y @ full.S @ y))


@pytest.mark.parametrize("made", [pressed(0.05), pressed(0.2, 4), late(pressed(0.2, 4, [0.003, 0.001, -0.004])), late(pressed(0.1, 8)),
                                  late(pressed(0.2, 4, [-0.02, 0, -0.001], gap=-0.0005)), late(apart(0.1, 0.3, 0.22)), late(apart(0.05)),
                                  late(pressed(0.03, **SIX))])
def test_the_error_is_bounded_with_little_friction(made):
    scene = build_scene(made)
    d, found = certified(scene, made, every=3)
    exact, ratios = Exact(scene), []
    for bound, v in found:
        true = exact.norms(v - exact.u).max()
        if true > NOISE:
            assert bound.guaranteed and bound.factor == d.certificate.factor() > 1
            ratios.append(bound.relative / true)
    assert ratios and min(ratios) >= 1


OTHERS = {
    "much friction": lambda: pressed(0.4),
    "a history": lambda: pressed(0.05, boundary=[BOTTOM, {"on": TOP, "displacement": [PRESSED, PRESSED]}]),
    "a loose body": lambda: pressed(0.05, **GRAINS),
    "edges where four meet": lambda: pressed(0.01, subdomains={"grid": [2, 1, 2]}),
    "glue that breaks": lambda: bar([0.1], method={"tolerance": {"error": 1e-3}}),
}


@pytest.mark.parametrize("name", OTHERS)
def test_elsewhere_it_is_estimated(name):
    made = OTHERS[name]()
    with box_of(made) as blackbox:
        assert np.isnan(prepared(made, build_scene(made), blackbox).certificate.factor())


def test_beside_friction_that_is_nowhere_nothing_is_multiplied():
    made = pressed(0.0)
    with box_of(made) as blackbox:
        assert prepared(made, build_scene(made), blackbox).certificate.factor() == 1


def test_the_summary_says_with_what_factor():
    made = pressed(0.1, error=1e-3)
    solution = solve(made, build_scene(made))
    summary = solution.summary
    assert summary["error_kind"] == "guaranteed" and 1.01 < summary["error_factor"] < 1.2
    assert summary["error_bound"] == solution.error_bound <= 1e-3
    assert f"guaranteed, {summary['error_factor']:.3g} times" in dict(summary_rows(summary))["error bound"]


class Believed(Contact):
    """Says that it is convex whatever its friction."""

    name, convex = "believed", True


def test_a_law_that_says_that_it_is_convex_is_tried(request):
    LAWS.add("believed", Believed)
    request.addfinalizer(lambda: LAWS.remove("believed"))
    solve(made := pressed(0.0, law=[{"law": "believed", "friction": 0.0}], error=1e-3), build_scene(made))
    made = pressed(0.0, law=[{"law": "believed", "friction": 0.05}])
    with pytest.raises(InputError, match="believed says convex = True, and is not") as told:
        solve(made, build_scene(made))
    assert told.value.problems[0].path == ("interfaces",)
