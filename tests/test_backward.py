"""What is delivered is an exact solution, for surfaces that are shifted a little: put back into the laws and into the bodies."""

from functools import cache

import numpy as np
import pytest
from benchmarks.kit.elasticity import stiffness
from contact_case import contact
from in_process import IN_PROCESS
from method_case import box_of, prepared
from mortar_case import TWO, blocks, free_mesh
from quick import quick
from test_bolts import bar as bolted
from test_certificate import PATH, case
from test_law_cohesive import LED, bar

from orchestrator.config.load import config_from
from orchestrator.method.delivery.deliver import deliver
from orchestrator.method.increments import iterate
from orchestrator.method.interface.pairs import History
from orchestrator.method.iterated import load_cases
from orchestrator.results.fields.files import write_fields
from orchestrator.results.fields.fields import read_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import summary_rows
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.timing import Stopwatch

pytestmark = pytest.mark.xdist_group("backward")  # scenes are solved once for several tests
HELD = [{"on": "a/zmin", "displacement": [0, 0, 0]}, {"on": "b/zmax", "displacement": PATH[:3]}]
SPRINGS = {"law": "elastic", "stiffness_n": 1e5, "stiffness_t": 1e3, "tension_only": True}
SCENES = {
    "without friction": lambda error: case("cubes", 0.0, error, gap=0.002),
    "friction with a history": lambda error: case("grains", 0.3, error),
    "a press fit": lambda error: case("blocks", 0.3, error, gap=-0.001),
    "little friction, six-node faces": lambda error: case("cubes", 0.02, error, blackbox={**IN_PROCESS, "element": "P2"}),
    "springs": lambda error: case("blocks", 0.0, error, law=[SPRINGS]),
    "a bolt, tightened, then locked": lambda error: config_from(bolted(method={"tolerance": {"error": error}})),
    "glue that breaks": lambda error: bar(LED, method={"tolerance": {"error": error}}),
    "across meshes that do not match": lambda error: blocks(
        TWO, {"a": free_mesh(TWO["a"][0], 0.3), "b": free_mesh(TWO["b"][0], 0.22)}, {"law": "contact", "friction": 0.3}, turn=None,
        held=HELD, method={"tolerance": {"error": error}, "max_iterations": 300}),
}
QUICK = "a press fit"
ROUGH = 1e-3


@cache
def delivered(name, error=ROUGH, closely=1e-18):
    """The decomposition, what its iterations ended with, and what is delivered, S⁺h solved to rounding."""
    made = SCENES[name](error)
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        d.certificate.closely = closely
        iterated = iterate(d, made.method, [], Stopwatch())
        return d, iterated, deliver(d, load_cases(scene), iterated, Stopwatch())


@pytest.mark.parametrize("name", quick(SCENES, QUICK))
def test_the_laws_hold_exactly_at_the_shifted_surfaces(name):
    d, iterated, found = delivered(name)
    pairs, forces, jumps = d.certificate.pairs, iterated.bound.pair.forces, found.contact.backward.jump
    before = History.none(len(pairs))
    for number, force, jump in zip(pairs.numbers, forces, jumps):
        F = force + pairs.points.stiffness(jump)
        answer = pairs.force(F, before, number)
        assert np.abs(answer.force - force).max() <= 1e-12 * max(np.abs(forces).max(), np.abs(F).max())
        before = History(jump, answer.own)


@pytest.mark.parametrize("name", quick([name for name in SCENES if "six-node" not in name], QUICK))
def test_the_bodies_are_in_equilibrium_where_the_surfaces_are_shifted_to(name):
    """K û = f_d − NᵀBᵀλ̂ and B û + δ = d', up to rigid motions of bodies that nothing holds, by other elements than ours."""
    d, iterated, found = delivered(name)
    scene, space, pairs, shifted = d.scene, d.space, d.certificate.pairs, found.contact.backward
    push = space.loads(pairs.transfer.opposed(iterated.bound.pair.forces)[:, : space.size])
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])
    u, motions = np.zeros((scene.steps, len(space.global_dof))), []
    for s, part, trace, modes in zip(d.own, space.boundary, d.made.traces, d.made.modes):
        K = stiffness(scene.mesh.nodes[s.nodes], s.connectivity, *moduli[s.material].T).toarray()
        free, right = ~s.fixed.ravel(), s.loads.reshape(scene.steps, -1).copy()
        right[:, trace] += push[:, part]
        field = np.where(free, 0.0, s.prescribed.reshape(scene.steps, -1))
        right -= field @ K
        field[:, free] = np.linalg.lstsq(K[np.ix_(free, free)], right[:, free].T, rcond=1e-11)[0].T
        assert np.abs(field[:, free] @ K[np.ix_(free, free)] - right[:, free]).max(initial=0.0) <= 1e-9 * np.abs(right).max()
        u[:, part] = field[:, trace]
        for mode in modes.T:
            motions.append(np.zeros(len(space.global_dof)))
            motions[-1][part] = mode[trace]
    jump_of = lambda u, known=0.0: pairs.transfer.jump(space.extended(space.trace(u) + known)[0]).reshape(len(u), -1)
    known = 0.0 if d.loading.known is None else d.loading.known
    left = (shifted.jump - shifted.shift).reshape(scene.steps, -1) - jump_of(u, known)
    if motions:
        B = jump_of(np.array(motions)).T
        left = left - (B @ np.linalg.lstsq(B, left.T, rcond=1e-11)[0]).T
    assert np.abs(left).max() <= 1e-7 * np.abs(iterated.fields.u).max()


