"""Congruent subdomains as one model, and right-hand sides that need no solve.

A layer around any black box. Subdomains that differ by a translation alone are loaded and factorised once; their forces become
further right-hand sides of the one model. A right-hand side that is zero, that occurs twice, or that was asked the last time
already, is not solved at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.blackbox.models.assembly import representatives
from orchestrator.blackbox.protocol import BlackBox, Layer, Model
from orchestrator.config.method import Skip
from orchestrator.errors import BlackBoxError
from orchestrator.timing import STAGES, Savings

ALIKE = 1e-8  # relative: stiffnesses of the same tets at other places, whose coordinates are rounded
# Back-substitutions that cost as much as assembling and factorising; measured 50 to 150 for 5,000 to 60,000 dofs.
LOADING = 120


def copies(cases: int, members: int, workers: int) -> int:
    """How often a model is loaded that stands for several: each time must pay by the solves it takes off another worker.

    cases : load cases of a linear stage, of all members together
    members : subdomains it stands for
    """
    return max(1, min(workers, members, cases * STAGES // LOADING))


class SharedModels(Layer):
    """Maps subdomains to distinct models and merges their right-hand sides.

    inner : the black box that holds the distinct models
    skip : ``method.skip`` of a configuration: congruent subdomains share models, repeated right-hand sides are solved once
    workers : processes behind ``inner``
    steps : load steps, the right-hand sides of a subdomain in a linear stage
    savings : where what is saved is noted
    """

    def __init__(self, inner: BlackBox, skip: Skip, workers: int, steps: int, savings: Savings):
        super().__init__(inner)
        self.skip, self.workers, self.steps, self.savings = skip, workers, steps, savings
        self.model_of = np.empty(0, int)  # (subdomains,) the model of ``inner`` that answers for each
        self._last: dict[int, dict[bytes, np.ndarray]] = {}  # of each model, rows and their answers

    def load(self, models: Sequence[Model]) -> None:
        """Load one of each kind; of a kind with much to solve, one per worker that shares the work."""
        self._last, self.model_of, loaded = {}, np.empty(len(models), int), []
        first = representatives(models, self.traits) if self.skip.congruent else np.arange(len(models))
        for kind in np.unique(first):
            members = np.flatnonzero(first == kind)
            times = copies(len(members) * self.steps, len(members), self.workers)
            self.model_of[members] = len(loaded) + np.arange(len(members)) * times // len(members)
            loaded += [models[kind]] * times
            if len(members) > 1 and self.traits(models[kind].code).own_matter:
                self._prove([models[i] for i in dict.fromkeys(members[[0, len(members) // 2, -1]].tolist())])
        self.savings.add("congruent", "factorisations", len(models) - len(loaded))
        super().load(loaded)

    def _prove(self, models: Sequence[Model]) -> None:
        """Raises BlackBoxError where models that are to share a stiffness have different ones: a code's own matter may vary
        from place to place whatever it says of itself."""
        first, *others = self.inner.stiffness([replace(model, name=f"{model.name}, once more") for model in models])
        for model, other in zip(models[1:], others):
            apart = abs(first - other).max() / (abs(first).max() or 1.0)
            if not apart <= ALIKE:
                raise BlackBoxError(f"its stiffness is not that of {models[0].name}, which differs from it by a translation alone: by "
                                    f"{apart:.1e}. Its matter varies from place to place: leave uniform: true out of the form's entry, "
                                    "or translation_invariant = True out of the solver's class", model.name)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says; the last answers are remembered."""
        return self._merged(forces, self.inner.traces, remember=True)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        return self._merged(forces, self.inner.fields, remember=False)

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says; nonlinear models stand for themselves alone."""
        model_of = {index: int(self.model_of[index]) for index in forces}
        answers = self.inner.advance({model_of[index]: f for index, f in forces.items()}, commit)
        return {index: answers[model] for index, model in model_of.items()}

    def _merged(self, forces: Mapping[int, np.ndarray], solve: Callable, remember: bool) -> dict[int, np.ndarray]:
        """The right-hand sides of all subdomains that a model stands for, one below the other, and back."""
        members: dict[int, list[int]] = {}
        for index in forces:
            members.setdefault(int(self.model_of[index]), []).append(index)
        answers = self._answered({model: np.vstack([forces[i] for i in own]) for model, own in members.items()}, solve, remember)
        return {index: part for model, own in members.items()
                for index, part in zip(own, np.split(answers[model], np.cumsum([len(forces[i]) for i in own])[:-1]))}

    def _answered(self, rows: dict[int, np.ndarray], solve: Callable, remember: bool) -> dict[int, np.ndarray]:
        """Answers per model to rows (n, size) per model. Rows that are zero, that occur twice, or that were asked the last time are
        told by their bytes, and not solved."""
        if not self.skip.repeated:
            return solve(rows)
        keys = {model: [row.tobytes() for row in r] for model, r in rows.items()}
        known = {model: self._last.get(model, {}) if remember else {} for model in rows}
        first = {model: _new(r, keys[model], known[model]) for model, r in rows.items()}
        asked = {model: r[list(first[model].values())] for model, r in rows.items() if first[model]}
        answers = solve(asked) if asked else {}
        for model, r in rows.items():
            if len(first[model]) < len(r):
                found = known[model] | dict(zip(first[model], answers.get(model, ())))
                nothing = np.zeros(r.shape[1])
                answers[model] = np.array([found.get(key, nothing) for key in keys[model]]).reshape(r.shape)
        if remember:
            self._last |= {model: dict(zip(keys[model], answers[model])) for model in rows}
        self.savings.add("repeated", "back-substitutions", sum(map(len, rows.values())) - sum(map(len, asked.values())))
        return answers


def _new(rows: np.ndarray, keys: Sequence[bytes], known: Mapping[bytes, np.ndarray]) -> dict[bytes, int]:
    """Key → the first row that has it, of those that are neither zero nor known."""
    first: dict[bytes, int] = {}
    for row, (key, loaded) in enumerate(zip(keys, rows.any(axis=1).tolist())):
        if loaded and key not in known:
            first.setdefault(key, row)
    return first
