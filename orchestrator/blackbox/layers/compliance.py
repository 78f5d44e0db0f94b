"""Explicit interface compliance: the answer to every unit force, kept as a dense matrix.

A layer around any black box. t back-substitutions, one per trace dof, give C = N M⁻¹Nᵀ; from then on a
stage is the product F C. Whether that pays is told by ``cost``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.blackbox import cost
from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.cost import predicted_cost
from orchestrator.savings import Savings


class Compliance(Layer):
    """Answers trace forces by products with compliances where measured costs say that it pays.

    Models of which it is not known how many load cases a stage has (``Model.cases``) are left as they are.

    Parameters
    ----------
    inner : the black box
    workers : how many back-substitutions run at once; products run one after the other
    savings : where what is saved is noted

    Attributes
    ----------
    matrices : model → (t, t) compliance
    """

    def __init__(self, inner: BlackBox, *, workers: int, savings: Savings):
        super().__init__(inner)
        self.workers, self.savings = workers, savings
        self.matrices: dict[int, np.ndarray] = {}
        self._trace: list[int] = []
        self._cases = np.empty(0, int)
        self._costs = np.empty(0)  # of one back-substitution, in seconds once multiplied by ``_unit``
        self._unit: float | None = None
        self._done = 0  # requests

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says."""
        super().load(models)
        self.matrices, self._unit, self._done = {}, None, 0
        self._trace = [len(model.trace) for model in models]
        self._cases = np.array([model.cases for model in models], int)
        self._costs = predicted_cost([(~model.fixed).sum() for model in models])

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        if self._unit is not None:
            self._replace([i for i in forces if i not in self.matrices and self._cases[i]])
        solved = {i: f for i, f in forces.items() if i not in self.matrices}
        answers = self._measured(solved) if solved else {}
        for i in forces.keys() - solved.keys():
            answers[i] = forces[i] @ self.matrices[i]
            self.savings.add("compliance", "back-substitutions replaced by products", len(forces[i]))
        self._done += 1
        return {i: answers[i] for i in forces}

    def _measured(self, forces: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Answers of the inner black box, whose own clock tells what a back-substitution costs."""
        before = self.usage.clock()["solve"]
        answers = self.inner.traces(forces)
        work = sum(len(f) * self._costs[i] for i, f in forces.items())
        if work:
            self._unit = (self.usage.clock()["solve"] - before) / work
        return answers

    def _replace(self, candidates: list[int]) -> None:
        """Form the compliances that pay, all in one request so that all workers are busy."""
        if not candidates:
            return
        work = self._costs * self._cases
        at_once = min(self.workers, work.sum() / work.max())  # a model that stands for most of them has one worker
        room, chosen = cost.room(), []
        for i in sorted(candidates, key=lambda i: self._trace[i]):
            room -= cost.size_of(self._trace[i])
            if room > 0 and self._trace[i] and self._pays(i, at_once):
                chosen.append(i)
        if not chosen:
            return
        for i, answer in self.inner.traces({i: np.eye(self._trace[i]) for i in chosen}).items():
            self.matrices[i] = (answer + answer.T) / 2
        self.savings.add("compliance", "unit forces solved", sum(self._trace[i] for i in chosen))

    def _pays(self, model: int, at_once: float) -> bool:
        request = cost.Request(0.0, self._unit * self._costs[model] / at_once)
        return cost.compliance_pays(self._trace[model], cost.to_come(self._done, cost.STAGES), self._cases[model],
                                    request, unit_loads=request)
