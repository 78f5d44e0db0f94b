"""The method: macro problems, fixed point, accelerations, error bound, loads, recovery."""

import itertools
from copy import copy

import numpy as np
import pytest
from method_case import CLAMP, CUBES, METIS, box_of, config, method, naked_beside, prepared, solved
from quick import late, quick, quick_sets

from orchestrator.blackbox.models import extended_model
from orchestrator.method.interface.pairing import make_pairs
from orchestrator.method.delivery.reference import solve_reference
from orchestrator.method.increments import Start, iterate
from orchestrator.method.latin import Latin
from orchestrator.method.linear.macro_basis import interface_basis
from orchestrator.method.monitors import Monitor, Verdict
from orchestrator.method.stopping.admissible_forces import AdmissibleForces
from orchestrator.method.stopping.bound import relative
from orchestrator.method.stopping.dual_energy import Enough, dual_energy
from orchestrator.method.stopping.softest import BesideRigid, softest
from orchestrator.scene.build import build_scene
from orchestrator.timing import Stopwatch

BENT = {"boundary": [CLAMP, {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 1.0, -2.0]}]}


def strained(**changes):
    """A solved problem whose stop is judged: the guaranteed bound holds and is not lax."""
    result = solved(**changes)
    error, bound = result.summary["true_error"], result.summary["error_bound"]
    assert result.summary["converged"] and error <= bound <= 5 * error
    return result


# --- macro basis ------------------------------------------------------------------------------------------


