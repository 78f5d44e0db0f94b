"""What the energy error consists of, as an equality, beside solutions in one piece that are exact to rounding.

    E² = ‖v − û‖² + 2 Σ γ(v, λ̂)
       = ‖v − u‖² + ‖û − u‖² + 2 Σ [p g(v) + p̂ g(u) + (μ p |Δv| − λ_t·Δv) + (μ p̂ |Δu| − λ̂_t·Δu)] − 2 Σ μ (p − p̂)(|Δv| − |Δu|)

in the first load step, with slips Δ; without friction the last sum is not there, in later load steps neither may be friction. Both sides
have a sum of their own here, of iterates that are still far from the solution, so that rounding is far below E².
"""

from functools import partial

import numpy as np
import pytest
from contact_case import BOTTOM, TOP, contact
from in_process import IN_PROCESS
from mortar_case import TWO, blocks, free_mesh
from quick import quick
from test_certificate import Exact, at_pairs, case, certified

from orchestrator.method.stopping import certificate, dual_energy
from orchestrator.scene.build import build_scene

EQUAL = 1e-9
ITERATIONS = 2
CLOSE = 1e-12  # of the dual energy, what is left of it
ONCE = {"boundary": [BOTTOM, {"on": TOP, "displacement": [0.01, 0, -0.005]}]}
CUBES = {"mesh": {"box": {"size": [1, 1, 1], "cells": [6, 6, 6]}}, "subdomains": {"grid": [3, 3, 3]}}
ERROR = {"method": {"tolerance": {"error": 1e-9}}}
BONDED = [{"law": "contact", "friction": 0.0}, {"between": ["block 0-0-0", "block 1-0-0"], "law": "perfect"}]


def closely(patch):
    """Lets the error be known to ``CLOSE``, from above or by the tail of the conjugate gradients."""
    patch.setattr(certificate, "Enough", partial(dual_energy.Enough, share=CLOSE, tail=CLOSE))


def apart(friction, path):
    held = [{"on": "a/zmin", "displacement": [0, 0, 0]}, {"on": "b/zmax", "displacement": path}]
    return blocks(TWO, {"a": free_mesh(TWO["a"][0], 0.4), "b": free_mesh(TWO["b"][0], 0.3)}, {"law": "contact", "friction": friction},
                  turn=None, held=held, method={"tolerance": {"error": 1e-9}})


SCENES = {
    "two blocks": lambda: case("blocks"),
    "two blocks, friction": lambda: case("blocks", 0.3, **ONCE),
    "edges where four meet, some bonded": lambda: case("cubes", law=BONDED),
    "edges where four meet, friction": lambda: case("cubes", 0.2, gap=0.001, **ONCE),
    "loose grains": lambda: case("grains", gap=0.002),
    "loose grains, friction": lambda: case("grains", 0.3, **ONCE),
    "27 cubes, nine of them loose": lambda: contact(0.0, **CUBES, **ERROR),
    "27 cubes, friction": lambda: contact(0.3, **CUBES, **ONCE, **ERROR),
    "six-node faces": lambda: case("cubes", blackbox={**IN_PROCESS, "element": "P2"}, **ONCE),
    "across meshes": lambda: apart(0.0, [[0, 0, -0.005], [0.01, 0, -0.005]]),
    "across meshes, friction": lambda: apart(0.3, [0.01, 0, -0.005]),
}


def exact_to_rounding(scene):
    """The solution in one piece, some Newton steps beyond what it is satisfied with."""
    exact = Exact(scene)
    exact.monolithic.tolerance, exact.monolithic.most = 0.0, 4
    exact.steps = exact.monolithic.solve([(step.parts, step.force) for step in exact.steps])
    exact.u = np.array([np.concatenate([part.ravel() for part in step.parts]) for step in exact.steps])
    return exact


def in_balance(exact, t, forces):
    """û, subdomain by subdomain."""
    one, u = exact.monolithic, np.where(exact.monolithic.free, 0.0, exact.u[t])
    right = one._loads(t) - one.pairs.D.T @ forces.ravel() - exact.K @ u
    for a, b in zip(one.offsets[:-1], one.offsets[1:]):
        at = a + np.flatnonzero(one.free[a:b])
        u[at] = np.linalg.lstsq(exact.K[at][:, at].toarray(), right[at], rcond=1e-12)[0]
    return u


def both_sides(exact, t, v, forces):
    """E² and what it consists of, relative."""
    pairs, step = exact.monolithic.pairs, exact.steps[t]
    gap, contact = pairs.at[t][0], pairs.contact
    square = lambda x: float(exact.norms(x[None])[0] ** 2)

    def split(u, force):
        """p, λ_t, g and Δ of the pairs that may open."""
        jump = (pairs.D @ u).reshape(-1, 3)
        (p, g), (shear, slip) = zip(*((along, x - along[:, None] * pairs.normal) for x in (force, jump)
                                      for along in [np.einsum("pi,pi->p", x, pairs.normal)]))
        return tuple(x[contact] for x in (-p, shear, gap + g, slip))

    def gamma(p, shear, g, slip):
        return float(np.sum(p * g + pairs.friction[contact] * p * np.linalg.norm(slip, axis=1) - np.einsum("pi,pi->p", shear, slip)))

    (p, shear, g, slip), (p_hat, shear_hat, g_v, slip_v) = split(exact.u[t], step.force), split(v, forces)
    u_hat, unit = in_balance(exact, t, forces), 2 / exact.size**2
    rubbed = np.sum(pairs.friction[contact] * (p - p_hat) * (np.linalg.norm(slip_v, axis=1) - np.linalg.norm(slip, axis=1)))
    assert not t or not pairs.friction.any()
    crossed = gamma(p, shear, g_v, slip_v) + gamma(p_hat, shear_hat, g, slip) - rubbed
    return (square(v - u_hat) + unit * gamma(p_hat, shear_hat, g_v, slip_v),
            square(v - exact.u[t]) + square(u_hat - exact.u[t]) + unit * crossed)


def hold_equal(scene, v, forces, errors, factor):
    """Both sides, and what is told, (T,) E times a factor, are one."""
    exact = exact_to_rounding(scene)
    for t in range(scene.steps):
        error, parts = both_sides(exact, t, v[t], forces(exact)[t])
        assert parts == pytest.approx(error, rel=EQUAL)
        told = (errors[t] / (factor if factor > 1 else 1.0) / exact.size) ** 2
        assert told == pytest.approx(error, rel=EQUAL)


@pytest.mark.parametrize("name", quick(SCENES, "edges where four meet, some bonded"))
def test_what_the_error_consists_of(name, monkeypatch):
    closely(monkeypatch)
    made = SCENES[name]()
    scene = build_scene(made)
    d, found = certified(scene, made, every=ITERATIONS, most=ITERATIONS)
    bound, v = found[0]
    hold_equal(scene, v, lambda exact: at_pairs(d, bound.pair.forces, exact), bound.steps, bound.factor)
