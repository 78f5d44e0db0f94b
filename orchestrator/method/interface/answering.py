"""Points and their laws: what all of them answer to the forces that their search directions
predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer, Carries, Collective, Points


@dataclass(frozen=True)
class History:
    """The state of all pairs at the end of a load step.

    jump : (3, P) u₂ − u₁
    own : name → (P,) value of a law's own variable; 0 at pairs of other laws
    """

    jump: np.ndarray
    own: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def none(cls, count: int) -> History:
        """The past of pairs that nothing has happened to: an empty ``own`` stands for zeros."""
        return cls(np.zeros((3, count)))

    def take(self, chosen: slice | np.ndarray) -> History:
        """The past of some of the pairs."""
        if isinstance(chosen, slice):
            return History(self.jump[:, chosen], {name: x[chosen] for name, x in self.own.items()})
        return History(self.jump.take(chosen, axis=1),
                       {name: x.take(chosen) for name, x in self.own.items()})

    def among(self, count: int) -> History:
        """The past of more pairs, the first of which are these; nothing has happened to the
        others.
        """
        rest = count - self.jump.shape[1]
        return History(np.pad(self.jump, ((0, 0), (0, rest))),
                       {name: np.pad(x, (0, rest)) for name, x in self.own.items()})


@dataclass
class Run:
    """Neighbouring interfaces of the same law, worked on as one."""

    law: type[Law]  # its class
    part: slice  # which of the pairs
    points: Points  # geometry, search direction and the law's parameters


class Answering:
    """Points with laws.

    runs : the laws and their points, in order
    free : (3, P) bool, components that there are: not those that are prescribed
    stabilisation : (P,) ε of every point, see ``stabilisation``; None where contacts are not
        stabilised
    """

    runs: list[Run]
    free: np.ndarray
    stabilisation: np.ndarray | None

    @cached_property
    def points(self) -> Points:
        """Geometry and search direction of all pairs."""
        own = [Points(np.zeros((3, 0)), *np.zeros((3, 0))), *(run.points for run in self.runs)]
        return Points(*(np.concatenate([getattr(points, name) for points in own], axis=-1)
                        for name in ("normal", "stiff_n", "stiff_t", "area")))

    @cached_property
    def _all_free(self) -> bool:
        return bool(self.free.all())

    def force(self, F: np.ndarray, before: History, step: int, derivative: bool = False) -> Answer:
        """The laws' answer for the predicted forces F (3, P), each interface by its own law.

        before : what the load step before has left
        step : of the scene, one of ``numbers``
        """
        parts = [
            (run.part, run.law.force(run.points.at(step, self._own(run, before)), F[:, run.part],
                                          before.jump[:, run.part], derivative))
            for run in self.runs]
        if len(parts) == 1 and self._all_free:
            return parts[0][1]

        def all_of(empty: np.ndarray, name: str) -> np.ndarray:
            return np.concatenate([empty, *(getattr(answer, name) for _, answer in parts)], axis=-1)

        answer = Answer(self.masked(all_of(np.zeros((3, 0)), "force")),
                        all_of(np.zeros(0, int), "status"), own={
            name: np.concatenate([a.own.get(name, np.zeros(len(a.status))) for _, a in parts])
            for name in dict.fromkeys(name for _, a in parts for name in a.own)})
        if derivative:
            answer.active = np.concatenate([np.zeros(0, int),
                                            *(a.active + part.start for part, a in parts)])
            free = self.free[:, answer.active]
            answer.derivative = np.where(free[:, None] & free,
                                         all_of(np.zeros((3, 3, 0)), "derivative"), 0.0)
            answer.collective = self._collective([(part, a.collective) for part, a in parts
                                                  if a.collective is not None])
        return answer

    def carries(self, before: History, step: int) -> list[tuple[slice, Carries]]:
        """Forces that the laws allow points to carry, those of one law after those of the other; as
        for ``force``.
        """
        return [(run.part, run.law.carries(run.points.at(step, self._own(run, before))))
                for run in self.runs]

    @staticmethod
    def _own(run: Run, before: History) -> dict[str, np.ndarray]:
        """The law's own variables at its points, as the load step before has left them."""
        return {name: before.own[name][run.part] if name in before.own
                else np.zeros(len(run.points))
                for name in run.law.variables}

    def _collective(self, parts: list[tuple[slice, Collective]]) -> Collective | None:
        """Collective answers of several laws, whose groups are their own."""
        if not parts:
            return None
        first = np.cumsum([0] + [int(c.group.max(initial=-1)) + 1 for _, c in parts])
        at = np.concatenate([c.at + part.start for part, c in parts])
        given, taken = (np.where(self.free[:, at],
                                 np.concatenate([getattr(c, name) for _, c in parts], axis=1), 0.0)
                        for name in ("given", "taken"))
        return Collective(np.concatenate([c.group + start for (_, c), start in zip(parts, first)]),
                          at, given, taken)

    def masked(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) values, zero where prescribed."""
        return x if self._all_free else np.where(self.free, x, 0.0)

    def compliance(self, force: np.ndarray) -> np.ndarray:
        """(…, 3, P) the jumps that forces (…, 3, P) are worth, force / keq."""
        return self.masked(self.points.compliance(force))

    def slopes(self, answer: Answer, springs: np.ndarray | float) -> np.ndarray:
        """(3, 3, P) (1 − ε) ∂f̂/∂F + ε of springs ε (P,), zero where components are prescribed."""
        result = np.zeros((3, 3, self.free.shape[1]))
        result[:, :, answer.active] = answer.derivative
        result *= 1 - springs
        result[range(3), range(3)] += springs
        return np.where(self.free[:, None] & self.free, result, 0.0)

    def settled(self, lawful: np.ndarray, F: np.ndarray,
                anchor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, P) f̂ = (1 − ε) law(F) + ε (F − keq d₀), where anything is stabilised, and d = (F −
        f̂)/keq.

        lawful : law(F); F : as for ``force``
        anchor : (3, P) d₀, the jump at which springs carry nothing
        """
        force = lawful if self.stabilisation is None else lawful + self.stabilisation * (
            self.resisted(F, anchor) - lawful)
        return force, self.compliance(F - force)

    def resisted(self, F: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        """(3, P) F − keq d₀: the force that leaves points where springs carry nothing."""
        return self.masked(F - self.points.stiffness(anchor))

    def alone(self, chosen: np.ndarray) -> LawPoints:
        """Return some of the points (Q,) int, ascending, without their traces."""
        springs = self.stabilisation if self.stabilisation is None else self.stabilisation[chosen]
        return LawPoints(self.runs_at(chosen), self.free[:, chosen], springs)

    def runs_at(self, chosen: np.ndarray) -> list[Run]:
        """Runs of some of the points (Q,) int, ascending."""
        ends = np.searchsorted(chosen, [run.part.stop for run in self.runs]).tolist()
        return [Run(run.law, slice(a, b), run.points.some(chosen[a:b] - run.part.start))
                for run, a, b in zip(self.runs, [0, *ends], ends)]


@dataclass
class LawPoints(Answering):
    """Points with laws, of any interfaces."""

    runs: list[Run]
    free: np.ndarray
    stabilisation: np.ndarray | None

    def __len__(self) -> int:
        return self.free.shape[1]

    @classmethod
    def joined(cls, parts: Sequence[LawPoints]) -> LawPoints:
        """Return the points of all parts, one after the other."""
        starts = np.cumsum([0, *map(len, parts)]).tolist()
        runs = [replace(run, part=slice(run.part.start + start, run.part.stop + start))
                for part, start in zip(parts, starts) for run in part.runs
                if run.part.stop > run.part.start]
        springs = None if parts[0].stabilisation is None else np.concatenate(
            [p.stabilisation for p in parts])
        return cls(runs, np.concatenate([part.free for part in parts], axis=1), springs)