def curved(count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [3.0, 2.0, 1.0] + [50.0, -20.0, 7.0]


def plane(count, seed=0):
    """Points on a plane that is aligned with no axis."""
    points = curved(count, seed)
    normal = np.array([1.0, 2.0, -2.0]) / 3
    return points - (points @ normal)[:, None] * normal


def line(count):
    return np.linspace(0, 1, count)[:, None] * [1.0, 2.0, 3.0]


@pytest.mark.parametrize("points, sizes", [
    (curved(40), {"translations": 3, "rigid": 6, "affine": 12, "quadratic": 30}),
    (plane(40), {"translations": 3, "rigid": 6, "affine": 9, "quadratic": 18}),
    (line(9), {"translations": 3, "rigid": 5, "affine": 6, "quadratic": 9}),
    (curved(1), {"translations": 3, "rigid": 3, "affine": 3, "quadratic": 3}),
    (curved(2), {"translations": 3, "rigid": 5, "affine": 6, "quadratic": 6}),
    (curved(3), {"translations": 3, "rigid": 6, "affine": 9, "quadratic": 9}),
], ids=["curved", "plane", "line", "one node", "two nodes", "three nodes"])
def test_size_of_the_macro_basis(points, sizes):
    """12 affine fields, 9 on a plane (paper, section 4.1.1); what is dependent is dropped, the rest orthonormal."""
    free = np.ones(points.shape, bool)
    for kind, size in sizes.items():
        basis = interface_basis(points, free, kind)
        assert basis.shape == (points.size, size)
        assert np.abs(basis.T @ basis - np.eye(size)).max() < 1e-13


def test_clamped_components_leave_the_basis():
    """Prescribed dofs are no rows of W, and fields that only live there are gone."""
    points, free = plane(40), np.ones((40, 3), bool)
    free[:, 2] = False
    assert interface_basis(points, free, "affine").shape == (80, 6)
    assert interface_basis(points, free, "translations").shape == (80, 2)
    free[:10] = False
    assert interface_basis(points, free, "affine").shape == (60, 6)
    assert interface_basis(points, np.zeros((40, 3), bool), "affine").shape == (0, 0)


def test_basis_holds_what_its_name_says():
    """Rigid motions lie in span(W) of rigid, affine and quadratic, also where components are prescribed."""
    points, free = curved(25), np.ones((25, 3), bool)
    free[3:9, 1] = False
    spin = np.cross([0.3, -1.0, 0.5], points)[free]
    for kind in ("rigid", "affine", "quadratic"):
        basis = interface_basis(points, free, kind)
        assert np.linalg.norm(spin - basis @ (basis.T @ spin)) < 1e-10 * np.linalg.norm(spin)
    basis = interface_basis(points, free, "translations")
    assert np.linalg.norm(spin - basis @ (basis.T @ spin)) > 0.01 * np.linalg.norm(spin)


# --- admissibility after every linear stage ---------------------------------------------------------------

MESHES = {"slices": BENT, "cubes": {**CUBES, **BENT}, "metis": {**METIS, **BENT}}


@pytest.mark.parametrize("mesh, basis", quick_sets(itertools.product(MESHES, ["translations", "rigid", "affine", "quadratic"]),
                                                   ("slices", "quadratic"), ("cubes", "rigid"), ("metis", "quadratic")))
def test_forces_are_macro_balanced_after_every_stage(mesh, basis):
    """Wᵀ A f = 0, eq. 17, to 1e-10 of the largest resultant, whatever the state of the iterations."""
    result = solved(reference=False, **MESHES[mesh],
                    **method(macro={"basis": basis}, tolerance={"error": 1e-5}, max_iterations=40))
    history = result.iterated.history
    assert len(history) > 3
    assert max(e.macro_imbalance for e in history) <= 1e-10


@pytest.mark.parametrize("strategy", ["equilibrium", "continuity"])
@pytest.mark.parametrize("kind", quick(["layer", "symmetric"], "symmetric"))
def test_the_condition_of_each_strategy(strategy, kind):
    """Interface by interface: Wᵀ(f + f') = 0, or Fᵀ(w' − w) = 0 with F = (k + k')W, eq. 17 and eq. 35."""
    made = config(**CUBES, **BENT, **method(sole={"kind": kind}, macro={"strategy": strategy}))
    scene = build_scene(made)
    rng = np.random.default_rng(0)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        s = rng.standard_normal((scene.steps, d.space.size)) * 10
        fields = d.stage(s)
    k = d.stage.direction.k + d.stage.direction.other
    violated, other = [], []
    for interface, (one, two) in zip(scene.interfaces, d.space.sides):
        W = interface_basis(scene.mesh.nodes[interface.global_nodes], interface.free, "affine")
        force = (fields.f[:, one] + fields.f[:, two]) @ W / np.linalg.norm(fields.f)
        F = k[one][:, one] @ W
        jump = (fields.w[:, two] - fields.w[:, one]) @ F / (np.linalg.norm(F) * np.linalg.norm(fields.w))
        violated.append(np.abs(force if strategy == "equilibrium" else jump).max())
        other.append(np.abs(jump if strategy == "equilibrium" else force).max())
    assert max(violated) <= 1e-11
    assert max(other) > 1e-4, "the other strategy's condition is not met by accident"


def whole_fields(d, blackbox, s, fields):
    """Subdomain by subdomain the fields of a linear stage at s, inside too."""
    robin, requests = d.space.loads(d.stage.robin_force(s, fields.alpha)), {}
    for e, (trace, force) in enumerate(zip(d.made.traces, d.loading.forces)):
        requests[e] = np.zeros((len(s), 3 * d.made.node_counts[e]))
        requests[e][:, : force.shape[1]] = force
        requests[e][:, trace] += robin[:, d.space.boundary[e]]
    return blackbox.fields(requests)


def test_subdomains_are_in_equilibrium_after_every_stage():
    """K_E u_E = f_d + Nᵀf on all free dofs, eq. 13, for a state far from convergence."""
    made = config(**METIS, **BENT)
    with naked_beside(made) as (scene, blackbox, d, naked):
        s = np.random.default_rng(1).standard_normal((1, d.space.size))
        fields = d.stage(s)
        u = whole_fields(d, blackbox, s, fields)
    forces = d.space.loads(fields.f)
    for e, subdomain in enumerate(scene.subdomains):
        size, trace = 3 * len(subdomain.nodes), d.made.traces[e]
        external = subdomain.loads[0].ravel().copy()
        external[trace] += forces[0, d.space.boundary[e]]
        free = ~subdomain.fixed.ravel()
        residual = (naked[e] @ u[e][0, :size] - external)[free]
        assert np.abs(residual).max() <= 1e-9 * np.abs(external).max()


# --- fixed point ------------------------------------------------------------------------------------------


STRATEGIES, KPLUS, KINDS = ["none", "equilibrium", "continuity"], ["exchange", "full", "diagonal"], ["layer", "symmetric"]


# Every pair of choices is in one of each two.
@pytest.mark.parametrize("strategy, kplus, kind", quick_sets(itertools.product(STRATEGIES, KPLUS, KINDS), *(
    (strategy, kplus, KINDS[(i + j) % 2]) for i, strategy in enumerate(STRATEGIES) for j, kplus in enumerate(KPLUS))))
def test_the_fixed_point_is_the_undecomposed_solution(strategy, kplus, kind):
    """s* = f + k w of the undecomposed solution is its own image, for every choice of k⁺, k⁻ and macro problem."""
    made = config(**BENT, **method(sole={"kind": kind}, macro={"strategy": strategy},
                                   search_direction={"kplus": kplus}, max_iterations=1))
    scene = build_scene(made)
    with box_of(made) as whole:
        exact = solve_reference(scene, whole)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        naked = blackbox.stiffness([extended_model(scene, s, [], []) for s in scene.subdomains])
        f, w = np.empty((1, d.space.size)), np.empty((1, d.space.size))
        for e, subdomain in enumerate(scene.subdomains):  # slices: no cross points, forces are unique
            u = exact.displacement[0, subdomain.nodes].ravel()
            force = (naked[e] @ u - subdomain.loads[0].ravel())[d.made.traces[e]]
            own = np.flatnonzero(d.space.owner == e)
            local = d.space.gather[own] - d.space.boundary[e].start
            f[0, own], w[0, own] = force[local], u[d.made.traces[e]][local]
        s = f + d.stage.direction.times(w)
        fields = d.stage(s)
        image = d.local(fields).s
        outcome = iterate(d, made.method, (), Stopwatch(), Start(s))
    assert np.abs(fields.w - w).max() <= 1e-9 * np.abs(w).max()
    assert np.abs(fields.f - f).max() <= 1e-9 * np.abs(f).max()
    assert np.abs(image - s).max() <= 1e-9 * np.abs(s).max()
    assert outcome.converged and outcome.iterations == 1


class Watcher(Monitor):
    """Has the acceleration begin anew after the third iteration, and asks for another sweep each time."""

    name = "watcher"

    def judge(self, now):
        return Verdict(changes=(self.name,), anew=True, sweeps=2.0) if now.number == 3 else Verdict(sweeps=2.0)

    def change(self, now):
        return now.problem


class Ends(Monitor):
    """Sees what those before it have said."""

    name = "ends"

    def judge(self, now):
        assert now.verdict.sweeps == 2.0 and (now.verdict.changes == ("watcher",)) == (now.number == 3)
        return Verdict(reason="enough" if now.last else "", sweeps=1.0)


@pytest.mark.parametrize("memory, depth", [("auto", 99), (1, 2)])
def test_iterations_are_counted_and_monitors_are_heard_in_order(memory, depth):
    """Sweeps are those of all load steps; what is forgotten or begun anew decides about nothing; the last has no next state."""
    made = config(**method(memory=memory), boundary=[CLAMP, {"on": "xmax", "traction": [[10.0, 1.0, 0.0], [0.0, 1.0, 2.0]]}])
    with box_of(made) as blackbox:
        d, sweeps = prepared(made, build_scene(made), blackbox), []
        for problem in (d, d.batch([0], None)):
            latin = Latin(problem, made.method, [Watcher(), Ends()], Stopwatch())
            assert latin.number == latin.sweeps == latin.taken == latin.evaluations == 0
            latin.s, latin.last = np.zeros((problem.steps, d.space.size)), 5
            for number, taken in enumerate((1, 2, 0, 1, 2), 1):
                s = latin.s
                now = latin.iterate()
                assert (latin.number, latin.taken, now.last) == (number, taken, number == 5)
                assert latin.evaluations == min(taken, depth)
                assert np.array_equal(now.fields.s, s)
                assert np.array_equal(latin.s, s) == (number in (3, 5))
            assert now.verdict.reason == "enough"
            sweeps.append(latin.sweeps)
    assert sweeps[0] == pytest.approx(5 * 3 + 4) and sweeps[1] == pytest.approx(sweeps[0] / 2), "the first stage is free"


# --- error bound ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy, kind, ratio", [("none", "symmetric", 0.5), ("none", "layer", 0.01),
                                                   ("continuity", "layer", 0.1), ("equilibrium", "layer", 10.0),
                                                   ("equilibrium", "symmetric", 0.008)])
