"""Checkpoints that a stopped run goes on from: one ``Checkpoint`` after each iteration.

It has the evaluation of the fixed point that the iteration was, what the coarse problem and the
monitors remember, and where an increment of load steps has ended its fields. The acceleration is
not in it: it begins anew and takes in the last evaluations once more. Arrays are named
``kind/name`` by how their columns are numbered:

- ``trace``, ``boundary``  (T, D) and (T, B), the columns as in ``TraceSpace``;
- ``macro``                (T, size), as in ``Macro``; several ranks may have the same ones;
- ``common``               the same on all ranks.

Each rank has its own columns, and knows which ones of the whole scene's they are: a run may go on
with another number of ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchestrator.errors import Refusal
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Iteration
from orchestrator.method.iterated import Iterated, delivered
from orchestrator.method.latin import Latin
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.monitors import Evaluation

COMMON = "common"
_EVALUATED = ("trace/s", "boundary/u", "macro/alpha")
_DELIVERED = tuple(f"{kind}/delivered.{name}" for kind, name in zip(
    ("trace", "boundary", "macro", "trace", "trace"), ("s", "u", "alpha", "w", "f")))
HATS = "trace/hat.w", "trace/hat.f"
_ANCHOR = "trace/delivered.anchor"
# kind → number of each of this rank's columns in the whole scene
Numbers = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Checkpoint:
    """A run after an iteration.

    iteration : linear stages after set-up
    increment : of load steps, which one
    evaluations : of how many of the last iterations the evaluations are needed; 0: ``trace/s`` is
        the next state
    arrays : ``kind/name`` → array; not to be changed
    notes : numbers, texts and lists of these
    """

    iteration: int
    increment: int
    evaluations: int
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, latin: Latin, now: Evaluation, event: Iteration, increment: int, last: bool,
           path: Mapping[str, Any]) -> Checkpoint:
        """After an iteration.

        last : no other increment follows
        path : steps: load steps of all increments; part: of a load step, from where to where this
            one goes; path: see ``increments``
        """
        verdict, problem = now.verdict, now.problem
        ended, met = bool(verdict.reason), bool(verdict.met)
        arrays: dict[str, np.ndarray] = {}
        if not latin.evaluations:
            arrays["trace/s"] = latin.s
        elif not (ended and met):  # nobody goes on from there
            arrays = dict(zip(_EVALUATED, now.point.rows[:3] if problem.all_perfect
                              else now.point.rows[:1]))
            arrays["trace/image"] = now.local.s
        notes = {"sweeps": latin.sweeps, "seconds": event.seconds, **path, "last": last, "met": met,
                 "reason": verdict.reason, "states": {}}
        for owner, state in _states(latin, problem).items():
            own = {name: x for name, x in state.items() if isinstance(x, np.ndarray)}
            notes["states"][owner] = state | dict.fromkeys(own)
            arrays |= own
        if ended:
            arrays |= dict(zip(_DELIVERED, now.best.rows))
            # where another run may begin, see ``Start``; perfect interfaces form no ŵ and f̂
            arrays |= zip(HATS, (now.local.hats or now.best.rows[3:])[:2])
            if now.best.anchor is not None:
                arrays[_ANCHOR] = now.best.anchor[:, : problem.space.size]
            notes["event"] = event.content
        return cls(now.number, increment, latin.evaluations, arrays, notes)

    @property
    def ended(self) -> bool:
        """Whether it was the last iteration of its increment: its fields are among the arrays."""
        return bool(self.notes["reason"])

    @property
    def goes_on(self) -> bool:
        """Whether a run can go on after it: it has an evaluation, or the next state."""
        return not (self.ended and self.notes["met"])

    @property
    def load_steps(self) -> int:
        """Of its increment."""
        return len(self.arrays.get("trace/s", self.arrays.get("trace/delivered.s")))

    def state_of(self, owner: str) -> dict[str, Any]:
        """Return what one part of the method remembers."""
        return {name: self.arrays.get(name, x) for name, x in self.notes["states"][owner].items()}


def kind_of(name: str) -> str:
    """How the columns of an array are numbered."""
    return name.partition("/")[0]


def _states(latin: Latin, problem: Decomposition) -> dict[str, dict[str, Any]]:
    """Return what each part of the method remembers, by its name."""
    coarse = {} if problem.coarse is None else {"coarse": problem.coarse.state()}
    return coarse | {monitor.name: monitor.state() for monitor in latin.monitors}


def go_on(latin: Latin, latest: Sequence[Checkpoint]) -> None:
    """Have iterations go on after the last of some checkpoints, one after the other."""
    last = latest[-1]
    problem = _restored(latin, last)
    latin.number, latin.sweeps = last.iteration, last.notes["sweeps"]
    if not last.evaluations:
        latin.s = last.arrays["trace/s"].copy()
        return
    for each in latest[-last.evaluations:]:
        s, *more = (each.arrays[name] for name in _EVALUATED if name in each.arrays)
        none = np.empty((len(s), 0))
        fields = problem.stage.complete(s,
                                        *more) if more else Admissible(
                                            s, none, none, none, none, problem.space)
        latin.take(fields, each.arrays["trace/image"])
    latin.s = latin.acceleration.next()


def _restored(latin: Latin, last: Checkpoint) -> Decomposition:
    """The problem as the monitors had changed it; all know what they knew."""
    problem = latin.problem
    for monitor in latin.monitors:
        if monitor.name in last.notes["states"]:  # what watches several ranks is not there with one
            problem = monitor.restore(last.state_of(monitor.name), problem)
    if problem.coarse is not None:
        problem.coarse.restore(last.state_of("coarse"))
    latin.problem = problem
    return problem


def ended(latin: Latin, last: Checkpoint) -> Iterated:
    """The end of an increment, from its last iteration."""
    problem = _restored(latin, last)
    best = Admissible(*(last.arrays[name] for name in _DELIVERED), problem.space)
    if _ANCHOR in last.arrays:
        best.anchor, = problem.space.extended(last.arrays[_ANCHOR])
    local = problem.local(best)
    latin.number, latin.sweeps = last.iteration, last.notes["sweeps"]
    event = Iteration.of_content(last.notes["event"], best.s)
    return delivered(latin, (problem.stage.ended(best), local, event),
                     (last.notes["met"], last.notes["reason"]), [])


@dataclass(frozen=True)
class Start:
    """Where iterations begin: from a state, or where an earlier run stood.

    state : (T, D) s; None: zero, and in an increment of load steps the last state of the one
        before; checkpoints of increments: those that they have ended with
    others : other runs' ends, ŵ and f̂ of all load steps: a combination of their states s =
        f̂ + k ŵ, with this run's search direction, is the state
    shares : what of each goes into it
    iteration, sweeps : done so far, set-up not counted
    seconds : spent so far
    ended : the last checkpoint of each increment that is done
    latest : the last checkpoints of the increment under way, as many as are needed
    origin : of these others, as they are told
    """

    state: np.ndarray | Sequence[Checkpoint] | None = None
    iteration: int = 0
    sweeps: float = 0.0
    seconds: float = 0.0
    ended: Sequence[Checkpoint] = ()
    latest: Sequence[Checkpoint] = ()
    others: Sequence[Checkpoint] = ()
    shares: Sequence[float] = ()
    origin: Any = None

    @staticmethod
    def handed_out(start: Start | None, d: Decomposition) -> Start:
        """Return a rank's part of what rank 0 knows; None: the beginning.

        Files (``results.checkpoint.Kept``) each rank reads itself.

        Raises Refusal: it does not fit to the decomposition
        """
        team, numbers = d.space.team, numbers_of(d)
        start = team.share(start or Start())
        counts = dict(
            zip(numbers, team.max(*(1 + own.max(initial=-1) for own in numbers.values()))))

        def part(kept: Checkpoint) -> Checkpoint:
            for name, width in kept.widths.items():
                count = counts[kind_of(name)]
                start._refuse(width != count, name,
                              f"{width:,} columns where there are {count:,.0f}")
            found = kept.of_rank(numbers)
            for name, array in found.arrays.items():
                start._refuse(not np.isfinite(array).all(), name, "values that are not finite")
            return found

        state = start.state
        if isinstance(state, np.ndarray):
            name = "trace/state"
            start._refuse(state.shape != (d.steps, counts["trace"]), name, f"shape {state.shape}")
            start._refuse(not np.isfinite(state).all(), name, "values that are not finite")
            state = state[:, numbers["trace"]]
        elif state is not None:
            state = np.vstack([part(x).arrays[_DELIVERED[0]] for x in state])
        elif start.others:
            state = 0.0
            for share, found in zip(start.shares, map(part, start.others)):
                w, f = (found.arrays[name] for name in HATS)
                start._refuse(len(w) != d.steps, HATS[0], f"{len(w)} load steps")
                state = state + share * (f + d.stage.direction.times(w))
        return replace(start, state=state, ended=[part(x) for x in start.ended],
                       latest=[part(x) for x in start.latest])

    @property
    def near(self) -> dict[str, Any]:
        """Return what monitors are given of the other run: what its own knew at its end."""
        return {"near": self.others[0].notes["states"]} if self.others else {}

    def _refuse(self, wrong: bool, name: str, what: str) -> None:
        if wrong:
            raise Refusal("another start", iteration=self.iteration, name=name, wrong=what)


def numbers_of(d: Decomposition) -> Numbers:
    """Which columns of the whole scene's arrays are this rank's."""
    none = np.empty(0, dtype=int)
    return {"trace": d.space.link.number, "boundary": d.space.link.boundary_number,
            "macro": none if d.stage.macro is None else d.stage.macro.number}
