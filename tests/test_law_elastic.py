"""Springs between the sides of an interface: closed forms, a monolithic solution, other laws beside them, what is told."""

import json

import meshio
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from contact_case import BOTTOM, TOP, contact
from in_process import FREEFEM, IN_PROCESS
from matplotlib import image
from quick import quick
from benchmarks.monolithic import Monolithic
from test_laws import assert_consistent

from orchestrator.config.load import config_from, load_config
from orchestrator.errors import InputError
from orchestrator.laws.base import Written
from orchestrator.results.figures.pictures import interfaces
from orchestrator.results.report.report import report
from orchestrator.results.history import read_history
from orchestrator.results.summary.summary import read_summary
from orchestrator.run import run, solve
from orchestrator.scene.build import build_scene

YOUNG, PULL, LENGTH = 1000.0, 10.0, 2.0
LEFT = {"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.0, 0.0]}


def springs(normal=250.0, tangential=100.0, **more) -> dict:
    return {"law": "elastic", "stiffness_n": normal, "stiffness_t": tangential, **more}


def bars(*laws, count=2, at_the_end=None, element="P1", unit=1.0, **changes):
    """Bars of 2 × 1 × 1 in a row, Poisson's ratio 0, pulled with 10; ``unit``: how many of the YAML's lengths make one."""
    end = at_the_end or {"on": {"plane": "x", "at": LENGTH * count * unit}, "traction": [PULL / unit**2, 0.0, 0.0]}
    scaled = [{k: v / unit**3 if k.startswith("stiffness") else v for k, v in law.items()} for law in laws]
    return config_from({
        "name": "bars", "mesh": {"box": {"size": [LENGTH * count * unit, unit, unit], "cells": [2 * count, 2, 2]}},
        "subdomains": {"slices": {"axis": "x", "count": count}}, "materials": [{"young": YOUNG / unit**2, "poisson": 0.0}],
        "boundary": [LEFT, end], "interfaces": scaled, "blackbox": {**IN_PROCESS, "element": element},
        "method": {"tolerance": {"law": 1e-10}}, "output": {"fields": False}, **changes})


def converged(made):
    found = solve(made, build_scene(made))
    assert found.iterated.converged, found.iterated.stop_reason
    return found


def elongation(found) -> np.ndarray:
    """(T, nodes at the pulled end)."""
    x = found.scene.mesh.nodes[:, 0]
    return found.displacement[:, np.isclose(x, x.max()), 0]


# --- closed forms -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("stiffness, element, unit", [
    (1.0, "P1", 1.0), (1.0, "P2", 1e3), (250.0, "P1", 1e-3), (250.0, "P1", 1e3), (1e9, "P1", 1e3), (1e9, "P2", 1e-3)])
def test_two_bars_and_a_spring_between(stiffness, element, unit):
    """δ = σ (2L/E + 1/k), whether the spring is soft or as good as rigid, in any unit of length."""
    found = converged(bars(springs(stiffness), element=element, unit=unit))
    exact = PULL * (2 * LENGTH / YOUNG + 1 / stiffness) * unit
    assert elongation(found) == pytest.approx(np.full(elongation(found).shape, exact), rel=1e-9)
    assert found.interfaces.gap == pytest.approx(np.full(found.interfaces.gap.shape, PULL / stiffness * unit), rel=1e-9, abs=1e-9 * exact)
    assert found.interfaces.pressure == pytest.approx(np.full(found.interfaces.gap.shape, -PULL / unit**2), rel=1e-9)
    assert set(found.summary["residuals"]) >= {"law_residual", "spring"} and found.summary["residuals"]["spring"] <= 1e-10
    assert found.summary["detached"] == [[]] and found.summary["weakly_held"] == [[]], "springs hold"


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_uniform_shear(unit):
    """δ = τ (2L/G + 1/k_t) where the normal is prescribed; at the rim parts of the normal are not there to act on."""
    sheared = {"on": {"plane": "x", "at": 2 * LENGTH * unit}, "displacement": [0.0, 0.0, 0.3 * unit]}
    sides = [{"on": {"plane": "z", "at": z * unit}, "displacement": [0.0, None, None]} for z in (0, 1)]
    made = bars(springs(250.0, 40.0), unit=unit, at_the_end=sheared)
    made = config_from({**made.complete(), "boundary": [*made.complete()["boundary"], *sides]})
    found = converged(made)
    stress = 0.3 / (2 * LENGTH / (YOUNG / 2) + 1 / 40.0) / unit**2
    assert found.interfaces.friction_traction[0, :, 2] == pytest.approx(np.full(9, stress), rel=1e-9)
    assert found.interfaces.slip[0, :, 2] == pytest.approx(np.full(9, stress * unit**3 / 40.0), rel=1e-9)
    assert np.abs(found.interfaces.pressure).max() <= 1e-9 * stress