@pytest.mark.long
def test_the_bound_holds_for_every_search_direction(strategy, kind, ratio):
    """Soft and stiff soles, mono-scale too: the bound does not depend on them, the paper's η does."""
    changes = method(sole={"kind": kind, "modulus_ratio": ratio}, macro={"strategy": strategy},
                     tolerance={"error": 1e-5})
    strained(**CUBES, **BENT, **changes)


@pytest.mark.parametrize("mesh", quick(MESHES, "metis"))
@pytest.mark.parametrize("kind, ratio", [late("symmetric", 0.5), ("layer", 0.01), late("layer", 10.0)])
def test_dual_energy(mesh, kind, ratio):
    """b² = hᵀS⁺h from a few steps of conjugate gradients: not below the exact value, at most 10 % above. What is known to be
    too large is left early, and is smaller than the bound."""
    made = config(**MESHES[mesh], **method(sole={"kind": kind, "modulus_ratio": ratio}, max_iterations=4))
    with naked_beside(made) as (scene, blackbox, d, naked):
        fields = iterate(d, made.method, (), Stopwatch()).fields
        s = fields.f
        balanced = 0.5 * (s - d.space.across(s))
        h = d.space.loads(s - balanced)
        first = dual_energy(d.stage, h, np.zeros(1), Enough())
        estimate, sweeps, *_ = first
        early, spent, *_ = dual_energy(d.stage, h, np.zeros(1), Enough(), lambda total: total[0] > 0.1 * estimate[0])
        closer = Enough(share=1e-6)
        whole = dual_energy(d.stage, h, np.zeros(1), closer)
        on, other = (dual_energy(d.stage, h, np.zeros(1), closer, begun=begun) for begun in (first, first._replace(of=2 * h)))
        full = d.bound(fields)
        asked = 0.1 * full.relative
        part = d.bound(fields, useful=asked)
    # what is known is gone on from, unless it is of other forces
    assert on.sweeps < whole.sweeps == other.sweeps and abs(on.energy[0] / whole.energy[0] - 1) < 0.05
    assert np.array_equal(other.x, whole.x) and np.abs(on.x - whole.x).max() < 0.01 * np.abs(whole.x).max()
    assert spent <= sweeps and 0.1 * estimate[0] < early[0] <= estimate[0]
    assert part.relative == np.inf and asked < part.least <= full.relative and part.sweeps <= full.sweeps
    assert part.a == full.a
    exact = 0.0
    for e, subdomain in enumerate(scene.subdomains):
        free = ~subdomain.fixed.ravel()
        force = np.zeros(len(free))
        force[d.made.traces[e]] = h[0, d.space.boundary[e]]
        modes = d.made.modes[e][free]  # in balance with the force: stiffening them changes nothing
        stiffness = naked[e][free][:, free].toarray() + 200e3 * modes @ modes.T
        exact += force[free] @ np.linalg.solve(stiffness, force[free])
    assert 1 <= estimate[0] / exact <= 1.1


