"""Points of interfaces that a law answers for, and where their traces are; ``pairing`` makes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer, Carries, Collective, Points, Status, table
from orchestrator.method.interface.point_traces import NodeCompliance, PointTraces
from orchestrator.method.interface.transfer import Transfer
from orchestrator.parallel.team import Team
from orchestrator.scene.interface import Interface


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
        return History(self.jump.take(chosen, axis=1), {name: x.take(chosen) for name, x in self.own.items()})

    def among(self, count: int) -> History:
        """The past of more pairs, the first of which are these; nothing has happened to the others."""
        rest = count - self.jump.shape[1]
        return History(np.pad(self.jump, ((0, 0), (0, rest))), {name: np.pad(x, (0, rest)) for name, x in self.own.items()})


@dataclass
class Run:
    """Neighbouring interfaces of the same law, worked on as one."""

    law: type[Law]  # its class
    part: slice  # which of the pairs
    points: Points  # geometry, search direction and the law's parameters


@dataclass
class Pairs:
    """All points of a set of interfaces, interface after interface; those of perfect interfaces come last."""

    interfaces: list[Interface]  # the interfaces, in order
    transfer: Transfer  # between the sides, with points (3, P); none where prescribed, or where the other side is out of reach
    nodes: NodeCompliance  # (k⁺)⁻¹ of all these interfaces
    runs: list[Run]  # the laws and their points, in order
    mine: np.ndarray  # (P,) bool, points of interfaces whose first side is on this rank
    laws: list[type[Law]]  # all laws of the scene, by name
    stabilisation: np.ndarray | None  # (P,) ε of every point, see ``stabilisation``; None where contacts are not stabilised
    numbers: np.ndarray  # (T,) int, which load steps of the scene these are
    slid: np.ndarray | None = None  # (3, P) what B w lacks of the jump of sides that are paired anew as they slide; None where none are

    def __len__(self) -> int:
        return len(self.mine)

    @property
    def bounds(self) -> np.ndarray:
        """(interfaces + 1,) int, where each one's points start."""
        return self.transfer.bounds

    @property
    def free(self) -> np.ndarray:
        """(3, P) bool, components that there are: not those that are prescribed."""
        return self.transfer.exists

    @cached_property
    def statuses(self) -> list[Status]:
        """All that the laws know."""
        return table(self.laws)

    @cached_property
    def points(self) -> Points:
        """Geometry and search direction of all pairs."""
        own = [Points(np.zeros((3, 0)), *np.zeros((3, 0))), *(run.points for run in self.runs)]
        return Points(*(np.concatenate([getattr(points, name) for points in own], axis=-1)
                        for name in ("normal", "stiff_n", "stiff_t", "area")))

    @cached_property
    def _all_free(self) -> bool:
        return bool(self.free.all())

    # ---- traces and laws -----------------------------------------------------------------------

    def traces(self, w: np.ndarray, f: np.ndarray) -> PointTraces:
        """Traces (T, D + G) at the points."""
        return PointTraces(self.transfer, self.points, self.nodes, self.slid, w, f)

    def responses(self, W: np.ndarray, F: np.ndarray) -> Iterator[np.ndarray]:
        """Changes of F by fields W, F (m, D + G) of the bodies, those of the first sides and of the second: (m, 3, P) each."""
        second = np.zeros(self.transfer.total, dtype=bool)
        for i in self.interfaces:
            second[self.transfer.sides[i.index][1]] = True
        linear = replace(self, slid=None)
        return (linear.traces(np.where(side, W, 0.0), np.where(side, F, 0.0)).predicted() for side in (~second, second))

    def force(self, F: np.ndarray, before: History, step: int, derivative: bool = False) -> Answer:
        """The laws' answer for the predicted forces F (3, P), each interface by its own law.

        before : what the load step before has left
        step : of the scene, one of ``numbers``
        """
        parts = [(run.part, run.law.force(run.points.at(step, self._own(run, before)), F[:, run.part],
                                          before.jump[:, run.part], derivative)) for run in self.runs]
        if len(parts) == 1 and self._all_free:
            return parts[0][1]

        def all_of(empty: np.ndarray, name: str) -> np.ndarray:
            return np.concatenate([empty, *(getattr(answer, name) for _, answer in parts)], axis=-1)

        answer = Answer(self.masked(all_of(np.zeros((3, 0)), "force")), all_of(np.zeros(0, int), "status"), own={
            name: np.concatenate([a.own.get(name, np.zeros(len(a.status))) for _, a in parts])
            for name in dict.fromkeys(name for _, a in parts for name in a.own)})
        if derivative:
            answer.active = np.concatenate([np.zeros(0, int), *(a.active + part.start for part, a in parts)])
            free = self.free[:, answer.active]
            answer.derivative = np.where(free[:, None] & free, all_of(np.zeros((3, 3, 0)), "derivative"), 0.0)
            answer.collective = self._collective([(part, a.collective) for part, a in parts if a.collective is not None])
        return answer

    def carries(self, before: History, step: int) -> list[tuple[slice, Carries]]:
        """Forces that the laws allow points to carry, those of one law after those of the other; as for ``force``."""
        return [(run.part, run.law.carries(run.points.at(step, self._own(run, before)))) for run in self.runs]

    @staticmethod
    def _own(run: Run, before: History) -> dict[str, np.ndarray]:
        """The law's own variables at its points, as the load step before has left them."""
        return {v.name: before.own[v.name][run.part] if v.name in before.own else np.zeros(len(run.points))
                for v in run.law.variables}

    def _collective(self, parts: list[tuple[slice, Collective]]) -> Collective | None:
        """Collective answers of several laws, whose groups are their own."""
        if not parts:
            return None
        first = np.cumsum([0] + [int(c.group.max(initial=-1)) + 1 for _, c in parts])
        at = np.concatenate([c.at + part.start for part, c in parts])
        given, taken = (np.where(self.free[:, at], np.concatenate([getattr(c, name) for _, c in parts], axis=1), 0.0)
                        for name in ("given", "taken"))
        return Collective(np.concatenate([c.group + start for (_, c), start in zip(parts, first)]), at, given, taken)

    def masked(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) values, zero where prescribed."""
        return x if self._all_free else np.where(self.free, x, 0.0)

    def compliance(self, force: np.ndarray) -> np.ndarray:
        """(…, 3, P) the jumps that forces (…, 3, P) are worth, force / keq."""
        return self.masked(self.points.compliance(force))

    def duality_gap(self, force: np.ndarray, jump: np.ndarray, before: History, step: int) -> np.ndarray:
        """(P,) γ of forces and jumps (3, P), as ``Law.duality_gap``; 0 at points of other ranks, and of laws that have no price."""
        result = np.zeros(len(self))
        for run in self.runs:
            if run.law.prices:
                part = run.part
                result[part] = run.law.duality_gap(run.points.at(step), force[:, part], jump[:, part], before.jump[:, part])
        return np.where(self.mine, result, 0.0)

    # ---- springs of stabilisation --------------------------------------------------------------

    def anchors(self, w: np.ndarray | None) -> np.ndarray | None:
        """(T, 3, P) jumps of traces (T, D + G), at which springs carry nothing; None without springs, or without traces."""
        if self.stabilisation is None or w is None:
            return None
        jump = self.transfer.jump(w)
        return jump if self.slid is None else jump + self.slid

    def settled(self, lawful: np.ndarray, F: np.ndarray, anchor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, P) f̂ = (1 − ε) law(F) + ε (F − keq d₀), where anything is stabilised, and d = (F − f̂)/keq.

        lawful : law(F); F : as for ``force``
        anchor : (3, P) d₀, the jump at which springs carry nothing
        """
        force = lawful if self.stabilisation is None else lawful + self.stabilisation * (self.resisted(F, anchor) - lawful)
        return force, self.compliance(F - force)

    def resisted(self, F: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        """(3, P) F − keq d₀: the force that leaves points where springs carry nothing."""
        return self.masked(F - self.points.stiffness(anchor))

    def weakest(self, team: Team) -> float:
        """The smallest ε of springs of stabilisation, of all ranks; infinite where there are none."""
        if self.stabilisation is None:  # on all ranks, or on none
            return np.inf
        return -team.max(-self.stabilisation[self.stabilisation > 0].min(initial=np.inf))[0]

    def weakened(self, share: float) -> Pairs:
        """Scale the springs of stabilisation to that share of ε."""
        return replace(self, stabilisation=share * self.stabilisation)

    # ---- parts ---------------------------------------------------------------------------------

    def some(self, chosen: np.ndarray) -> Pairs:
        """Some of the points (Q,) int, ascending, of the same interfaces."""
        ends = np.searchsorted(chosen, [run.part.stop for run in self.runs]).tolist()
        runs = [Run(run.law, slice(a, b), run.points.some(chosen[a:b] - run.part.start))
                for run, a, b in zip(self.runs, [0, *ends], ends)]
        stabilisation, slid = (x if x is None else x[..., chosen] for x in (self.stabilisation, self.slid))
        return replace(self, transfer=self.transfer.some(chosen), mine=self.mine[chosen], runs=runs, stabilisation=stabilisation,
                       slid=slid)

    def among(self, interfaces: np.ndarray) -> Pairs:
        """The same points as those of some of the interfaces (I,) bool; the others have none."""
        own = [i for i, kept in zip(self.interfaces, interfaces) if kept]
        bounds = self.bounds[np.concatenate([[True], interfaces])]
        return replace(self, interfaces=own, transfer=replace(self.transfer, bounds=bounds))

    @cached_property
    def lawful(self) -> Pairs:
        """The points of interfaces that are not perfect."""
        count = sum(not i.law.perfect for i in self.interfaces)
        if count == len(self.interfaces):
            return self
        first, traces = np.arange(self.bounds[count]), np.zeros(self.transfer.total, dtype=bool)
        for i in self.interfaces[:count]:
            for side in self.transfer.sides[i.index]:
                traces[side] = True
        some = self.some(first)
        return replace(some, interfaces=self.interfaces[:count], transfer=replace(some.transfer, bounds=self.bounds[: count + 1]),
                       nodes=self.nodes.some(traces, first, len(self)), runs=[run for run in some.runs if not run.law.perfect])

    def batch(self, steps) -> Pairs:
        """The pairs for some of the load steps, a slice or indices."""
        return replace(self, numbers=self.numbers[steps])

    def at_steps_of(self, other: Pairs) -> Pairs:
        """The pairs for the load steps of others."""
        return replace(self, numbers=other.numbers)
