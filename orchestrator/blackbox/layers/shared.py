"""Congruent subdomains as one model, and right-hand sides that need no solve.

A layer around any black box. Subdomains that differ by a translation alone, or that are images of each other, are loaded
and factorised once; their forces become further right-hand sides of the one model. A right-hand side that is zero, that
occurs twice, or that was asked the last time already, is not solved at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from orchestrator.blackbox.cost import copies
from orchestrator.blackbox.layers.layer import Layer
from orchestrator.blackbox.models.congruence import representatives
from orchestrator.blackbox.models.images import Image, images, spanned
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
        self._last: dict[int, tuple[_Rows, np.ndarray]] = {}
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
                rows[model] = np.array(forces[:, columns])  # a copy: it is remembered
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
        rows, expansions = {}, {}
        for model, different in groups.items():
            parts = [images[i].to_other(forces[i]) if i in images else forces[i] for i in different.values()]
            rows[model] = np.vstack(parts)
            if remember and len(parts) > 1 and any(i in images for i in different.values()):
                rows[model], expansions[model] = spanned(parts)
        again = sum(len(f) for f in forces.values()) - sum(len(r) for r in rows.values())
        answers, result = self._answered(rows, solve, remember, again), {}
        for model, different in groups.items():
            whole = expansions[model] @ answers[model] if model in expansions else answers[model]
            ends = np.cumsum([0] + [len(forces[i]) for i in different.values()]).tolist()
            for (array, i), a, b in zip(different.items(), ends[:-1], ends[1:]):
                result[model, array] = images[i].back(whole[a:b]) if i in images else whole[a:b]
        return {index: result[int(self.model_of[index]), key[index]] for index in forces}

    def _answered(self, rows: dict[int, np.ndarray], solve, remember: bool, again: int = 0) -> dict[int, np.ndarray]:
        """Answers per model to rows per model, of which ``again`` more have been asked for."""
        if not self.repeated:
            return solve(rows)
        plans = {model: _plan(r, self._last.get(model) if remember else None) for model, r in rows.items()}
        asked = {model: plan.chosen for model, plan in plans.items() if len(plan.solved)}
        new = solve(asked) if asked else {}
        answers = {model: plan.answers(new.get(model)) for model, plan in plans.items()}
        if remember:
            self._last |= {model: (plans[model].asked, answers[model]) for model in rows}
        self.savings.add("repeated", "back-substitutions",
                         again + sum(len(r) for r in rows.values()) - sum(len(a) for a in asked.values()))
        return answers


class _Rows:
    """Right-hand sides (n, size), found by their keys."""

    def __init__(self, rows: np.ndarray):
        self.rows = rows

    @cached_property
    def keys(self) -> list[float]:
        """(n,) each row's product with random numbers, summed in one order: the same for equal rows wherever they are."""
        return np.einsum("ij,j->i", self.rows, _weights(self.rows.shape[1])).tolist()

    @cached_property
    def _first(self) -> dict[float, int]:
        """Key to the first row that has it."""
        return {key: place for place, key in reversed([*enumerate(self.keys)])}

    def find(self, other: _Rows, chosen: np.ndarray) -> np.ndarray:
        """(m,) int, where the chosen rows (m,) of others are; −1 where they are not."""
        if len(self.rows) == 1:
            return np.where((other.rows[chosen] == self.rows).all(axis=1), 0, -1)
        found = np.array([self._first.get(other.keys[i], -1) for i in chosen.tolist()], dtype=int)
        known = np.flatnonzero(found >= 0)
        if len(known):
            found[known[(self.rows[found[known]] != other.rows[chosen[known]]).any(axis=1)]] = -1
        return found

    def firsts(self, chosen: np.ndarray) -> np.ndarray:
        """(m,) int, for each of the chosen rows (m,) the first of them that is equal."""
        if len(chosen) <= 1:
            return chosen
        first: dict[float, int] = {}
        twin = np.array([first.setdefault(self.keys[i], i) for i in chosen.tolist()])
        again = np.flatnonzero(twin != chosen)
        if len(again):
            different = again[(self.rows[twin[again]] != self.rows[chosen[again]]).any(axis=1)]  # by chance of equal keys
            twin[different] = chosen[different]
        return twin


@lru_cache(maxsize=1024)
def _weights(size: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(1.0, 2.0, size)


class _Plan:
    """Which of the rows (n, size) are solved, and where the others' answers come from.

    Parameters
    ----------
    last : rows asked before, and their answers

    Attributes
    ----------
    solved : (m,) int, ascending, rows that are new and occur for the first time
    source : (n,) int, of each row the place of its answer among the solved; −1 where it is zero or recalled
    recalled : (n,) int, of each row the place of its answer among those remembered; −1 where it is not
    """

    def __init__(self, rows: np.ndarray, last: tuple[_Rows, np.ndarray] | None):
        self.asked, self.last = _Rows(rows), last
        self.source, self.recalled = np.full((2, len(rows)), -1)
        new = np.flatnonzero(rows.any(axis=1))
        if last is not None and len(last[1]) and len(new):
            self.recalled[new] = last[0].find(self.asked, new)
            new = new[self.recalled[new] < 0]
        twin = self.asked.firsts(new)
        if (twin == new).all():
            self.solved, self.source[new] = new, np.arange(len(new))
        else:
            self.solved, self.source[new] = np.unique(twin, return_inverse=True)

    @property
    def chosen(self) -> np.ndarray:
        """(m, size) the rows to solve."""
        rows = self.asked.rows
        return rows if len(self.solved) == len(rows) else rows[self.solved]

    def answers(self, new: np.ndarray | None) -> np.ndarray:
        """(n, size) the answers to all rows, given those (m, size) to the solved ones."""
        if new is not None and len(new) == len(self.source):
            return new
        result, asked, known = np.zeros(self.asked.rows.shape), self.source >= 0, self.recalled >= 0
        if new is not None:
            result[asked] = new[self.source[asked]]
        if known.any():
            result[known] = self.last[1][self.recalled[known]]
        return result


class _PlanOfOne(_Plan):
    """``_Plan`` of one row, where none or one was asked before: of a thousand subdomains each has one in every iteration."""

    def __init__(self, rows: np.ndarray, last: tuple[_Rows, np.ndarray] | None):
        self.asked = _Rows(rows)
        self.known = last[1] if last is not None and (last[0].rows == rows).all() else None
        self.solved = _FIRST if self.known is None and rows.any() else _NONE

    @property
    def chosen(self) -> np.ndarray:
        """As ``_Plan`` says."""
        return self.asked.rows

    def answers(self, new: np.ndarray | None) -> np.ndarray:
        """As ``_Plan`` says."""
        if new is not None:
            return new
        return np.zeros(self.asked.rows.shape) if self.known is None else self.known.copy()


_FIRST, _NONE = np.zeros(1, dtype=int), np.empty(0, dtype=int)


def _plan(rows: np.ndarray, last: tuple[_Rows, np.ndarray] | None) -> _Plan:
    return (_PlanOfOne if len(rows) == 1 and (last is None or len(last[1]) == 1) else _Plan)(rows, last)