def test_springs_of_tension_only():
    """Pushed together they carry nothing, and the sides pass through each other; pulled they are springs."""
    ends = {"on": {"plane": "x", "at": 2 * LENGTH}, "displacement": [[-0.05, 0, 0], [0.05, 0, 0], [-0.1, 0, 0]]}
    found = converged(bars(springs(tension_only=True), at_the_end=ends))
    stress = 0.05 / (2 * LENGTH / YOUNG + 1 / 250.0)
    carried = np.array([0.0, stress, 0.0])
    assert found.interfaces.pressure == pytest.approx(np.repeat(-carried[:, None], 9, axis=1), rel=1e-9, abs=1e-9 * stress)
    assert found.interfaces.gap[[0, 2]] == pytest.approx(np.repeat([[-0.05], [-0.1]], 9, axis=1), rel=1e-9)
    assert found.summary["status_counts"] == {"open": [0] * 3, "stick": [0] * 3, "slip": [0] * 3, "sprung": [0] * 3,
                                              "taut": [0, 9, 0], "slack": [9, 0, 9]}
    always = converged(bars(springs(), at_the_end=ends))
    assert always.interfaces.pressure[0] == pytest.approx(np.full(9, stress), rel=1e-9)


def test_a_body_on_slack_springs_is_weakly_held():
    """The middle one of three bars, on tangential springs alone: it could still move along them."""
    ends = {"on": {"plane": "x", "at": 3 * LENGTH}, "displacement": [[-0.05, 0, 0], [0.05, 0, 0]]}
    found = converged(bars(springs(tension_only=True), count=3, at_the_end=ends))
    assert found.summary["weakly_held"] == [["slice 1"], []] and found.summary["detached"] == [[], []]


def test_other_laws_beside():
    """Four bars pushed together: bonded, in contact, and on springs: δ = σ (4L/E + 1/k)."""
    names = [f"slice {i}" for i in range(4)]
    laws = [{"between": names[:2], "law": "perfect"}, {"between": names[1:3], "law": "contact", "friction": 0.3},
            {"between": names[2:], **springs()}]
    pushed = {"on": {"plane": "x", "at": 4 * LENGTH}, "traction": [-PULL, 0.0, 0.0]}
    found = converged(bars(*laws, count=4, at_the_end=pushed))
    exact = -PULL * (4 * LENGTH / YOUNG + 1 / 250.0)
    assert elongation(found) == pytest.approx(np.full((1, 9), exact), rel=1e-8)
    assert found.interfaces.laws.tolist() == ["contact", "elastic"]
    assert found.summary["status_counts"]["sprung"] == [9] and sum(found.summary["status_counts"][k][0] for k in ("stick", "slip")) == 9
    assert set(found.iterated.last.laws) == {"penetration", "tension", "cone", "slip_direction", "spring", "stabilisation", "body_residual"}


# --- against a monolithic solution ------------------------------------------------------------------------

SMALL = {"mesh": {"box": {"size": [1, 1, 1], "cells": [4, 4, 6]}}}
# pushed; sheared, so that one end opens and the other one closes; pulled and sheared
PATH = [[0.004, 0.0, -0.005], [-0.02, 0.003, 0.0], [0.01, 0.005, 0.005]]


