"""What a code answers is that of the matter it was given: wrong matrices, wrong fields and mixed-up models end a run."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from blackbox_case import assemble, box, difference, settings
from in_process import IN_PROCESS, InProcess, InProcessWorker
from quick import late
from quadratic_case import assemble_ten

from orchestrator.blackbox.guard import GuardedCode, PATCH, imbalance, patch_errors, wrong_stiffness
from orchestrator.blackbox.models import boundary_dofs, Matter, sides_by_subdomain
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.load import config_from
from orchestrator.errors import BlackBoxError
from orchestrator.method.sparse import cholmod
from orchestrator.method.sparse.symmetric import is_semidefinite
from orchestrator.method.linear.answers import check_own_matter, own_stiffness
from orchestrator.method.linear.loading import assemble_rims
from orchestrator.registry import CODES
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.elasticity import lame
from orchestrator.scene.mesh.quadratic import TET_EDGES, edges_of

BAR = {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
       "subdomains": {"slices": {"axis": "x", "count": 2}}, "materials": [{"young": 200e3, "poisson": 0.3}],
       "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [0, 0, 1]}],
       "blackbox": IN_PROCESS}


def ten(model):
    """The same with ten-node tets."""
    ends, edge = edges_of(model.cells, TET_EDGES)
    nodes = np.vstack([model.nodes, model.nodes[ends].mean(axis=1)])
    return replace(model, nodes=nodes, cells=np.hstack([model.cells, len(model.nodes) + edge]),
                   fixed=np.zeros((len(nodes), 3), bool))


CASES = {"four nodes": (box(), assemble), "ten nodes": (ten(box()), assemble_ten)}


@pytest.mark.parametrize("name", CASES)
def test_matter_is_the_textbooks(name):
    model, reference = CASES[name][0], CASES[name][1](CASES[name][0])
    matter, u = Matter.of(model), np.random.default_rng(1).standard_normal((3, model.fixed.size))
    held = (reference @ u.T).T
    assert difference(matter.forces(u), held) < 1e-13
    assert matter.energies(u) == pytest.approx(np.sum(u * held, axis=1), rel=1e-12)
    strain = np.array([[1.0, 0.5, -2.0], [0.5, -3.0, 0.7], [-2.0, 0.7, 0.4]])
    assert difference(matter.forces_of_strain(strain), reference @ (model.nodes @ strain).ravel()) < 1e-12
    assert (np.repeat(matter.stiff, 3) >= reference.diagonal() * (1 - 1e-12)).all()


@pytest.mark.parametrize("name", CASES)
def test_the_energy_of_the_six_uniform_strains(name):
    """½ ε : C : ε times the volume, per region."""
    model, matter = CASES[name][0], Matter.of(CASES[name][0])
    rng = np.random.default_rng(2)
    strain = rng.standard_normal((3, 3))
    strain += strain.T
    u = (model.nodes @ strain).reshape(1, -1)
    corners = model.nodes[model.cells[:, :4]]
    volume = np.bincount(model.region, np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6)
    lam, mu = lame(*model.materials.T)
    exact = volume @ (lam * np.trace(strain) ** 2 + 2 * mu * np.sum(strain**2))
    assert matter.energies(u)[0] == pytest.approx(exact, rel=1e-12)


def plane_stress(model):
    """λ of plane stress in the place of λ."""
    young, poisson = model.materials.T
    lam = young * poisson / (1 - poisson**2)
    _, mu = lame(young, poisson)
    return assemble(replace(model, materials=np.column_stack([mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))])))


def third_region(model):
    """Units that are wrong in one region of three."""
    assert len(model.materials) == 3
    return assemble(replace(model, materials=model.materials * [[1, 1], [1, 1], [1e-3, 1]]))


def entry(matrix, change):
    matrix = matrix.tolil()
    matrix[7, 40] += change * matrix[7, 7]
    return matrix.tocsr()


THREE = replace(box(), region=np.arange(len(box().cells)) % 3, materials=np.array([[200e3, 0.3], [70e3, 0.2], [2.0, 0.4]]))
WRONG = {
    "scaled by 1.001": (lambda m: 1.001 * assemble(m), "uniform strains"),
    "plane stress": (plane_stress, "uniform strains"),
    "third region in other units": (third_region, "uniform strains"),
    "an entry off by a millionth": (lambda m: entry(assemble(m), 1e-6) + entry(assemble(m), 1e-6).T, "rigid motions"),
    "an entry without its twin": (lambda m: entry(assemble(m), 1e-6), "not symmetric"),
    "springs to the ground": (lambda m: assemble(m) + 1e-6 * abs(assemble(m)).max() * sp.eye_array(m.fixed.size),
                              "rigid motions"),
    "not a number": (lambda m: assemble(m) * np.nan, "not symmetric"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_stiffness_is_named(name):
    make, words = WRONG[name]
    assert words in wrong_stiffness(THREE, make(THREE))
    assert wrong_stiffness(THREE, assemble(THREE)) == ""


def test_matter_of_ones_own_is_judged_by_rigid_motions_alone():
    model = THREE
    assert wrong_stiffness(model, 1.001 * assemble(model), own_matter=True) == ""
    wrong = entry(assemble(model), 1e-3)
    assert "rigid motions" in wrong_stiffness(model, wrong + wrong.T, own_matter=True)


@pytest.mark.parametrize("at", [0.0, 1e3, 1e5])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_sound_matrices_pass_wherever_they_are(at, unit):
    model = replace(THREE, nodes=unit * (THREE.nodes + at))
    found = patch_errors(model, assemble(model))
    assert max(found[:3]) < PATCH / 100 and wrong_stiffness(model, assemble(model)) == ""


@pytest.mark.parametrize("code", [IN_PROCESS["code"], "freefem", "calculix", late("scikit-fem")])
def test_sound_codes_pass(code):
    """And leave far less than is allowed."""
    model = box()
    with make_blackbox(settings(code=code, **({"transport": "file"} if code == "calculix" else {}))) as blackbox:
        blackbox.load([model])
        f = np.where(model.fixed.ravel(), 0.0, 1.0)[None] * [[1.0], [-3.0]]
        assert imbalance(model, blackbox.fields({0: f})[0], f)[0] < 1e-11
        found = patch_errors(model, blackbox.stiffness([model])[0])
        assert max(found[:3]) < 1e-11


# ---- in a run ---------------------------------------------------------------------------------------


@pytest.fixture
def broken():
    """Registers a code whose worker has one method of its own."""

    def make(**methods) -> dict:
        kind = type("BrokenWorker", (InProcessWorker,), methods)
        CODES.add("broken", type("Broken", (InProcess,), {"worker": lambda self: kind}))
        return {**BAR, "blackbox": {"code": "broken", "workers": 1}}

    yield make
    CODES.remove("broken")


def wrong_reply(which, change):
    """The stiffness number ``which`` of a run is changed."""
    asked = []

    def stiffness(self, index, model):
        asked.append(model.name)
        matrix = InProcessWorker.stiffness(self, index, model)
        return change(matrix) if len(asked) == which else matrix

    return stiffness


@pytest.mark.parametrize("which", [1, 2])
def test_a_run_ends_at_a_wrong_stiffness(broken, which):
    made = broken(stiffness=wrong_reply(which, lambda k: 1.001 * k))
    with pytest.raises(BlackBoxError, match="uniform strains need other forces"):
        solve(config_from(made))


def test_a_run_ends_at_a_code_that_solves_with_the_last_model(broken):
    def solve_last(self, op, jobs, names):
        last = max(self.prepared)
        self.prepared = {i: self.prepared[last] for i in self.prepared}
        return InProcessWorker.solve(self, op, jobs, names)

    made = broken(solve=solve_last)
    made["mesh"] = {"box": {"size": [4, 1, 1], "cells": [2, 1, 1]}}
    with pytest.raises(BlackBoxError, match="models are mixed up"):
        solve(config_from({**made, "subdomains": {"slices": {"axis": "x", "count": 2}}}))


@pytest.mark.parametrize("dof", [5, 40, -30])
def test_a_run_ends_at_a_wrong_dof_of_a_field(broken, dof):
    """The last field's, by a thousandth of the largest."""
    def solve_wrong(self, op, jobs, names):
        answers = InProcessWorker.solve(self, op, jobs, names)
        self.fields = getattr(self, "fields", 0) + (op == 3)
        if op == 3 and self.fields > 2:  # the probe and the loads come first
            for (index, _), u in zip(jobs, answers.values()):
                free = np.flatnonzero(~self.models[index].fixed)
                u[0, free[dof]] += 1e-3 * np.abs(u).max()
        return answers

    with pytest.raises(BlackBoxError, match="do not balance the forces"):
        solve(config_from(broken(solve=solve_wrong)))