@pytest.mark.parametrize("guaranteed", [False, True])
def test_bodies_that_count_no_longer_are_not_asked_again(guaranteed):
    """Of forces on three slices of a bar one of which has nearly all: the others are asked once or twice, and their share is told."""
    made = config(**method(max_iterations=4))
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        s = iterate(d, made.method, (), Stopwatch()).fields.f
        h = d.space.loads(0.5 * (s + d.space.across(s)))
        for e, part in enumerate(d.space.boundary):
            h[:, part] *= 1.0 if e == 1 else 1e-4
        pairs, modes = make_pairs(scene, d.space, d.stage.direction.whole), zip(d.made.modes, d.made.traces)
        rigid = AdmissibleForces(d.stage.direction, pairs, [m[t] for m, t in modes]).u
        softness = softest(d.stage, BesideRigid(d.stage, rigid)) if guaranteed else None
        asked, inner = [], d.stage.solve
        d.stage.solve = lambda f: asked.append([f[:, part].any() for part in d.space.boundary]) or inner(f)
        told = dual_energy(d.stage, h, np.zeros(1), Enough(share=1e-3), softness=softness)
        closely = dual_energy(d.stage, h, np.zeros(1), Enough(share=1e-9))
    exact = np.vdot(closely.x, h + closely.left)
    assert asked[0] == [True] * 4 and asked[told.sweeps - 1] == [False, True, False, False]
    assert exact <= told.energy[0] * (1 + 1e-9) <= 1.03 * exact


