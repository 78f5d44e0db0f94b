"""Explicit interface compliance: the answer to every unit force, kept as a dense matrix.

A layer around any black box. t back-substitutions, one per trace dof, give C = N M⁻¹Nᵀ; from then on a
stage is the product C F. It pays for models with few trace dofs that are asked often: bulky parts with
small contact patches, or one slice that stands for a hundred.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.protocol import Model
from orchestrator.cost import predicted_cost
from orchestrator.savings import Savings

# Linear stages expected of a run before it has begun (the shipped ones take 4 to 45); later, as many as have been.
STAGES = 20
MEMORY = 0.25  # of what is free: the share that compliances may take
_PROBE = 400  # size of the product that the machine's speed is measured on


class Compliance(Layer):
    """Answers trace forces by products with compliances where a measured cost model says that it pays.

    Parameters
    ----------
    inner : the black box
    workers : how many back-substitutions run at once; products run one after the other
    savings : where what is saved is noted

    Attributes
    ----------
    matrices : model → (t, t) compliance
    """

    def __init__(self, inner, *, workers: int, savings: Savings):
        super().__init__(inner)
        self.workers, self.savings = workers, savings
        self.matrices: dict[int, np.ndarray] = {}
        self._trace: list[int] = []
        self._costs = np.empty(0)  # of one back-substitution, in seconds once multiplied by ``_unit``
        self._unit: float | None = None
        self._rows: Sequence[int] = ()
        self._calls = 0

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says."""
        self.inner.load(models)
        self.matrices, self._unit, self._rows, self._calls = {}, None, (), 0
        self._trace = [len(model.trace) for model in models]
        self._costs = predicted_cost([(~model.fixed).sum() for model in models])

    def expect(self, rows: Sequence[int]) -> None:
        """Say how many right-hand sides each model gets per linear stage; without this nothing is replaced."""
        self._rows = rows

    @staticmethod
    def worthwhile(size: int, rows: int) -> bool:
        """A guess before anything is measured, for ``size`` trace dofs and ``rows`` right-hand sides per stage."""
        return size < STAGES * rows

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        if len(self._rows) and self._unit is not None:
            self._replace([i for i in forces if i not in self.matrices])
        solved = {i: f for i, f in forces.items() if i not in self.matrices}
        answers = self._measured(solved) if solved else {}
        for i in forces.keys() - solved.keys():
            answers[i] = forces[i] @ self.matrices[i]
            self.savings.add("compliance", "back-substitutions replaced by products", len(forces[i]))
        self._calls += 1
        return {i: answers[i] for i in forces}

    def _measured(self, forces: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Answers of the inner black box, whose own clock tells what a back-substitution costs."""
        before = self.inner.clock()["solve"]
        answers = self.inner.traces(forces)
        work = sum(len(f) * self._costs[i] for i, f in forces.items())
        if work:
            self._unit = (self.inner.clock()["solve"] - before) / work
        return answers

    def _replace(self, candidates: list[int]) -> None:
        """Form the compliances that pay, all in one request so that all workers are busy."""
        room = MEMORY * os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        chosen = []
        for i in sorted(candidates, key=lambda i: self._trace[i]):
            room -= 8 * self._trace[i] ** 2
            if room > 0 and self._trace[i] and self._pays(i):
                chosen.append(i)
        if not chosen:
            return
        for i, answer in self.inner.traces({i: np.eye(self._trace[i]) for i in chosen}).items():
            self.matrices[i] = (answer + answer.T) / 2
        self.savings.add("compliance", "unit forces solved", sum(self._trace[i] for i in chosen))

    def _pays(self, model: int) -> bool:
        """Seconds of the back-substitutions to come against those that the matrix and its products take."""
        size, rows = self._trace[model], self._rows[model]
        stages = max(STAGES - self._calls, self._calls)
        if size >= stages * rows:
            return False
        work = self._costs * self._rows
        at_once = min(self.workers, work.sum() / work.max())  # a model that stands for most of them has one worker
        solve = self._unit * self._costs[model] / at_once
        return solve * size + stages * _seconds_of_product(size, rows) < solve * rows * stages


def _seconds_of_product(size: int, rows: int) -> float:
    """Of (rows, size) times (size, size): reading the matrix, and arithmetic, each at its measured speed."""
    if not _speeds:
        matrix = np.ones((_PROBE, _PROBE))
        for columns in (1, _PROBE):
            other, runs = np.ones((columns, _PROBE)), []
            for _ in range(5):
                begin = time.thread_time()  # CPU seconds, as the black box counts them
                other @ matrix
                runs.append(time.thread_time() - begin)
            _speeds.append(min(runs) / _PROBE**2 / columns)
    once, each = _speeds
    return size**2 * max(once, rows * each)


_speeds: list[float] = []  # seconds per entry of the matrix: for one row, and per row of many
