"""Nonlinear parts: load steps one after the other, against one run of everything; who is refused, and why."""

import numpy as np
import pytest
import scipy.sparse as sp
from in_process import EXAMPLE, IN_PROCESS_PLASTIC, Plastic
from method_case import CLAMP, config
from quick import late

from orchestrator.blackbox.codes.adapter import FullModel
from orchestrator.blackbox.models import whole_model
from orchestrator.config.load import config_from
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.sources import bricks

OPTIONS = IN_PROCESS_PLASTIC["options"]
AS_PROCESS = {"code": str(EXAMPLE), "options": OPTIONS, "nonlinear": True, "workers": 1}
# bent until a third of it flows, unloaded, bent the other way
BENT = {"boundary": [CLAMP, {"on": "xmax", "traction": [0, 27, 0], "history": "both"},
                     {"on": "zmax", "traction": [0, 0, -5], "history": "both"}],
        "histories": {"both": [0.5, 1.0, -0.2, -1.0]}}


def in_one_piece(made):
    """Displacements (T, n, 3), the share of tets that have flown, and the support's force per load step, undecomposed."""
    scene = build_scene(made)
    whole = whole_model(scene)
    model = FullModel(whole.name, whole.nodes, whole.cells, whole.region, whole.materials, whole.fixed, whole.trace)
    model.sole, model.volume = np.zeros(len(model.cells), bool), np.zeros(len(model.cells), int)
    solver, found, held = Plastic(**OPTIONS), [], []
    body = solver.prepare(model, solver.stiffness(model))
    for t in range(scene.steps):
        u, needed = solver.advance(body, np.where(scene.fixed, scene.prescribed[t], scene.loads[t]).ravel())
        solver.commit(body)
        found.append(u.reshape(-1, 3))
        held.append((needed.reshape(-1, 3) - scene.loads[t])[scene.fixed.all(axis=1)].sum(axis=0))
    return np.array(found), np.mean(body.history[2] > 0), np.array(held)