def undecomposed(made, scene, normal, tangential, tension_only):
    """(T, N) displacements, subdomain after subdomain, and which springs are slack: K + springs, assembled by hand."""
    whole = Monolithic(scene)
    rows, values, stiff, direction = [], [], [], []
    for i in scene.interfaces:
        corners = scene.mesh.nodes[i.global_nodes[i.triangles]]
        vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area = np.zeros(len(i.global_nodes))
        np.add.at(area, i.triangles, np.linalg.norm(vectors, axis=1)[:, None] / 3)
        n = vectors.sum(axis=0) / np.linalg.norm(vectors.sum(axis=0))  # the interface is plane
        ends = [whole.offsets[e] + 3 * nodes[:, None] + np.arange(3) for e, nodes in zip(i.subdomains, i.nodes)]
        rows.append(np.concatenate(ends, axis=1))
        stiff.append(area)
        direction.append(np.tile(n, (len(area), 1)))
    rows, area, n = map(np.concatenate, (rows, stiff, direction))
    loads = np.stack([np.concatenate([s.loads[t].ravel() for s in scene.subdomains]) for t in range(scene.steps)])
    given = np.stack([np.concatenate([s.prescribed[t].ravel() for s in scene.subdomains]) for t in range(scene.steps)])
    fixed = np.concatenate([s.fixed.ravel() for s in scene.subdomains])
    found, loose = np.zeros_like(loads), np.zeros((scene.steps, len(area)), bool)
    for t in range(scene.steps):
        for _ in range(50):  # which springs are slack follows from the displacements, and these from that
            N = n[:, :, None] * n[:, None, :]
            k = area[:, None, None] * (tangential * (np.eye(3) - N) + normal * N * ~loose[t][:, None, None])
            values = np.block([[k, -k], [-k, k]])
            K = whole.K + sp.csr_array((values.ravel(), (np.repeat(rows, 6, axis=1).ravel(), np.tile(rows, 6).ravel())),
                                       shape=whole.K.shape)
            u = np.where(fixed, given[t], 0.0)
            u[~fixed] = sla.spsolve(sp.csc_array(K[~fixed][:, ~fixed]), (loads[t] - K @ u)[~fixed])
            now = tension_only & (np.einsum("pi,pi->p", u[rows[:, 3:]] - u[rows[:, :3]], n) < 0)
            if (now == loose[t]).all():
                break
            loose[t] = now
        else:
            raise AssertionError("the slack springs do not settle")
        found[t] = u
    return found, loose


@pytest.mark.parametrize("tension_only", quick([False, True], True), ids=["always", "tension only"])
@pytest.mark.parametrize("normal, tangential", [(2e5, 5e4), (2e7, 1e3)])
def test_monolithic_solution_agrees(normal, tangential, tension_only):
    """A block on another one: with springs of tension only, some are slack and some are not."""
    made = contact(law=[springs(normal, tangential, tension_only=tension_only)], error=1e-11, **SMALL,
                   boundary=[BOTTOM, {"on": TOP, "displacement": PATH}])
    scene = build_scene(made)
    found = converged(made)
    exact, loose = undecomposed(made, scene, normal, tangential, tension_only)
    ours = np.concatenate([part.reshape(scene.steps, -1) for part in found.parts], axis=1)
    assert np.abs(ours - exact).max() <= 1e-9 * np.abs(exact).max()
    slack = found.interfaces.status == found.interfaces.kinds[found.interfaces.kind_names == "slack"]
    assert slack.sum() == loose.sum() and (slack.any() == tension_only)
    if tension_only:
        assert slack[0].all() and 0 < slack[1].sum() < slack[1].size and not slack[2].all()


# --- what is told -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("tension_only", [False, True])
def test_force_derivative_and_statuses_belong_together(tension_only):
    assert_consistent("elastic", {"stiffness_n": 2.0, "stiffness_t": 0.7, "tension_only": tension_only})


