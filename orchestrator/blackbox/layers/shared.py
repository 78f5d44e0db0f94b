"""Congruent subdomains as one model, and right-hand sides that need no solve.

A layer around any black box. Subdomains that differ by a translation alone, or that are images of each other, are loaded
and factorised once; their forces become further right-hand sides of the one model. A right-hand side that is zero, that
occurs twice, or that was asked the last time already, is not solved at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.blackbox.cost import copies
from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.models.congruence import Image, images, representatives
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.errors import BlackBoxError
from orchestrator.savings import Savings

ALIKE = 1e-8  # relative: stiffnesses of the same tets at other places, whose coordinates are rounded


class SharedModels(Layer):
    """Maps subdomains to distinct models and merges their right-hand sides.

    Parameters
    ----------
    inner : the black box that holds the distinct models
    congruent : share models
    repeated : solve no right-hand side twice
    workers : processes behind ``inner``
    steps : load steps, the right-hand sides of a subdomain in a linear stage
    savings : where what is saved is noted

    Attributes
    ----------
    model_of : (subdomains,) int, the model of ``inner`` that answers for each
    image_of : of a subdomain that is an image of its model, how: on all dofs, and on trace dofs
    """

    def __init__(self, inner: BlackBox, *, congruent: bool, repeated: bool, workers: int, steps: int,
                 savings: Savings):
        super().__init__(inner)
        self.congruent, self.repeated = congruent, repeated
        self.workers, self.steps, self.savings = workers, steps, savings
        self.model_of = np.empty(0, int)
        self.image_of: dict[int, tuple[Image, Image]] = {}
        self._last: dict[int, dict[bytes, np.ndarray]] = {}  # of each model, rows and their answers
        self._parts: Sequence[slice] | None = None
        self._columns: dict[int, tuple[np.ndarray | slice, np.ndarray | None]] = {}

    def load(self, models: Sequence[Model]) -> None:
        """Load one of each kind; of a kind with much to solve, one per worker that shares the work."""
        self._last, self._parts = {}, None
        first = representatives(models, self.traits) if self.congruent else np.arange(len(models))
        self.image_of = self._show(models, first) if self.congruent else {}
        self.model_of = np.empty(len(models), int)
        loaded: list[Model] = []
        for kind in np.unique(first):
            members = np.flatnonzero(first == kind)
            times = copies(len(members) * self.steps, len(members), self.workers)
            self.model_of[members] = len(loaded) + np.arange(len(members)) * times // len(members)
            loaded += [models[kind]] * times
            if len(members) > 1 and self.traits(models[kind].code).own_matter:
                self._prove([models[member] for member in {0: members[0], len(members) // 2: members[len(members) // 2],
                                                           len(members) - 1: members[-1]}.values()])
        self.savings.add("congruent", "factorisations", len(models) - len(loaded))
        super().load(loaded)

    def _show(self, models: Sequence[Model], first: np.ndarray) -> dict[int, tuple[Image, Image]]:
        """Have images stand behind what they are images of: ``first`` (models,) is changed. Per model that is one, how.

        The matter of the codes asked is judged by the model's mesh and moduli, which are isotropic.
        """
        known = {code: self.traits(code) for code in {m.code for m in models}}
        kinds = [int(i) for i in np.unique(first) if known[models[i].code].translation_invariant
                 and not known[models[i].code].own_matter and not known[models[i].code].nonlinear and len(models[i].trace)]
        shown: dict[int, tuple[Image, Image]] = {}
        for kind, (original, image) in images(models, kinds).items():
            both = image, image.on(models[kind].trace, models[original].trace)
            members = np.flatnonzero(first == kind)
            first[members] = original
            shown |= dict.fromkeys(members.tolist(), both)
        return shown

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
        """As the protocol says."""
        return self._merged(forces, self.inner.fields, remember=False)

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says; nonlinear models stand for themselves alone."""
        model_of = {index: int(self.model_of[index]) for index in forces}
        answers = self.inner.advance({model_of[index]: f for index, f in forces.items()}, commit)
        return {index: answers[model] for index, model in model_of.items()}

    def all_traces(self, forces: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """As ``Layer`` says: one index array per model gathers the rows of all that it stands for."""
        if parts is not self._parts:
            self._parts, self._columns = parts, self._columns_of(parts)
        count, rows = len(forces), {}
        for model, (columns, sign) in self._columns.items():
            if isinstance(columns, slice):
                rows[model] = forces[:, columns]
            else:
                own = forces[:, columns] if sign is None else forces[:, columns] * sign
                rows[model] = own.transpose(1, 0, 2).reshape(-1, columns.shape[1])
        answers, result = self._answered(rows, self.inner.traces, remember=True), np.zeros(forces.shape)
        for model, (columns, sign) in self._columns.items():
            if isinstance(columns, slice):
                result[:, columns] = answers[model]
            else:
                own = answers[model].reshape(len(columns), count, -1).transpose(1, 0, 2)
                result[:, columns] = own if sign is None else own * sign
        return result

    def _columns_of(self, parts: Sequence[slice]) -> dict[int, tuple[np.ndarray | slice, np.ndarray | None]]:
        """Per model that has any, the columns of the subdomains that it stands for, (subdomains, t), or those of the one;
        and their signs, where some are images."""
        starts, ends = np.array([(part.start, part.stop) for part in parts], dtype=int).reshape(-1, 2).T
        order = np.argsort(self.model_of, kind="stable")
        models, first = np.unique(self.model_of[order], return_index=True)
        found: dict[int, tuple[np.ndarray | slice, np.ndarray | None]] = {}
        for model, members in zip(models.tolist(), np.split(order, first[1:])):
            size = ends[members[0]] - starts[members[0]]
            shown = [(place, self.image_of[e][1]) for place, e in enumerate(members.tolist()) if e in self.image_of]
            if size and len(members) == 1 and not shown:
                found[model] = parts[members[0]], None
            elif size:
                columns, sign = starts[members][:, None] + np.arange(size), np.ones((len(members), size)) if shown else None
                for place, image in shown:
                    columns[place, image.source] = starts[members[place]] + np.arange(size)
                    sign[place, image.source] = image.sign
                found[model] = columns, sign
        return found

    def _merged(self, forces: Mapping[int, np.ndarray], solve, remember: bool) -> dict[int, np.ndarray]:
        """Right-hand sides that are one and the same array are looked at once for each model and image, and share their answer."""
        groups: dict[int, dict[tuple, int]] = {}  # model → array, image → a subdomain that has it
        images = {index: self.image_of[index][remember] for index in forces if index in self.image_of}
        key = {index: (id(f) if self.repeated else index, id(images.get(index))) for index, f in forces.items()}
        for index in forces:
            groups.setdefault(int(self.model_of[index]), {}).setdefault(key[index], index)
        rows = {model: np.vstack([images[i].to_other(forces[i]) if i in images else forces[i] for i in different.values()])
                for model, different in groups.items()}
        again = sum(len(f) for f in forces.values()) - sum(len(r) for r in rows.values())
        answers, result = self._answered(rows, solve, remember, again), {}
        for model, different in groups.items():
            ends = np.cumsum([0] + [len(forces[i]) for i in different.values()]).tolist()
            for (array, i), a, b in zip(different.items(), ends[:-1], ends[1:]):
                result[model, array] = images[i].back(answers[model][a:b]) if i in images else answers[model][a:b]
        return {index: result[int(self.model_of[index]), key[index]] for index in forces}

    def _answered(self, rows: dict[int, np.ndarray], solve, remember: bool, again: int = 0) -> dict[int, np.ndarray]:
        """Answers per model to rows (n, size) per model, of which ``again`` more have been asked for.

        Rows that are zero, that occur twice, or that were asked the last time are told by their bytes, and not solved.
        """
        if not self.repeated:
            return solve(rows)
        keys = {model: [row.tobytes() for row in r] for model, r in rows.items()}
        known = {model: self._last.get(model, {}) if remember else {} for model in rows}
        first = {model: _new(r, keys[model], known[model]) for model, r in rows.items()}
        asked = {model: r if len(first[model]) == len(r) else r[list(first[model].values())] for model, r in rows.items() if first[model]}
        answers = solve(asked) if asked else {}
        for model, r in rows.items():
            if len(first[model]) < len(r):
                found = known[model] | dict(zip(first[model], answers.get(model, ())))
                answers[model] = np.zeros(r.shape)
                for row, key in enumerate(keys[model]):
                    if key in found:
                        answers[model][row] = found[key]
        if remember:
            self._last |= {model: dict(zip(keys[model], answers[model])) for model in rows}
        self.savings.add("repeated", "back-substitutions",
                         again + sum(len(r) for r in rows.values()) - sum(len(a) for a in asked.values()))
        return answers


def _new(rows: np.ndarray, keys: Sequence[bytes], known: Mapping[bytes, np.ndarray]) -> dict[bytes, int]:
    """Key → the first row that has it, of those that are neither zero nor known."""
    first: dict[bytes, int] = {}
    for row, (key, loaded) in enumerate(zip(keys, rows.any(axis=1).tolist())):
        if loaded and key not in known:
            first.setdefault(key, row)
    return first
