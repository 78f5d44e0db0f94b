"""Guards: real faults of the black box, and fields that break what always holds, end a run by name."""

import shutil
import sys
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import scipy.sparse as sp
from contact_case import contact
from in_process import IN_PROCESS
from method_case import box_of, config, prepared
from public.helpers import groove
from rounded_traces import traces_of

from orchestrator.config.load import config_from
from orchestrator.errors import BlackBoxError
from orchestrator.method.delivery.balance import balance
from orchestrator.method.delivery.guards import failed_guards, with_noise, works
from orchestrator.method.delivery.interface_fields import interface_fields
from orchestrator.method.delivery.recovery import recover
from orchestrator.method.increments import iterate
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.stopping.law_residuals import LengthScale
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.mesh.geometry import unit
from orchestrator.scene.mesh.sources import bricks
from benchmarks.problems.hard_scenes import slices
from orchestrator.timing import Stopwatch

# Stands in front of FreeFEM, lets it work, then changes the displacements in its last reply.
CORRUPT = """#!{python}
import subprocess, sys
import numpy as np
code = subprocess.call([{freefem!r}, *sys.argv[1:]])
data, at, replies = open(sys.argv[-1], "rb").read(), 0, []
while at < len(data):  # ints, seconds, reals
    arrays = []
    for kind in (np.int64, float, float):
        count = int(np.frombuffer(data, np.int64, 1, at)[0])
        arrays.append(np.frombuffer(data, kind, count, at + 8).copy())
        at += 8 + 8 * count
    replies.append(arrays)
u = replies[-1][2]
asked, at, ops = open(sys.argv[-2], "rb").read(), 0, []
while at < len(asked):  # op, ints, reals
    ops.append(int(np.frombuffer(asked, np.int64, 1, at)[0]))
    at += 8
    for _ in range(2 * (ops[-1] != 5)):
        at += 8 + 8 * int(np.frombuffer(asked, np.int64, 1, at)[0])
if 2 in ops and len(replies) == 3 and u.size > 1:
    {fault}
with open(sys.argv[-1], "wb") as file:
    for arrays in replies:
        for array in arrays:
            file.write(np.int64(array.size).tobytes() + array.tobytes())
sys.exit(code)
"""
FAULTS = {
    "the sign": ("u *= -1", "negative strain energy"),
    "too soft": ("u *= 30", "negative strain energy"),
    "shuffled": ("u[:] = np.roll(u, 7)", "not reciprocal|negative strain energy"),
    "not a number": ("u[u.size // 2] = np.nan", "not finite"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.long
def test_corrupted_answers(tmp_path, monkeypatch, fault):
    change, message = FAULTS[fault]
    path = tmp_path / "corrupting"
    path.write_text(CORRUPT.format(python=sys.executable, freefem=shutil.which("FreeFem++"), fault=change))
    path.chmod(0o755)
    made = config(subdomains={"slices": {"axis": "x", "count": 2}},
                  mesh={"box": {"size": [4.0, 1, 1], "cells": [2, 1, 1]}}, blackbox={"transport": "file", "workers": 1})
    scene = build_scene(made)
    if fault == "the sign":  # the same problem is solved by the code itself
        assert solve(made, scene).converged
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", str(path))
    with pytest.raises(BlackBoxError, match=message) as caught:
        solve(made, scene)
    assert caught.value.exit_code == 3 and caught.value.subdomain.startswith("slice")


@pytest.fixture(scope="module")
def pressed():
    """Two blocks in contact, solved, with what the guards look at."""
    made = contact(0.3, error=1e-8, boundary=[
        {"on": "zmin", "displacement": [0, 0, 0]},
        {"on": "zmax", "displacement": [[0, 0, -0.01], [0.002, 0, -0.01]]}])
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        outcome = iterate(d, made.method, (), Stopwatch())
        return (d, outcome, recover(d, outcome.fields, outcome.bound)[1], interface_fields(d, outcome),
                LengthScale(d)(outcome.fields.u))


def test_sound_fields_pass(pressed):
    d, outcome, parts, interfaces, lengths = pressed
    assert outcome.converged and failed_guards(d, outcome, parts, interfaces, lengths) == []
    inner, outer, size = works(d, outcome, parts)
    assert inner == pytest.approx(outer, rel=1e-9) and (inner > 0).all()


def test_broken_fields_are_named(pressed):
    d, outcome, parts, interfaces, lengths = pressed
    wrong = [1.001 * u for u in parts]
    assert "external work differs" in failed_guards(d, outcome, wrong, interfaces, lengths)[0]
    high = interfaces.pressure.max()
    for name, values in {"tension": {"pressure": interfaces.pressure - high},
                         "penetration": {"gap": interfaces.gap - 1e-3},
                         "complementarity": {"gap": interfaces.gap + 1e-3},
                         "Coulomb's cone": {"friction_traction": interfaces.friction_traction + high}}.items():
        found = " ".join(failed_guards(d, outcome, parts, replace(interfaces, **values), lengths))
        assert name in found, name
    assert "finite" in failed_guards(d, outcome, [np.full_like(u, np.nan) for u in parts], None)[0]


@pytest.mark.parametrize("share, found", [(1.0, False), (1 + 1e-5, True)], ids=["as solved", "falsified"])
def test_balance_of_every_body(pressed, share, found):
    """One force of an interface falsified at one node: the bodies beside it are named, in forces and in moments."""
    d, outcome, parts, interfaces, lengths = pressed
    pressure = interfaces.pressure.copy()
    node = pressure[1].argmax()
    pressure[1, node] += (share - 1) * np.abs(pressure[1]).sum()
    wrong = failed_guards(d, outcome, parts, replace(interfaces, pressure=pressure), lengths)
    assert any("out of balance" in sentence for sentence in wrong) == found
    both = balance(d, parts, outcome.fields.f, replace(interfaces, pressure=pressure))
    assert both.names == ["block 0-0-0", "block 0-0-1"]
    apart = np.abs(both.left).max(axis=0) / both.size.max()
    assert ((apart > 1e-7).any(axis=1) == found).all()


@pytest.mark.parametrize("digits, trusted", [(6, False), (17, True)])
@pytest.mark.long
def test_answers_of_few_digits(digits, trusted):
    """Six digits cannot carry an error of 1e-6; the run says so instead of claiming it."""
    made = config(subdomains={"slices": {"axis": "x", "count": 2}},
                  mesh={"box": {"size": [4.0, 1, 1], "cells": [4, 1, 1]}}, blackbox={"transport": "file", "workers": 1})
    with traces_of(digits):
        solved = solve(made, build_scene(made), reference=True)
    assert solved.converged == trusted
    if trusted:
        assert solved.summary["true_error"] <= solved.summary["error_bound"]
    else:
        assert "no error below" in solved.stop_reason


@pytest.mark.parametrize("modulus, tolerance", [(1e3, 1e-7), (1e4, 1e-6), (1e6, 1e-6)])
@pytest.mark.long
def test_rounding_in_stiff_soles_is_part_of_the_bound(modulus, tolerance):
    """f = s − k w cancels: what rounding leaves of w is multiplied by k."""
    stiff = config_from(slices(method={"sole": {"modulus_ratio": modulus, "allow_extreme": True},
                                       "tolerance": {"error": tolerance}, "max_iterations": 200}))
    solved = solve(stiff, build_scene(stiff), reference=True)
    true, bound = solved.summary["true_error"], solved.summary["error_bound"]
    assert true <= bound
    assert solved.converged == (bound <= tolerance) or "rounding" in solved.stop_reason


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1.0, 1e150])
def test_answers_are_compared_at_the_scale_of_their_loads(size):
    """A body at rest is asked with what rounding leaves: products of such numbers underflow, the answers are sound."""
    tight = 1e-9 * np.array([[2.0, 1.0], [1.0, 3.0]])
    for compliance, sound in ((tight, True), (np.array([[2e-9, 1e-9], [-1e-9, 3e-9]]), False)):
        answering = SimpleNamespace(traces=lambda forces, c=compliance: {e: f @ c for e, f in forces.items()})
        direction = SimpleNamespace(robin=np.zeros_like, robin_blocks=lambda some: [sp.csr_array((2, 2)) for _ in some],
                                    space=SimpleNamespace(boundary=[slice(0, 2)]))
        guarded = GuardedTraces(answering, direction, ["block"])
        expected = nullcontext() if sound or size < 1e-290 else pytest.raises(BlackBoxError, match="not reciprocal")
        with expected:
            guarded.traces({0: size * np.array([[1.0, 0.0]])})
            guarded.traces({0: 1e-3 * size * np.array([[0.0, 1.0]])})


