"""``error: auto``: the tolerance follows an estimate of the discretisation error.

    ε ≤ fraction · η_h,   η_h estimated anew whenever ε has fallen to the level that the last estimate asked for.

On perfect interfaces ε is the bound. By Galerkin orthogonality both errors are the legs of a right-angled triangle, so that a
fraction of 0.1 makes the whole error half a per cent larger. Elsewhere ε is the energy error, see ``energy_error``, and no right angle
is left: a fraction of 0.1 may cost up to a tenth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

LEAST = 1e-6  # what the tolerance never goes below: the fixed default


class MeshError(Monitor):
    """The discretisation error as the last estimate has it: (problem, fields, bound) → relative, energy norm."""

    name = "mesh_error"

    def __init__(self, case: Case):
        self.case, self.fraction, self.error = case, case.method.tolerance.fraction, math.nan

    @classmethod
    def of(cls, case: Case) -> MeshError | None:
        return cls(case) if case.method.tolerance.error == "auto" and "estimate" in case.given else None

    def judge(self, now: Evaluation) -> Verdict:
        verdict = now.verdict
        if not verdict.met:
            return Verdict(told={"discretisation_error": self.error})
        self.error = self.case.given["estimate"](now.problem, now.best, verdict.bound)  # a back-substitution
        self.case.value = max(self.fraction * self.error, LEAST)
        return Verdict(bool(verdict.measure <= self.case.value), sweeps=1, told={
            "discretisation_error": self.error, "target": (verdict.told["target"][0], self.case.value)})

    def state(self) -> dict[str, Any]:
        return {"value": self.case.value, "fraction": self.fraction, "error": self.error}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        if state["fraction"] == self.fraction:
            self.case.value, self.error = state["value"], state["error"]
        return problem
