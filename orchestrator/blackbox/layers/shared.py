"""Congruent subdomains as one model, and right-hand sides that need no solve.

A layer around any black box. Subdomains that differ by a translation alone are loaded and factorised
once; their forces become further right-hand sides of the one model. A right-hand side that is zero, that
occurs twice, or that was asked the last time already, is not solved at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.blackbox.cost import copies
from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.models.congruence import representatives
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.savings import Savings

SAMPLE = 16  # entries of a right-hand side that are looked at before all of them


class SharedModels(Layer):
    """Maps subdomains to distinct models and merges their right-hand sides.

    Parameters
    ----------
    inner : the black box that holds the distinct models
    congruent : share models
    repeated : solve no right-hand side twice
    explicit : ``inner`` forms compliances where they pay
    workers : processes behind ``inner``
    steps : load steps, the right-hand sides of a subdomain in a linear stage
    savings : where what is saved is noted
    """

    def __init__(self, inner: BlackBox, *, congruent: bool, repeated: bool, workers: int, steps: int,
                 savings: Savings, explicit: bool = False):
        super().__init__(inner)
        self.congruent, self.repeated, self.explicit = congruent, repeated, explicit
        self.workers, self.steps, self.savings = workers, steps, savings
        self.model_of = np.empty(0, int)
        self._last: dict[int, _Remembered] = {}

    def load(self, models: Sequence[Model]) -> None:
        """Load one of each kind; of a kind with much to solve, one per worker that shares the work."""
        self._last = {}
        first = representatives(models, self.traits) if self.congruent else np.arange(len(models))
        self.model_of = np.empty(len(models), int)
        loaded: list[Model] = []
        for kind in np.unique(first):
            members = np.flatnonzero(first == kind)
            times = copies(len(models[kind].trace), len(members) * self.steps, len(members), self.workers, self.explicit)
            self.model_of[members] = len(loaded) + np.arange(len(members)) * times // len(members)
            loaded += [models[kind]] * times
        self.savings.add("congruent", "factorisations", len(models) - len(loaded))
        cases = self.steps * np.bincount(self.model_of, minlength=len(loaded))
        super().load([replace(model, cases=int(count)) for model, count in zip(loaded, cases)])

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says; the last answers are remembered."""
        return self._merged(forces, self.inner.traces, remember=True)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self._merged(forces, self.inner.fields, remember=False)

    def _merged(self, forces: Mapping[int, np.ndarray], solve, remember: bool) -> dict[int, np.ndarray]:
        groups: dict[int, list[int]] = {}
        for index in forces:
            groups.setdefault(int(self.model_of[index]), []).append(index)
        rows = {model: np.vstack([forces[i] for i in members]) for model, members in groups.items()}
        answers = self._unrepeated(rows, solve, remember) if self.repeated else solve(rows)
        result = {}
        for model, members in groups.items():
            ends = np.cumsum([0] + [len(forces[i]) for i in members])
            result |= {i: answers[model][a:b] for i, a, b in zip(members, ends[:-1], ends[1:])}
        return {index: result[index] for index in forces}

    def _unrepeated(self, rows: dict[int, np.ndarray], solve, remember: bool) -> dict[int, np.ndarray]:
        plans = {model: _Plan(r, self._last.get(model) if remember else None) for model, r in rows.items()}
        asked = {model: rows[model][plan.solved] for model, plan in plans.items() if len(plan.solved)}
        new = solve(asked) if asked else {}
        answers = {model: plan.answers(new.get(model)) for model, plan in plans.items()}
        if remember:
            self._last |= {model: _Remembered(rows[model], answers[model]) for model in rows}
        self.savings.add("repeated", "back-substitutions",
                         sum(len(r) for r in rows.values()) - sum(len(a) for a in asked.values()))
        return answers


class _Remembered:
    """Right-hand sides (n, size), as they were asked, and their answers (n, size)."""

    def __init__(self, rows: np.ndarray, answers: np.ndarray):
        self.rows, self.answers = rows, answers
        self.index: dict[bytes, list[int]] = {}
        for number, key in enumerate(_samples(rows)):
            self.index.setdefault(key, []).append(number)

    def find(self, key: bytes, row: np.ndarray) -> int | None:
        return next((n for n in self.index.get(key, ()) if np.array_equal(self.rows[n], row)), None)


class _Plan:
    """Which of the rows (n, size) are solved, and where the others' answers come from.

    Attributes
    ----------
    solved : (m,) int, rows that are new and occur for the first time
    """

    def __init__(self, rows: np.ndarray, last: _Remembered | None):
        self.size, self.last = rows.shape, last
        self.source = np.full(len(rows), -1)  # of each row, the place of its answer among the solved
        self.recalled: dict[int, int] = {}
        solved: list[int] = []
        seen: dict[bytes, list[int]] = {}
        nonzero = rows.any(axis=1)
        for number, key in enumerate(_samples(rows)):
            if not nonzero[number]:
                continue
            known = last.find(key, rows[number]) if last else None
            if known is not None:
                self.recalled[number] = known
                continue
            twins = seen.setdefault(key, [])
            twin = next((t for t in twins if np.array_equal(rows[solved[t]], rows[number])), None)
            if twin is None:
                twin = len(solved)
                solved.append(number)
                twins.append(twin)
            self.source[number] = twin
        self.solved = np.array(solved, dtype=int)

    def answers(self, new: np.ndarray | None) -> np.ndarray:
        """(n, size) the answers to all rows, given those (m, size) to the solved ones."""
        if new is not None and len(new) == self.size[0]:
            return new
        result = np.zeros(self.size)
        if new is not None:
            asked = self.source >= 0
            result[asked] = new[self.source[asked]]
        for number, known in self.recalled.items():
            result[number] = self.last.answers[known]
        return result


def _samples(rows: np.ndarray) -> list[bytes]:
    """A few entries of each row, as something to look up."""
    stride = max(1, rows.shape[1] // SAMPLE)
    return [row.tobytes() for row in np.ascontiguousarray(rows[:, ::stride])]