@pytest.mark.parametrize("name", quick(["friction with a history", QUICK], QUICK))
def test_shifts_are_the_least_that_contact_allows(name):
    """Beside λ̂ closed pairs touch, open ones do not penetrate, what sticks stays, what slips does so along the friction, as far as û
    does."""
    d, iterated, found = delivered(name)
    pairs, shifted = d.certificate.pairs, found.contact.backward
    points, own, previous = pairs.points, pairs.runs[0].points, np.zeros((3, len(pairs)))
    for force, jump, shift in zip(iterated.bound.pair.forces, shifted.jump, shifted.shift):
        bare, push, shear = jump - shift, -points.along(force), points.across(force)
        size, closed = np.linalg.norm(shear, axis=0), push > 0
        way = np.divide(shear, size, out=np.zeros_like(shear), where=size > 0)
        normal = np.where(closed, -own["gap"], np.maximum(points.along(bare), -own["gap"]))
        slid = np.maximum((way * (points.across(bare) - previous)).sum(axis=0), 0.0)
        slips = size > own["friction"] * push * (1 - 1e-9)
        across = np.where(closed, previous + np.where(slips, slid, 0.0) * way, points.across(bare))
        # how far it slips is found with a keq that is worth 1e-3 of the forces, to about the square of that
        assert np.abs(jump - normal * points.normal - across).max() <= 1e-5 * np.abs(shifted.shift).max()
        previous = points.across(jump)


def test_shifts_vanish_with_the_error():
    largest = []
    for error in (1e-2, 1e-4, 1e-6):
        _, iterated, found = delivered("a press fit", error)
        shift = found.contact.backward
        largest.append(max(shift.normal.max(), shift.tangential.max()) / np.abs(iterated.fields.u).max())
        assert largest[-1] <= 10 * error
    assert largest[0] > 10 * largest[1] > 100 * largest[2] > 0


def test_a_run_says_for_which_surfaces_it_is_exact(tmp_path):
    made = case("blocks", 0.3, 1e-4, output={"units": {"length": "mm", "force": "N"}, "figures": False})
    solution = solve(made)
    solution.write(tmp_path)
    write_fields(ResultsFolder(tmp_path), solution.fields)
    solution = Solution.read(tmp_path)
    told, i = solution.summary["backward"], solution.interfaces
    assert told["normal"] == max(told["load_steps"]["normal"]) and told["tangential"] == max(told["load_steps"]["tangential"])
    assert np.abs(i.shift_normal).max(axis=1) == pytest.approx(told["load_steps"]["normal"], rel=1e-12)
    assert i.shift_tangential.max(axis=1) == pytest.approx(told["load_steps"]["tangential"], rel=1e-12)
    assert i.shift_normal.shape == i.shift_tangential.shape == i.gap.shape
    assert dict(summary_rows(solution.summary))["backward"] == (
        f"exact for surfaces shifted by at most {told['normal']:.1e} mm along the normal, {told['tangential']:.1e} mm across it")
    assert b"shift_tangential" in (tmp_path / "fields" / "interface_0001.vtu").read_bytes()


@pytest.mark.parametrize("tolerance", quick([{"law": 1e-4}, {"indicator": 1e-8}], {"law": 1e-4}))
def test_nothing_is_said_without_a_certificate(tolerance, tmp_path):
    solution = solve(contact(0.3, method={"tolerance": tolerance}))
    assert solution.summary["backward"] is None and solution.interfaces.shift_normal is None
    assert "backward" not in dict(summary_rows(solution.summary))
    solution.write(tmp_path)
    assert read_npz(tmp_path).interfaces.shift_tangential is None


def test_a_hundredth_is_left_open():
    """S⁺h is solved to 1e-4 of its energy."""
    told, exact = (delivered(QUICK, 1e-4, share)[2].contact.backward for share in (1e-4, 1e-18))
    for ours, theirs in ((told.tangential, exact.tangential), (told.normal, exact.normal)):
        np.testing.assert_allclose(ours, theirs, rtol=0.02, atol=1e-3 * np.max(theirs))