@pytest.mark.long
def test_a_code_that_notices_the_place_shares_no_models(tmp_path):
    """Young's modulus falls along x: slices that look alike are not. Without the word of its class nothing is shared."""
    (tmp_path / "graded.py").write_text("""
import numpy as np
from orchestrator.blackbox.codes import template

class Solver(template.Solver):
    own_matter = True

    def stiffness(self, model):
        young = 200e3 / (1 + model.nodes[model.cells][:, :, 0].mean(axis=1))
        model.region, model.materials = np.arange(len(young)), np.column_stack([young, np.full(len(young), 0.3)])
        return super().stiffness(model)
""")
    made = {**BAR, "blackbox": {"code": str(tmp_path / "graded.py"), "workers": 1}, "method": {"tolerance": {"error": 1e-8}},
            "subdomains": {"slices": {"axis": "x", "count": 4}}}
    solved = solve(config_from(made), reference=True)
    assert solved.converged and solved.summary["true_error"] <= 1e-8


def of_body(model, young=lambda model, centre: 200e3, poisson=0.3):
    """The stiffness of a model whose body has moduli of its own, (m,) or one, its soles those of the YAML."""
    body = np.zeros(len(model.cells), bool)
    if model.origin is not None:
        body[: len(model.origin.cells)] = model.origin.cells >= 0
    moduli = model.materials[model.region].copy()
    moduli[body, 0] = np.broadcast_to(young(model, model.nodes[model.cells].mean(axis=1)), len(body))[body]
    moduli[body, 1] = poisson
    return assemble(replace(model, materials=moduli, region=np.arange(len(body))))


