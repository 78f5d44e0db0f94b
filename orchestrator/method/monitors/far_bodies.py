"""Bodies that move further than small displacements allow, noticed while it runs.

What is squeezed out between its neighbours comes to rest, if at all, only after moving many times
what is prescribed. The rigid motion that supports leave a body (see ``law_residuals``) is compared
with the body itself at every iteration and load step. What stays too large for ``PATIENCE``
iterations, or is so at the end, is told with what touches the body there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from orchestrator.errors import SHOWN, some
from orchestrator.laws.points import table
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.local_stage import LocalState
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.law_residuals import Lengths, LengthScale
from orchestrator.scene.conditions.rigid import DISPLACEMENT, ROTATION

PATIENCE = 3  # iterations: one or two are often an overshoot of the acceleration


@dataclass(frozen=True)
class FarBody:
    """A body beyond small displacements at a load step.

    body : its name
    load_step : from 1
    iteration : since when
    shift : how far its centre has moved, over the diagonal of the box around it
    turn : how far it has turned, in radians
    along : (3,) unit vector of the motion; of the axis where it turns more than it moves
    sticking, sliding, apart : names of the neighbours that keep it from moving across them, that
        only press on it, and that do not touch it
    """

    body: str
    load_step: int
    iteration: int
    shift: float
    turn: float
    along: list[float]
    sticking: list[str] = field(default_factory=list)
    sliding: list[str] = field(default_factory=list)
    apart: list[str] = field(default_factory=list)

    @property
    def turns(self) -> bool:
        """Whether turning is what leads outside small displacements most."""
        return self.turn / ROTATION > self.shift / DISPLACEMENT

    def __str__(self) -> str:
        along = "(" + ", ".join(f"{x:.2g}" for x in np.round(self.along, 2) + 0.0) + ")"
        way = f"{self.shift:.0%} of" if self.shift < 1 else f"{self.shift:,.3g} times"
        moved = f"moved by {way} its size along {along}"
        if self.turns:
            moved = f"turned by {self.turn:.2g} rad about {along}"
        return (f"{self.body} has {moved} at load step {self.load_step} (since iteration "
                f"{self.iteration}), beyond small "
                f"displacements: {self._touch}. What would hold it: {self._cure}")

    @property
    def _touch(self) -> str:
        parts = [f"{what} {some(names)}" for what, names in (
            ("sticks to", self.sticking), ("slides on", self.sliding),
            ("does not touch", self.apart)) if names]
        return ", ".join(parts) or "it has no neighbours"

    @property
    def _cure(self) -> str:
        face = "a displacement prescribed on one of its faces"
        if self.sticking:
            return (
                f"{face}, or another neighbour that stops it from "
                f"{'turning' if self.turns else 'moving'} that way")
        if self.sliding:
            return f"{face}, more friction on {some(self.sliding)}, or a neighbour in its way"
        return face + (f", or a law that joins it to {some(self.apart)}" if self.apart else "")


class FarBodies(Monitor):
    """Warns of each body once, at the load step where it is farthest.

    lengths : whose bodies they are
    numbers : of the load steps, from 1
    far : bodies that have been told and are still far, the farthest first
    """

    name = "far_bodies"

    def __init__(self, lengths: LengthScale, numbers: Sequence[int]):
        self.lengths, self.numbers = lengths, list(map(int, numbers))
        # iteration; 0: not far
        self.since = np.zeros((lengths.count, len(self.numbers)), dtype=int)
        self.far: list[FarBody] = []
        self.told: set[str] = set()

    @classmethod
    def of(cls, case: Case) -> FarBodies | None:
        return None if case.problem.all_perfect else cls(case.lengths, case.numbers)

    def judge(self, now: Evaluation) -> Verdict:
        new = self._new(now.number, now.verdict.lengths, now, bool(now.verdict.reason))
        return Verdict(told={"far_bodies": len(self.far)}, warnings=tuple(sentences(new)))

    def found(self, problem: Decomposition) -> list[FarBody]:
        return self.far

    def _new(self, iteration: int, lengths: Lengths, now: Evaluation, ended: bool) -> list[FarBody]:
        """Those that are to be told now.

        ended : this is the last iteration
        """
        rigid, shift, turn, excess = lengths.rigid, lengths.shift, lengths.turn, lengths.excess
        far = excess > 1  # not a number: the run ends as diverged
        self.since = np.where(far, np.where(self.since > 0, self.since, iteration), 0)
        lasting = far & ((iteration - self.since >= PATIENCE - 1) | ended)
        bodies, self.far = np.flatnonzero(lasting.any(axis=1)), []
        if not len(bodies):
            return []
        touch, names = self._touch(now.problem, now.local), self.lengths.names
        for b in bodies[np.argsort(-np.where(lasting, excess, 0.0)[bodies].max(axis=1),
                                   kind="stable")]:
            t = int(np.argmax(np.where(lasting[b], excess[b], 0.0)))
            turns = turn[b, t] / ROTATION > shift[b, t] / DISPLACEMENT
            motion = rigid[b, t, 3:] if turns else rigid[b, t, :3]
            around = {}
            for pair, kinds in touch.items():
                if b in pair:
                    other = names[sum(pair) - b]
                    around[other] = max(around.get(other, 0), kinds[t])
            self.far.append(FarBody(names[b], self.numbers[t], int(self.since[b, t]),
                                    float(shift[b, t]), float(turn[b, t]),
                (motion / np.linalg.norm(motion)).tolist(),
                *([name for name, what in around.items() if what == wanted]
                  for wanted in (2, 1, 0))))
        new = [body for body in self.far if body.body not in self.told]
        self.told.update(body.body for body in new)
        return new

    def state(self) -> dict[str, Any]:
        since = [[*place, int(self.since[*place])] for place in np.argwhere(self.since).tolist()]
        return {"since": since, "told": sorted(self.told),
                "far": [asdict(body) for body in self.far]}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.since[:] = 0
        for body, step, iteration in state["since"]:
            self.since[body, step] = iteration
        self.told, self.far = set(state["told"]), [FarBody(**body) for body in state["far"]]
        return problem

    def _touch(self, problem: Decomposition,
               local: LocalState) -> dict[tuple[int, int], np.ndarray]:
        """Two bodies → (T,) int: 0 where they are apart, 1 where they only press on each other, 2
        where they stick.
        """
        pairs, interfaces, body = problem.local.pairs, problem.scene.interfaces, self.lengths.body
        statuses = table(i.law for i in interfaces)
        holds = np.array([2 if s.tangential else int(bool(s.normal)) for s in statuses])
        holds = holds[np.searchsorted(statuses, local.status)]
        most = np.zeros((len(interfaces), problem.steps))
        for i, at in pairs.each():
            most[i.index] = holds[:, at].max(axis=1, initial=0)
        most = np.reshape(problem.space.team.max(*most.ravel()), most.shape).astype(int)
        result: dict[tuple[int, int], np.ndarray] = {}
        for i, row in zip(interfaces, most):
            ends = tuple(int(body[e]) for e in i.subdomains)
            if ends[0] != ends[1]:
                result[ends] = np.maximum(result.get(ends, 0), row)
        return result


def sentences(bodies: Sequence[FarBody]) -> list[str]:
    """A sentence for each of the farthest, and one for the others."""
    result = [str(body) for body in bodies[:SHOWN]]
    rest = [body.body for body in bodies[SHOWN:]]
    return result + ([f"{len(rest)} more bodies are beyond small displacements: {some(rest)}"]
                     if rest else [])
