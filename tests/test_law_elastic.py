"""Springs between the sides of an interface: closed forms, a monolithic solution, other laws beside them, what is told."""


import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from contact_case import BOTTOM, TOP, contact
from in_process import IN_PROCESS
from quick import late, quick
from benchmarks.monolithic import Monolithic
from test_laws import assert_consistent

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.laws.base import Written
from orchestrator.run import solve
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


# --- closed forms -----------------------------------------------------------------------------------------


def test_a_body_on_slack_springs_is_weakly_held():
    """The middle one of three bars, on tangential springs alone: it could still move along them."""
    ends = {"on": {"plane": "x", "at": 3 * LENGTH}, "displacement": [[-0.05, 0, 0], [0.05, 0, 0]]}
    found = converged(bars(springs(tension_only=True), count=3, at_the_end=ends))
    assert found.summary["weakly_held"] == [["slice 1"], []] and found.summary["detached"] == [[], []]


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
@pytest.mark.parametrize("normal, tangential", [(2e5, 5e4), late(2e7, 1e3)])
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