def test_broken_springs_are_named():
    """The last look at every written node: forces and openings that do not belong together."""
    found = converged(bars(springs()))
    (i,), shape = found.scene.interfaces, found.interfaces
    sound = dict(opening=shape.gap - shape.initial_gap, slip=shape.slip, pressure=shape.pressure, shear=shape.friction_traction,
                 chosen=np.arange(9), length=np.ones(9))
    for change, name in (({}, None), ({"opening": sound["opening"] + 0.01}, "the normal springs' law"),
                         ({"pressure": 1.1 * sound["pressure"]}, "the normal springs' law"),
                         ({"slip": sound["slip"] + 0.01}, "the tangential springs' law")):
        broken = {what for what, value in i.law.violations(Written(**sound | change), 0.05, PULL).items() if value > 1e-8}
        assert broken == ({name} if name else set())


@pytest.mark.long
def test_from_the_configuration_to_the_report(tmp_path):
    """Columns, residuals, statuses, picture: those of springs, none of contact."""
    out, path = tmp_path / "out", tmp_path / "bars.yaml"
    ends = {"on": {"plane": "x", "at": 2 * LENGTH}, "displacement": [[-0.05, 0, 0], [0.05, 0, 0]]}
    made = bars(springs(tension_only=True), at_the_end=ends, output={"directory": str(out), "figures": False},
                blackbox=FREEFEM)
    path.write_text(json.dumps(made.complete()))
    assert run(load_config(path), output=out) == 0
    history, summary = read_history(out), read_summary(out)
    assert history["taut"][-1] == 9 and history["slack"][-1] == 9 and history["spring"][-1] <= 1e-10
    of_contact = {"penetration", "tension", "cone", "slip_direction"}
    assert not of_contact & (set(history) | set(summary["residuals"])) and summary["residuals"]["spring"] <= 1e-10
    text = report(out).read_text()
    assert "f_n = k_n A d_n" in text and "taut" in text and "spring law" not in text and "penetration" not in text
    picture = image.imread(out / "figures" / "interfaces.png")[..., :3]
    for colour in ("#56B4E9", "#F0E442"):  # taut, slack
        wanted = np.array([int(colour[k:k + 2], 16) / 255 for k in (1, 3, 5)])
        assert (np.abs(picture - wanted).max(axis=2) < 0.01).sum() > 1000, colour
    statuses = [meshio.read(out / "fields" / f"interface_000{step}.vtu").point_data["status"] for step in (1, 2)]
    assert (statuses[0] == 6).all() and (statuses[1] == 5).all()


def test_its_colours_have_its_names():
    """Of all that there may be, those that are drawn."""
    found = converged(bars(springs(), output={"fields": True}))
    shown = interfaces(found.fields, found.summary)
    assert found.fields.interfaces.kind_names.tolist() == ["bonded", "sprung", "taut", "slack"] and shown.kinds == ["sprung"]


WRONG = {
    "no normal stiffness": ({"law": "elastic", "stiffness_t": 1.0}, "stiffness_n", "add stiffness_n"),
    "no tangential stiffness": ({"law": "elastic", "stiffness_n": 1.0}, "stiffness_t", "add stiffness_t"),
    "negative": (springs(-1.0), "stiffness_n", "a number > 0"),
    "zero": (springs(1.0, 0.0), "stiffness_t", "a number > 0"),
    "a word": (springs("stiff"), "stiffness_n", "a number"),
    "not a switch": (springs(tension_only="yes"), "tension_only", "true or false"),
    "friction": (springs(friction=0.1), "friction", "friction with law: contact only"),
    "stiffness of contact": ({**springs(), "law": "contact"}, "stiffness_n", "write law: elastic"),
    "misspelt": ({**springs(), "law": "elastik"}, "law", "did you mean 'elastic'?"),
}


@pytest.mark.parametrize("entry, key, words", WRONG.values(), ids=WRONG)
def test_wrong_entries(entry, key, words):
    data = bars(springs()).complete()
    with pytest.raises(InputError) as caught:
        config_from({**data, "interfaces": [entry]})
    assert any(p.path == ("interfaces", 0, key) and words in str(p) for p in caught.value.problems)