@pytest.mark.parametrize("kind", ["symmetric", "auto"])
def test_the_bound_is_the_hypotenuse_of_prager_and_synge(kind):
    """a² + b² − 2 δᵀδf is ‖u_D − û‖², subdomain by subdomain from K⁺; ‖u_D‖² is that of the fields; what is given with them counts."""
    pulled = {"on": {"plane": "x", "at": 4.0}, "traction": [[10.0, 1.0, -2.0], [0.0, 3.0, 4.0]]}
    made = config(**METIS, **method({"kind": kind}), boundary=[CLAMP, pulled])
    with naked_beside(made) as (scene, blackbox, d, naked):
        s = np.zeros((2, d.space.size))
        for _ in range(10):
            fields = d.stage(s)
            s, before = d.local(fields).s, s
        u = whole_fields(d, blackbox, before, fields)
        first, moved, a2 = d.bound.first(fields)
        full = d.bound(fields)
        coarse_digits = copy(d.bound)
        coarse_digits.floor = 0.25
        floored = coarse_digits(fields)
        weights = np.array([[1.0, -2.0], [0.5, 3.0]])
        combined = d.bound.for_cases(weights)(fields)
        change, balanced = d.bound.balance(fields.extended[1], d.space.extended(d.stage.trace(moved))[0])
    assert balanced and np.isnan(first.relative)
    h, delta, energy, b2, whole = d.space.loads(change), first.correction, np.zeros(2), np.zeros(2), np.zeros(2)
    for e, subdomain in enumerate(scene.subdomains):
        free, at = ~subdomain.fixed.ravel(), d.made.traces[e]
        shift, force = np.zeros((2, 2, len(free)))
        shift[:, at], force[:, at] = delta[:, d.space.boundary[e]], h[:, d.space.boundary[e]]
        field = u[e][:, : len(free)] + shift
        energy += np.einsum("ti,ti->t", field, (naked[e] @ field.T).T)
        modes = d.made.modes[e][free]
        stiffness = naked[e][free][:, free].toarray() + 200e3 * modes @ modes.T
        for total, r in ((b2, force), (whole, (naked[e] @ shift.T).T - force)):
            total += np.einsum("ti,it->t", r[:, free], np.linalg.solve(stiffness, r[:, free].T))
    assert first.energy == pytest.approx(energy, rel=1e-9)
    cross = np.einsum("ti,ti->t", delta, h)
    assert whole == pytest.approx(a2 + b2 - 2 * cross, rel=1e-8)
    assert (np.abs(2 * cross) > 0.1 * b2).all()
    size = np.sqrt(energy.max())

    def relative(squares, weights=None):
        errors = np.sqrt(squares) if weights is None else np.sqrt(squares) @ np.abs(weights)
        return errors.max() / (size - errors.max())

    assert relative(whole) * (1 - 1e-9) <= full.relative <= relative(whole + 0.1 * b2) < 1
    assert first.a == pytest.approx(relative(a2)) and first.sweeps == 0 < full.sweeps and full.least == 0
    assert floored.relative == pytest.approx(full.relative + 0.25, rel=1e-12)
    assert relative(whole, weights) * (1 - 1e-9) <= combined.relative <= relative(whole + 0.1 * b2, weights)


def test_errors_are_relative_to_what_the_exact_energy_is_at_least():
    assert relative(0.0, 0.0) == 0 and relative(1.0, 1.0) == np.inf == relative(2.0, 1.0)
    assert relative(1.0, 5.0) == 0.25 and 1e-12 < relative(1e-30, 1.0) < 1e-10, "no less than rounding"


def test_max_iterations_stops_with_a_valid_bound():
    """A run that gives up still reports a bound that holds."""
    result = solved(**CUBES, **BENT, **method(max_iterations=3))
    summary = result.summary
    assert not summary["converged"] and summary["stop_reason"] == "max_iterations" and summary["iterations"] == 3
    assert summary["true_error"] <= summary["error_bound"] < 1


# --- loads and load steps ---------------------------------------------------------------------------------

