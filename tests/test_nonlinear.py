"""Nonlinear parts: load steps one after the other, against one run of everything; who is refused, and why."""

import numpy as np
import pytest
from in_process import EXAMPLE, IN_PROCESS, IN_PROCESS_PLASTIC, Plastic
from method_case import CLAMP, config

from orchestrator.blackbox.codes.python_server import FullModel
from orchestrator.blackbox.models.extended import whole_model
from orchestrator.config import config_from
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

OPTIONS = IN_PROCESS_PLASTIC["options"]
AS_PROCESS = {"code": str(EXAMPLE), "options": OPTIONS, "nonlinear": True, "workers": 1}
# bent until a third of it flows, unloaded, bent the other way
BENT = {"boundary": [CLAMP, {"on": "xmax", "traction": [0, 27, 0], "history": "both"},
                     {"on": "zmax", "traction": [0, 0, -5], "history": "both"}],
        "histories": {"both": [0.5, 0.8, 1.0, 0.5, -0.2, -0.8, -1.0]}}


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
    """Seven load steps, a third of the tets flowing: 1e-5 within 40 answers a step, and no bound is claimed."""
    made = config(**BENT, method={"tolerance": {"error": 1e-6}}, blackbox=IN_PROCESS_PLASTIC)
    solution = solve(made)
    exact, flown, held = in_one_piece(made)
    assert solution.converged and 0.25 < flown < 0.35
    assert solution.iterations <= 40 * 7  # and in each: the run counts them all
    apart = np.abs(solution.displacement - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert apart.max() <= 1e-5
    np.testing.assert_allclose(solution.reactions[0], held, atol=1e-5 * np.abs(held).max())
    summary = solution.summary
    assert np.isnan(summary["error_bound"]) and np.isnan(summary["energy"]).all()
    assert 1e-9 < summary["residuals"]["law_residual"] <= 1e-6
    assert summary["nonlinear"]["answers"] == 4 * (solution.iterations + 7) and not summary["discretisation_error"]


def test_a_part_moved_by_its_supports_in_contact_with_an_elastic_one():
    """Prescribed displacements reach nonlinear parts; as a process it gives the same; below its yield it is elastic."""
    problem = {"mesh": {"box": {"size": [2.0, 1.0, 2.0], "cells": [4, 2, 4]}}, "subdomains": {"grid": [1, 1, 2]},
               "interfaces": [{"law": "contact", "friction": 0.3}], "method": {"tolerance": {"error": 1e-6}},
               "boundary": [{"on": "zmin", "displacement": [0, 0, 0]},
                            {"on": "zmax", "displacement": [[0, 0, -0.002], [0.001, 0, -0.004], [0, 0, -0.001]]}]}

    def solved(**entry):
        return solve(config(**problem, blackbox=[IN_PROCESS, {**entry, "on": "block 0-0-1"}]))

    flows, process = solved(**IN_PROCESS_PLASTIC), solved(**AS_PROCESS)
    assert flows.converged and process.converged
    assert np.abs(flows.displacement - process.displacement).max() <= 1e-12
    strong = solved(**{**IN_PROCESS_PLASTIC, "options": {**OPTIONS, "yield_stress": 1e6}})
    elastic, size = solved(**IN_PROCESS), np.abs(flows.displacement).max()
    assert np.abs(strong.displacement - elastic.displacement).max() < 1e-5 * size
    pressed, elastically = (s.reactions[0, :, 2] for s in (flows, elastic))
    # what has been flattened is not touched any more where the elastic part is still pressed
    assert pressed[1] < 0.8 * elastically[1] and abs(pressed[2]) < 1e-6 * elastically[2]


@pytest.mark.parametrize("change, words", [
    ({"blackbox": {**AS_PROCESS, "nonlinear": False}}, "says that it is nonlinear"),
    ({"blackbox": {"code": "orchestrator.blackbox.codes.template:Solver", "nonlinear": True, "workers": 1}}, "is linear"),
    ({"blackbox": {**AS_PROCESS, "transport": "file"}}, "write transport: pipe"),
    ({"method": {"tolerance": {"indicator": 1e-5}}}, "indicator with nonlinear matter"),
    ({"method": {"acceleration": "gmres"}}, "whose fixed point is not affine"),
])
def test_what_does_not_go_with_nonlinear_matter_is_told(change, words):
    data = config(**BENT).model_dump(mode="json", exclude_none=True)
    with pytest.raises(InputError, match=words):
        solve(config_from({**data, "blackbox": IN_PROCESS_PLASTIC, **change}))


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
    ("def commit(self, prepared): pass", "has no method advance"),
    ("commit = None\n    def advance(self, p, f): pass", "has no method commit"),
    ("def commit(self, p): pass\n    def advance(self, p, f): return 1.1 * self.solve(p, f[None])[0], f", None),
    ("def commit(self, p): pass\n    def advance(self, p, f): return self.solve(p, f[None])[0], 0.999 * f",
     "advance\\(\\) returned forces that are not those it was given on free dofs"),
    ("def commit(self, p): pass\n    def advance(self, p, f): return f[:3], f", "returned 3 displacements"),
])
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