def test_plasticity_with_reversal_against_one_run():
    """Four load steps, a third of the tets flowing: 1e-5 within 40 answers a step, and no bound is claimed."""
    made = config(**BENT, method={"tolerance": {"error": 1e-6}}, blackbox=IN_PROCESS_PLASTIC)
    solution = solve(made)
    exact, flown, held = in_one_piece(made)
    assert solution.converged and 0.25 < flown < 0.35
    assert solution.iterations <= 40 * 4  # and in each: the run counts them all
    apart = np.abs(solution.displacement - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert apart.max() <= 1e-5
    np.testing.assert_allclose(solution.reactions[0], held, atol=1e-5 * np.abs(held).max())
    summary = solution.summary
    assert summary["error_bound"] is None and not any(summary["energy"])
    assert 1e-9 < summary["residuals"]["law_residual"] <= 1e-6
    assert summary["nonlinear"]["answers"] == 4 * (solution.iterations + 4) and not summary["discretisation_error"]


@pytest.mark.parametrize("change, words", [
    ({"blackbox": {**AS_PROCESS, "nonlinear": False}}, "says that it is nonlinear"),
    late({"blackbox": {"code": "orchestrator.blackbox.codes.template:Solver", "nonlinear": True, "workers": 1}}, "is linear"),
    ({"blackbox": {**AS_PROCESS, "transport": "file"}}, "write transport: pipe"),
    ({"method": {"tolerance": {"indicator": 1e-5}}}, "indicator with nonlinear matter"),
    ({"method": {"acceleration": "gmres"}}, "whose fixed point is not affine"),
])
def test_what_does_not_go_with_nonlinear_matter_is_told(change, words):
    data = config(**BENT).model_dump(mode="json", exclude_none=True)
    with pytest.raises(InputError, match=words):
        solve(config_from({**data, "blackbox": IN_PROCESS_PLASTIC, **change}))


class Damaged(Plastic):
    """Elastic, down to ``rest`` of its stiffness where strained beyond ``limit``: σ = (1 − d) C ε."""

    def __init__(self, limit, rest, slope, spoilt=0.0):
        self.limit, self.rest, self.slope, self.spoilt = limit, rest, slope, spoilt

    def response(self, model, u, history):
        mesh, young = self._mesh(model), model.materials[0, 0]
        strain = np.einsum("mij,mj->mi", mesh.B, u[mesh.dofs])
        lam, mu = young * 0.3 / (1.3 * 0.4), young / 2.6
        C = lam * np.outer([1, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0]) + mu * np.diag([2.0, 2, 2, 1, 1, 1])
        stress = strain @ C
        size, before = np.sqrt(np.sum(stress * strain, axis=1) / young), self.limit if history is None else history
        most = np.maximum(size, before)
        if self.spoilt:  # what a root of a negative number does to one tet
            size = np.where((np.arange(len(size)) == 7) & (size > self.spoilt), np.nan, size)
        lost = (1 - self.rest) * np.exp(-self.slope * (most / self.limit - 1))
        kept, fall = self.rest + lost, self.slope / self.limit * lost * (size > before)
        along = stress / np.sqrt(young * np.where(size > 0, size, 1.0))[:, None]
        tangent = kept[:, None, None] * C - fall[:, None, None] * along[:, :, None] * along[:, None, :]
        local = np.einsum("mia,mij,mjb->mab", mesh.B, tangent * mesh.volume[:, None, None], mesh.B)
        forces = np.einsum("mij,mi->mj", mesh.B, (kept * mesh.volume * np.where(np.isnan(size), np.nan, 1.0))[:, None] * stress)
        return (np.bincount(mesh.dofs.ravel(), forces.ravel(), len(u)), sp.csr_array((local.ravel(), mesh.places), shape=(len(u),) * 2),
                most)


def pulled(solver, forces):
    """Displacements of a bar's end under load steps of forces on it."""
    bar = bricks(np.array([2.0, 1.0, 1.0]), np.array([4, 2, 2]), "bar")
    nodes, count = bar.nodes, len(bar.cells)
    model = FullModel("bar", nodes, bar.cells, np.zeros(count, int), np.array([[200e3, 0.3]]), nodes[:, [0, 0, 0]] == 0, np.empty(0, int))
    model.sole, model.volume = np.zeros(count, bool), np.zeros(count, int)
    body, end = solver.prepare(model, solver.stiffness(model)), nodes[:, 0] == 2
    for force in forces:
        u, _ = solver.advance(body, np.where(end[:, None], np.array([force, 0.1 * force, 0.0]) / end.sum(), 0.0).ravel())
        solver.commit(body)
    return u


@pytest.mark.parametrize("rest, slope, force", [late(0.3, 3.0, 400.0), (0.2, 1.0, 400.0)])
def test_matter_that_softens_needs_no_smaller_load_steps(rest, slope, force):
    """One load step, two and four lead to the same place, where the tangent alone leads nowhere."""
    one, two, four = (pulled(Damaged(1e-3, rest, slope), force * np.arange(1, n + 1) / n) for n in (1, 2, 4))
    assert max(np.abs(two - one).max(), np.abs(four - one).max()) < 1e-8 * np.abs(one).max()


def test_matter_that_answers_no_number_is_named_with_its_place_and_strain():
    """It is no matter of load steps."""
    bar = bricks(np.array([2.0, 1.0, 1.0]), np.array([4, 2, 2]), "bar")
    place = ", ".join(f"{x:.6g}" for x in bar.nodes[bar.cells[7]].mean(axis=0))
    with pytest.raises(ArithmeticError, match=f"forces that are no numbers .*: tet 7 of the body, at .{place}., mean strain xx 0.00"):
        pulled(Damaged(1e-3, 0.5, 1.0, spoilt=1.5e-3), [400.0])


UNSOUND = """
from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.codes.template import Solver as Template
class Solver(Adapter):
    nonlinear = own_matter = True
    def stiffness(self, model):
        self.K = Template().stiffness(model)
        return self.K
    {body}
"""


@pytest.mark.parametrize("body, words", [
    late("def commit(self, prepared): pass", "has no method advance"),
    late("commit = None\n    def advance(self, p, f): pass", "has no method commit"),
    late("def commit(self, p): pass\n    def advance(self, p, f): return 1.1 * self.solve(p, f[None])[0], f", None),
    ("def commit(self, p): pass\n    def advance(self, p, f): return self.solve(p, f[None])[0], 0.999 * f",
     "advance\\(\\) returned forces that are not those it was given on free dofs"),
    late("def commit(self, p): pass\n    def advance(self, p, f): return self.solve(p, f[None])[0], float('nan') * f",
     "advance\\(\\) returned what is no number .nan or infinite. on [0-9]+ dofs, the first at "),
    late("def commit(self, p): pass\n    def advance(self, p, f): return f[:3], f", "returned 3 displacements"),
], ids=["no advance", "no commit", "softer than elastic", "forces left over", "no number", "another size"])
def test_nonlinear_solvers_that_break_their_word(tmp_path, body, words):
    """Each by its own message; a response that differs from the elastic one is no fault."""
    (tmp_path / "mine.py").write_text(UNSOUND.format(body=body))
    made = config(blackbox={"code": str(tmp_path / "mine.py"), "nonlinear": True, "workers": 1},
                  subdomains={"slices": {"axis": "x", "count": 2}})
    if words is None:
        assert solve(made).converged
        return
    with pytest.raises((InputError, BlackBoxError), match=words):
        solve(made)
