"""Points of interfaces that a law answers for, and where their traces are; ``pairing`` makes
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from orchestrator.laws.base import Law
from orchestrator.laws.points import Status, table
from orchestrator.method.interface.answering import Answering, History, Run
from orchestrator.method.interface.point_traces import NodeCompliance, PointTraces
from orchestrator.method.interface.transfer import Transfer
from orchestrator.parallel.team import Team
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.mortar.operators import Mortar


@dataclass
class Pairs(Answering):
    """All points of a set of interfaces, interface after interface; those of perfect interfaces
    come last.
    """

    interfaces: list[Interface]  # the interfaces, in order
    # between the sides, with points (3, P); none where prescribed, or where the other side is out
    # of reach
    transfer: Transfer
    nodes: NodeCompliance  # (k⁺)⁻¹ of all these interfaces
    runs: list[Run]  # the laws and their points, in order
    mine: np.ndarray  # (P,) bool, points of interfaces whose first side is on this rank
    laws: list[type[Law]]  # all laws of the scene, by name
    # (P,) ε of every point, see ``stabilisation``; None where contacts are not stabilised
    stabilisation: np.ndarray | None
    numbers: np.ndarray  # (T,) int, which load steps of the scene these are
    # (3, P) what B w lacks of the jump of sides that are paired anew as they slide
    slid: np.ndarray
    springs: float = 1.0  # ε over that at the beginning
    # interface → its operators, where sides were paired anew as they slid
    mortars: Mapping[int, Mortar] = field(default_factory=dict)
    # (b,) int, ascending, points of bonds at nodes that have points of other laws as well
    beside: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    # with bonds beside them behind, which answer together with them; None: there are none
    joint: Pairs | None = None

    def __len__(self) -> int:
        return len(self.mine)

    @property
    def bounds(self) -> np.ndarray:
        """(interfaces + 1,) int, where each one's points start."""
        return self.transfer.bounds

    def each(self) -> Iterator[tuple[Interface, slice]]:
        """Return every interface, and its points."""
        return zip(self.interfaces, map(slice, self.bounds[:-1], self.bounds[1:]))

    @property
    def free(self) -> np.ndarray:
        """(3, P) bool, components that there are: not those that are prescribed."""
        return self.transfer.exists

    @cached_property
    def statuses(self) -> list[Status]:
        """All that the laws know."""
        return table(self.laws)

    # ---- traces and laws -----------------------------------------------------------------------

    def traces(self, w: np.ndarray, f: np.ndarray) -> PointTraces:
        """Traces (T, D + G) at the points."""
        return PointTraces(self.transfer, self.points, self.nodes, self.slid, w, f)

    def responses(self, W: np.ndarray, F: np.ndarray) -> Iterator[np.ndarray]:
        """Changes of F by fields W, F (m, D + G) of the bodies, those of the first sides and of the
        second: (m, 3, P) each.
        """
        second = np.zeros(self.transfer.total, dtype=bool)
        for i in self.interfaces:
            second[self.transfer.sides[i.index][1]] = True
        linear = replace(self, slid=np.zeros_like(self.slid))
        return (linear.traces(np.where(side, W, 0.0), np.where(side, F, 0.0)).predicted()
                for side in (~second, second))

    def duality_gap(self, force: np.ndarray, jump: np.ndarray, before: History,
                    step: int) -> np.ndarray:
        """(P,) γ of forces and jumps (3, P), as ``Law.duality_gap``; 0 at points of other ranks,
        and of laws that have no price.
        """
        result = np.zeros(len(self))
        for run in self.runs:
            if run.law.duality_gap:
                part = run.part
                result[part] = run.law.duality_gap(run.points.at(step), force[:, part],
                                                   jump[:, part], before.jump[:, part])
        return np.where(self.mine, result, 0.0)

    # ---- springs of stabilisation --------------------------------------------------------------

    def anchors(self, w: np.ndarray | None) -> np.ndarray | None:
        """(T, 3, P) jumps of traces (T, D + G), at which springs carry nothing; None without
        springs, or without traces.
        """
        if self.stabilisation is None or w is None:
            return None
        return self.transfer.jump(w) + self.slid

    def weakest(self, team: Team) -> float:
        """The smallest ε of springs of stabilisation, of all ranks; infinite where there are
        none.
        """
        if self.stabilisation is None:  # on all ranks, or on none
            return np.inf
        return -team.max(-self.stabilisation[self.stabilisation > 0].min(initial=np.inf))[0]

    def weakened(self, share: float) -> Pairs:
        """Scale the springs of stabilisation to that share of ε."""
        return replace(self, stabilisation=share * self.stabilisation,
                       springs=share * self.springs,
                       joint=self.joint and self.joint.weakened(share))

    # ---- parts ---------------------------------------------------------------------------------

    def some(self, chosen: np.ndarray) -> Pairs:
        """Some of the points (Q,) int, ascending, of the same interfaces."""
        springs = self.stabilisation if self.stabilisation is None else self.stabilisation[chosen]
        return replace(self, transfer=self.transfer.some(chosen), mine=self.mine[chosen],
                       runs=self.runs_at(chosen),
                       stabilisation=springs, slid=self.slid[:, chosen])

    @cached_property
    def lawful(self) -> Pairs:
        """The points of interfaces that are not perfect."""
        count = self._opening
        if count == len(self.interfaces):
            return self
        first, traces = np.arange(self.bounds[count]), np.zeros(self.transfer.total, dtype=bool)
        for i in self.interfaces[:count]:
            for side in self.transfer.sides[i.index]:
                traces[side] = True
        some = self.some(first)
        return replace(some, interfaces=self.interfaces[:count],
                       transfer=replace(some.transfer, bounds=self.bounds[: count + 1]),
                       nodes=self.nodes.some(traces),
                       runs=[run for run in some.runs if not run.law.perfect],
                       joint=self._joint(traces) if len(self.beside) else None)

    @property
    def together(self) -> np.ndarray:
        """(J,) int, ascending, points of laws other than the perfect one, and bonds beside them."""
        return np.concatenate([np.arange(self.bounds[self._opening]), self.beside])

    @property
    def _opening(self) -> int:
        """Interfaces that are not perfect, which come first."""
        return sum(not i.law.perfect for i in self.interfaces)

    def _joint(self, traces: np.ndarray) -> Pairs:
        """Those that are ``together``; traces (D + G,) bool, of interfaces that are not perfect."""
        traces = traces.copy()
        for side in (self.transfer.one, self.transfer.two):
            dofs = side[:, self.beside]
            traces[dofs[dofs >= 0]] = True
        return replace(self.some(self.together), nodes=self.nodes.some(traces))

    def batch(self, steps) -> Pairs:
        """The pairs for some of the load steps, a slice or indices."""
        return replace(self, numbers=self.numbers[steps],
                       joint=self.joint and self.joint.batch(steps))

    def at_steps_of(self, other: Pairs) -> Pairs:
        """The pairs for the load steps of others."""
        return replace(self, numbers=other.numbers,
                       joint=self.joint and self.joint.at_steps_of(other))