OWN = {  # what stiffness() of matter of one's own returns, words of the message; None: it is sound
    "a bulk modulus below zero": (  # by 0.3 of a shear modulus of 77e3
        lambda m: of_body(m, lambda *_: -27 * 77e3, -14.5), "not positive: displacements near .* give energy away"),
    "a modulus below zero": (lambda m: of_body(m, lambda _, x: 200e3 * np.where(x[:, 0] > 3.5, -0.5, 1.0)),
                             "not positive: to move a node near"),
    "the whole's average": (lambda m: of_body(m, lambda m, x: 200e3 * (1 + 0.1 * x[:, 0].mean())), "no sum over tets"),
    "the model's name": (lambda m: of_body(m, lambda m, _: 200e3 * (1 + 1e-6 * m.name.startswith("rim"))), "no sum over tets"),
    "soft and hard": (lambda m: of_body(m, lambda _, x: 200e3 * 10.0 ** np.round(-6 * x[:, 0] / 4)), None),
    "nearly incompressible": (lambda m: of_body(m, poisson=0.4999), None),
    "shrinking when pressed": (lambda m: of_body(m, poisson=-0.9), None),
}


@pytest.mark.parametrize("law", [{"law": "perfect"}, {"law": "contact", "friction": 0.3}], ids=lambda law: law["law"])
@pytest.mark.parametrize("what", OWN)
def test_own_matter_is_shown_to_be_positive_and_local_before_anything_is_iterated(what, law):
    """Soles hide it: they make the sum positive that the code factorises."""
    make, words = OWN[what]
    config = config_from({**BAR, "interfaces": [law]})
    scene = build_scene(config)
    sides, own = sides_by_subdomain(scene), scene.subdomains
    worker = type("OwnWorker", (InProcessWorker,), {"stiffness": lambda self, index, model: make(model)})
    code = type("OwnCode", (InProcess,),
                {"worker": lambda self: worker, "own_matter": True, "translation_invariant": False})(config.codes[0])
    with GuardedCode(Pool({0: code})) as blackbox:
        def judge():
            rims = assemble_rims(scene, own, sides, blackbox, True)
            found = own_stiffness(scene, own, blackbox, True)
            check_own_matter(scene, own, found, rims, [boundary_dofs(scene, s, sides[s.index]) for s in own])

        if words is None:
            judge()
            return
        with pytest.raises(BlackBoxError, match=words) as caught:
            judge()
    assert caught.value.subdomain.endswith(("slice 0", "slice 1"))


@pytest.mark.parametrize("without", [False, True], ids=["CHOLMOD", "SuperLU"])
def test_what_is_semidefinite(monkeypatch, without):
    """Singular is, by more than rounding below zero is not; missing digits count as rounding if they are told."""
    if without:
        monkeypatch.setattr(cholmod, "library", lambda: None)
    K = assemble(THREE)
    shift = sp.diags_array(K.diagonal())
    assert is_semidefinite(K, 1e-12) and is_semidefinite(K - 1e-9 * shift, 1e-8)
    assert not is_semidefinite(K - 1e-9 * shift, 1e-12) and not is_semidefinite(-K, 1e-12)
    assert is_semidefinite(0 * K, 1e-12)