@pytest.fixture(scope="module")
def pulled():
    """A bonded bar, solved, with what the guards look at."""
    made = config(subdomains={"slices": {"axis": "x", "count": 3}}, mesh={"box": {"size": [4.0, 1, 1], "cells": [12, 2, 2]}})
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        outcome = iterate(d, made.method, (), Stopwatch())
        return d, outcome, recover(d, outcome.fields, outcome.bound)[1]


@pytest.mark.parametrize("part", [0, 1, 2])
@pytest.mark.parametrize("share", [0.5, 1e-3])
def test_a_dof_that_is_off_is_seen_from_the_inside(pulled, part, share):
    """By half of the largest displacement, or a thousandth: the field's energy differs, or the bound grows; its body is named."""
    d, outcome, parts = pulled
    assert outcome.converged and failed_guards(d, outcome, parts, None) == []
    assert with_noise(d, outcome, parts).converged
    within = np.flatnonzero(~d.own[part].fixed.any(axis=1) & ~np.isin(np.arange(len(d.own[part].nodes)), d.made.traces[part] // 3))
    wrong = [u.copy() for u in parts]
    wrong[part][0, within[len(within) // 2], 1] += share * max(np.abs(u).max() for u in parts)
    noisy = with_noise(d, outcome, wrong)
    assert not noisy.converged and noisy.bound.relative > share and "can be claimed" in noisy.stop_reason
    found = " ".join(failed_guards(d, outcome, wrong, None))
    assert share < 0.1 or ("energy of the recovered field" in found and d.own[part].name in found)


def test_a_dof_that_is_off_in_contact(pressed):
    d, outcome, parts, interfaces, lengths = pressed
    for share in (0.5, 1e-3):
        wrong = [u.copy() for u in parts]
        free = np.flatnonzero(~d.own[1].fixed.all(axis=1))
        wrong[1][-1, free[len(free) // 2], 0] += share * np.abs(parts[1]).max()
        found = " ".join(failed_guards(d, outcome, wrong, interfaces, lengths))
        assert f"most in {d.own[1].name}" in found


def revolved(path, inner, outer, seed):
    """Write a ring of 12 and some bricks around, unevenly, between two profiles r(z); its mesh."""
    mesh, random = bricks(np.ones(3), np.array([1, 11 + seed, 3]), "ring"), np.random.default_rng(seed)
    even = np.linspace(0, 1, 12 + seed)
    turns = even + np.r_[0, random.uniform(-0.3, 0.3, 10 + seed), 0] / (11 + seed)
    share, z = mesh.nodes[:, 0], 3 * mesh.nodes[:, 2]
    angle = 2 * np.pi * np.interp(mesh.nodes[:, 1], even, turns)
    r = inner(z) * (1 - share) + outer(z) * share
    points = np.c_[r * np.cos(angle), r * np.sin(angle), z]
    _, first, place = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    meshio.write(path, meshio.Mesh(points[first], [("tetra", place.reshape(-1)[mesh.cells])]))
    return {"file": str(path)}


def leaning(self, *given, upright=Surfaces.upright):
    """Return an interface's normals, turned a little about the axis z."""
    normals, around = upright(self, *given), np.cross([0, 0, 1], self.points[0])
    return unit(normals + 0.02 * unit(around))


@pytest.mark.parametrize("profile", [lambda z: 2 + 0.25 * z, lambda z: 3 - np.sqrt(1 - (z / 2 - 0.75) ** 2)],
                         ids=["cone", "torus"])
def test_normals_that_lean_are_found_out(profile, tmp_path, monkeypatch):
    """Fits without friction that would carry a torque."""
    monkeypatch.setattr(Surfaces, "upright", leaning)
    rings = {"shaft": revolved(tmp_path / "shaft.msh", lambda z: 1 + 0 * z, profile, 1),
             "hub": revolved(tmp_path / "hub.msh", profile, lambda z: 4 + 0 * z, 4)}
    held = {"box": [[-1.1, -1.1, -0.1], [1.1, 1.1, 3.1]]}
    solution = solve(config_from({
        "name": "fit", "parts": [{"name": name, "mesh": mesh} for name, mesh in rings.items()],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
        "interfaces": [{"between": ["hub", "shaft"], "law": "contact", "friction": 0, "gap": -0.002}],
        "boundary": [{"on": held, "part": "shaft", "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 3}, "part": "hub", "displacement": [0, 0, 0]}],
        "method": {"tolerance": {"error": 1e-4}}, "blackbox": IN_PROCESS}))
    assert solution.stop_reason.startswith("check: ")


def test_normals_that_lean_are_found_out_where_coarse_facets_join_faces(tmp_path, monkeypatch):
    """A groove in a quarter of a shaft: a torus between two cylinders, each a CAD face."""
    monkeypatch.setattr(Surfaces, "upright", leaning)
    solution = solve(config_from({
        "name": "groove", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
        "parts": groove(tmp_path),
        "interfaces": [{"between": ["hub", "shaft"], "law": "contact", "friction": 0, "gap": -0.02}],
        "boundary": [{"on": {"plane": "z", "at": z}, "part": part, "displacement": [0, 0, 0]}
                     for part, z in (("shaft", 0), ("hub", 14))],
        "method": {"tolerance": {"error": 1e-4}}, "blackbox": IN_PROCESS}))
    assert solution.stop_reason.startswith("check: ")
