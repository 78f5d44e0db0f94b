"""Congruent subdomains as one model, and right-hand sides that need no solve.

Soles and rims that differ by a translation alone are assembled once. A layer around any black box
does as much for subdomains: those that are congruent are loaded and factorised once; their forces
become further right-hand sides of the one model. A right-hand side that is zero, that occurs twice,
or that was asked the last time already, is not solved at all.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox, Model, Traits
from orchestrator.errors import BlackBoxError
from orchestrator.kept import key_of
from orchestrator.scene.congruence import first_congruent
from orchestrator.timing import STAGES

# by value or not at all; all else must be identical
_COMPARED = ("name", "nodes", "region", "materials", "origin")
# relative: stiffnesses of the same tets at other places, whose coordinates are rounded
ALIKE = 1e-8
# Back-substitutions that cost as much as assembling and factorising; measured 50 to 150 for 5,000
# to 60,000 dofs.
LOADING = 120


def representatives(models: Sequence[Model], traits: Callable[[int], Traits]) -> np.ndarray:
    """(models,) int, the first model that each one equals but for a translation, which elasticity
    does not notice.

    Numberings must agree: a model whose nodes or tets come in another order counts as different. So
    do models whose code is not known to be indifferent to where they are and what they are called.

    traits : of the code of a model, by ``Model.code``, as a black box tells them
    """
    invariant = {code: traits(code).translation_invariant for code in {m.code for m in models}}
    keys = (_key(model) if invariant[model.code] else number for number, model in enumerate(models))
    return first_congruent(keys, [model.nodes for model in models],
                           lambda i: models[i].materials[models[i].region])


def _key(model: Model) -> Hashable:
    """Numbering, clamped dofs, trace, and whatever else a model may come to hold."""
    rest = (getattr(model, f.name) for f in fields(model) if f.name not in _COMPARED)
    return (model.nodes.shape,
            *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in rest))


def assembled(models: Sequence[Model], blackbox: BlackBox,
              share: bool) -> list[sp.csr_array]:
    """(3n, 3n) stiffness of every model; where they ``share``, congruent ones get the very same.
    Raises BlackBoxError from the code.
    """
    first = representatives(models, blackbox.traits) if share and models else np.arange(len(models))
    kinds = np.unique(first).tolist()
    found = dict(zip(kinds, blackbox.stiffness([models[k] for k in kinds])))
    return [found[k] for k in first.tolist()]


def copies(cases: int, members: int, workers: int) -> int:
    """Number of times that a model is loaded that stands for several: each time must pay by the
    solves it takes off another worker.

    cases : load cases of a linear stage, of all members together
    members : subdomains it stands for
    """
    return max(1, min(workers, members, cases * STAGES // LOADING))


class SharedModels(BlackBox):
    """Maps subdomains to distinct models and merges their right-hand sides.

    inner : the black box that holds the distinct models
    share : whether congruent subdomains share models
    workers : processes behind ``inner``
    steps : load steps, the right-hand sides of a subdomain in a linear stage
    """

    def __init__(self, inner: BlackBox, share: bool, workers: int, steps: int):
        super().__init__(inner)
        self.share, self.workers, self.steps = share, workers, steps
        # (subdomains,) the model of ``inner`` that answers for each
        self.model_of = np.empty(0, int)
        self._last: dict[int, dict[bytes, np.ndarray]] = {}  # of each model, rows and their answers

    @property
    def key(self) -> bytes:
        return key_of([self.inner, self.model_of])

    def load(self, models: Sequence[Model]) -> None:
        """Load one of each kind; of a kind with much to solve, one per worker that shares the
        work.
        """
        self._last, self.model_of, loaded = {}, np.empty(len(models), int), []
        first = representatives(models,
                                self.traits) if self.share else np.arange(len(models))
        for kind in np.unique(first):
            members = np.flatnonzero(first == kind)
            times = copies(len(members) * self.steps, len(members), self.workers)
            self.model_of[members] = len(loaded) + np.arange(len(members)) * times // len(members)
            loaded += [models[kind]] * times
            if len(members) > 1 and self.traits(models[kind].code).own_matter:
                self._prove(
                    [models[i]
                     for i in dict.fromkeys(members[[0, len(members) // 2, -1]].tolist())])
        super().load(loaded)

    def _prove(self, models: Sequence[Model]) -> None:
        """Raises BlackBoxError where models that are to share a stiffness have different ones: a
        code's own matter may vary
        from place to place whatever it says of itself."""
        first, *others = self.inner.stiffness([replace(model, name=f"{model.name}, once more")
                                               for model in models])
        for model, other in zip(models[1:], others):
            apart = abs(first - other).max() / (abs(first).max() or 1.0)
            if not apart <= ALIKE:
                raise BlackBoxError(
                    f"its stiffness is not that of {models[0].name}, which differs from it by a "
                    f"translation alone: by {apart:.1e}. Its matter varies from place to place: "
                    "leave uniform: true out of the form's entry, or translation_invariant = True "
                    "out of the solver's class",
                    model.name)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Traces; the last answers are remembered."""
        return self._merged(forces, self.inner.traces, remember=True)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        return self._merged(forces, self.inner.fields, remember=False)

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """Advance nonlinear models, which stand for themselves alone."""
        model_of = {index: int(self.model_of[index]) for index in forces}
        answers = self.inner.advance({model_of[index]: f for index, f in forces.items()}, commit)
        return {index: answers[model] for index, model in model_of.items()}

    def _merged(self, forces: Mapping[int, np.ndarray], solve: Callable,
                remember: bool) -> dict[int, np.ndarray]:
        """Right-hand sides that are one and the same array are looked at once for each model, and
        share their answer.
        """
        groups: dict[int, dict[int, int]] = {}  # model → array → a subdomain that has it
        key = {index: id(f) for index, f in forces.items()}
        for index in forces:
            groups.setdefault(int(self.model_of[index]), {}).setdefault(key[index], index)
        rows = {model: np.vstack([forces[i] for i in different.values()])
                for model, different in groups.items()}
        answers, result = self._answered(rows, solve, remember), {}
        for model, different in groups.items():
            ends = np.cumsum([0] + [len(forces[i]) for i in different.values()]).tolist()
            for array, a, b in zip(different, ends[:-1], ends[1:]):
                result[model, array] = answers[model][a:b]
        return {index: result[int(self.model_of[index]), key[index]] for index in forces}

    def _answered(self, rows: dict[int, np.ndarray], solve: Callable,
                  remember: bool) -> dict[int, np.ndarray]:
        """Answers per model to rows (n, size) per model. Rows that are zero, that occur twice, or
        that were asked the last time are told by their bytes, and not solved.
        """
        keys = {model: [row.tobytes() for row in r] for model, r in rows.items()}
        known = {model: self._last.get(model, {}) if remember else {} for model in rows}
        # key → the first row that has it, neither zero nor known
        first: dict[int, dict[bytes, int]] = {model: {} for model in rows}
        for model, r in rows.items():
            for row, (key, loaded) in enumerate(zip(keys[model], r.any(axis=1).tolist())):
                if loaded and key not in known[model]:
                    first[model].setdefault(key, row)
        asked = {model: r[list(first[model].values())] for model, r in rows.items() if first[model]}
        answers = solve(asked) if asked else {}
        for model, r in rows.items():
            if len(first[model]) < len(r):
                found = known[model] | dict(zip(first[model], answers.get(model, ())))
                nothing = np.zeros(r.shape[1])
                answers[model] = np.array([found.get(key, nothing) for key in keys[model]]).reshape(
                    r.shape)
        if remember:
            self._last |= {model: dict(zip(keys[model], answers[model])) for model in rows}
        return answers