ROLLER = [{"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, None, None]},
          {"on": {"plane": "y", "at": 0.0}, "displacement": [None, 0.0, None]},
          {"on": {"plane": "z", "at": 0.0}, "displacement": [None, None, 0.0]}]
WEIGHT = {"loads": [{"body_force": [0.0, 0.0, -7.7e-5]}]}
LOADS = {
    "prescribed": {"boundary": [CLAMP, {"on": {"plane": "x", "at": 4.0}, "displacement": [0.01, None, -0.02]}]},
    "prescribed on rollers": {"boundary": [*ROLLER, {"on": {"plane": "x", "at": 4.0}, "displacement": [0.01, None, None]},
                                           {"on": {"plane": "z", "at": 2.0}, "traction": [0.0, 40.0, 0.0]}]},
    "prescribed along interfaces": {"boundary": [CLAMP, {"on": {"plane": "y", "at": 2.0}, "displacement": [None, None, 0.0]},
                                                 {"on": {"plane": "x", "at": 4.0}, "traction": [0.0, 3.0, 5.0]}]},
    "settled support": {"boundary": [{"on": {"plane": "x", "at": 0.0}, "displacement": [0.0, 0.03, 0.0]},
                                     {"on": {"plane": "x", "at": 4.0}, "displacement": [None, 0.0, 0.0]}]},
    "pressure": {"boundary": [CLAMP, {"on": {"plane": "z", "at": 2.0}, "pressure": 5.0}]},
    "weight": {"boundary": [CLAMP], **WEIGHT},
    "everything": {"boundary": [CLAMP, {"on": {"plane": "x", "at": 4.0}, "displacement": [1e-4, None, None]},
                                {"on": {"plane": "y", "at": 0.0}, "traction": [1.0, 2.0, 3.0]}], **WEIGHT},
}
PARTS = "prescribed", "prescribed on rollers", "settled support", "pressure", "weight"  # of what others load with


@pytest.mark.parametrize("loads, mesh, tolerance", [
    *(pytest.param(loads, METIS, 1e-6, id=f"{loads}-metis", marks=pytest.mark.long if loads in PARTS else []) for loads in LOADS),
    *(pytest.param(loads, CUBES, 1e-4, id=f"{loads}-cubes", marks=pytest.mark.long) for loads in LOADS)])
def test_loads_and_prescribed_displacements(loads, mesh, tolerance):
    """Against the undecomposed solution, to what is guaranteed; prescribed values are met exactly; the energy ½ u_Dᵀ K u_D is
    that of the delivered field, and reactions balance the loads to rounding, however loose the tolerance."""
    result = strained(**mesh, **LOADS[loads], **method(tolerance={"error": tolerance}))
    assert result.summary["error_bound"] <= tolerance
    scene, u = result.scene, result.displacement
    assert np.array_equal(u[:, scene.fixed], scene.prescribed[:, scene.fixed])
    flat = u.reshape(scene.steps, -1).T
    expected = 0.5 * np.sum(flat * (result.reference.stiffness @ flat), axis=0)
    assert np.allclose(result.summary["energy"], expected, rtol=1e-9, atol=0)
    held = [k for k, entry in enumerate(LOADS[loads]["boundary"]) if "displacement" in entry]
    supports = np.array(result.summary["reactions"])[held].sum(axis=0)
    assert np.abs(supports + scene.loads.sum(axis=1)).max() <= 1e-9 * np.abs(result.summary["reactions"]).max()


def test_no_load_at_all():
    """Nothing happens: converged at once, zero everywhere, no division by zero."""
    result = solved(boundary=[CLAMP])
    assert result.summary["converged"] and result.summary["iterations"] == 1
    assert not result.displacement.any() and result.summary["error_bound"] == 0 == result.summary["true_error"]


# --- delivered results ------------------------------------------------------------------------------------


def test_displacement_is_continuous_and_parts_close_to_it():
    """u_D is one field; each subdomain's own field differs from it by no more than the error allows."""
    result = solved(**METIS, **BENT, **method(tolerance={"error": 1e-3}))
    size = np.abs(result.displacement).max()
    for subdomain, part in zip(result.scene.subdomains, result.parts):
        gap = np.abs(part - result.displacement[:, subdomain.nodes]).max()
        assert gap <= 0.02 * size
    assert any(np.any(part != result.displacement[:, s.nodes])
               for s, part in zip(result.scene.subdomains, result.parts))


def test_sweeps_are_counted():
    """One back-substitution per subdomain and step and iteration, the first being free, plus the bound's own."""
    result = solved(reference=False, **CUBES, **BENT)
    sweeps, iterations = result.summary["sweeps"], result.summary["iterations"]
    assert sweeps["total"] == sweeps["setup"] + sweeps["iterations"]
    assert iterations - 1 < sweeps["iterations"] <= iterations - 1 + 3 * 12
    counted = [e.sweeps for e in result.iterated.history]
    assert counted == sorted(counted) and counted[-1] == sweeps["total"]
