"""What is told of iterations: the event for those who listen, with the ``Memory`` from which a stopped run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation
from orchestrator.method.events import Iteration
from orchestrator.method.iterated import Iterated
from orchestrator.method.latin import Latin
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.memory import INTERVAL, MONITOR, Memory
from orchestrator.method.monitors.monitor import Monitor
from orchestrator.method.stopping.delivered_bound import bound_of

_DELIVERED = [("trace", "s"), ("boundary", "u"), ("macro", "alpha"), ("trace", "w"), ("trace", "f")]
_NAMES = {f.name for f in fields(Iteration)}


@dataclass
class Journal:
    """Of one case.

    Parameters
    ----------
    place : number of the case, number of cases, load steps of all of them
    seconds : spent by the runs that this one goes on from
    whole_at : iteration that was last told as a whole
    """

    place: tuple[int, int, int]
    seconds: float = 0.0
    whole_at: int = 0

    def event(self, latin: Latin, now: Evaluation) -> Iteration:
        """What is told of an iteration, once the next state is known."""
        measures, told = now.measures, dict(now.verdict.told)
        known = {name: told.pop(name) for name in list(told) if name in _NAMES} | now.problem.told
        event = Iteration(
            now.number, now.problem.setup_sweeps + latin.sweeps, self.seconds + latin.watch.total, measures.indicator,
            measures.displacement_jump, measures.force_imbalance, measures.residual, state=now.best.s,
            macro_imbalance=measures.macro_imbalance, counts=measures.counts, more=told, **{"error_bound": np.nan, **known})
        return replace(event, memory=self._memory(latin, now, event))

    def _memory(self, latin: Latin, now: Evaluation, event: Iteration) -> Memory:
        verdict, problem = now.verdict, now.problem
        ended, met = bool(verdict.reason), bool(verdict.met)
        if ended or now.number - self.whole_at >= INTERVAL:
            self.whole_at = now.number
        arrays, acceleration, back = latin.acceleration.told(self.whole_at == now.number) if not verdict.anew else ({}, {}, 1)
        if ended and met:
            arrays = {}  # nobody goes on from here: what follows begins with what is delivered
        notes: dict[str, Any] = {
            "acceleration": acceleration, "reason": verdict.reason or None, "last": self.place[0] == self.place[1] - 1,
            "steps": self.place[2], "seconds": event.seconds, "monitors": {},
            "batch": {"sweeps": latin.sweeps, "whole_at": self.whole_at, "anew": verdict.anew}}
        if verdict.anew:
            arrays = {"trace/s": now.fields.s}
        if problem.coarse is not None:
            more, notes["coarse"] = problem.coarse.told()
            arrays |= more
        for monitor in latin.monitors:
            state = monitor.state()
            notes["monitors"][monitor.name] = {name: x for name, x in state.items() if not isinstance(x, np.ndarray)}
            arrays |= {_key(monitor, name): x for name, x in state.items() if isinstance(x, np.ndarray)}
        if ended:
            arrays |= {f"{kind}/delivered.{name}": array for (kind, name), array in zip(_DELIVERED, now.best.rows)}
            notes["met"] = met
            notes["event"] = {f.name: getattr(event, f.name) for f in fields(event) if f.name not in ("state", "memory")}
        return Memory(now.number, self.place[0], max(back, now.number - self.whole_at + 1), arrays, notes)

    def go_on(self, latin: Latin, latest: Sequence[Memory]) -> None:
        """Have the iterations go on after the last of these as if nothing had happened."""
        last = latest[-1]
        notes = last.notes["batch"]
        latin.problem = restored(latin.monitors, last, latin.problem)
        if latin.problem.coarse is not None:
            latin.problem.coarse.recall(last)
        latin.number, latin.sweeps, self.whole_at = last.iteration, notes["sweeps"], notes["whole_at"]
        if notes["anew"]:
            latin.s = last.arrays["trace/s"].copy()
        else:
            latin.acceleration.recall(latest)
            latin.s = latin.acceleration.next()


def restored(monitors: Sequence[Monitor], memory: Memory, problem: Decomposition) -> Decomposition:
    """The problem as the monitors had changed it; they know what they knew."""
    for monitor in monitors:
        own = {name: memory.arrays[_key(monitor, name)] for name in _arrays_of(monitor, memory)}
        problem = monitor.restore({**memory.notes["monitors"][monitor.name], **own}, problem)
    return problem


def ended(latin: Latin, memory: Memory) -> Iterated:
    """The end of a case, from its last iteration."""
    problem = latin.problem = restored(latin.monitors, memory, latin.problem)
    best = Admissible(*(memory.arrays[f"{kind}/delivered.{name}"] for kind, name in _DELIVERED), problem.space)
    local, event = problem.local(best), memory.notes["event"]
    latin.number, latin.sweeps = memory.iteration, memory.notes["batch"]["sweeps"]
    last = Iteration(**{**event, "target": tuple(event["target"])}, state=best.s)
    best = problem.stage.ended(best)
    return delivered(latin, problem, (best, local, last), (memory.notes["met"], memory.notes["reason"]), [])


def finished(latin: Latin, now: Evaluation, event: Iteration, history: list[Iteration]) -> Iterated:
    """The end of a case whose last iteration has been judged just now."""
    problem = now.problem
    with latin.watch("linear_stage"):
        best = problem.stage.ended(now.best)
    with latin.watch("bound"):
        known = now.verdict.bound if best is now.best else None
        result = delivered(latin, problem, (best, now.local, event), (bool(now.verdict.met), now.verdict.reason), history, known)
    return result


def delivered(latin: Latin, problem: Decomposition, end: tuple[Admissible, LocalState, Iteration], why: tuple[bool, str],
              history: list[Iteration], known=None) -> Iterated:
    """What the iterations have ended with: fields, local stage and event; whether they have converged, and the reason."""
    fields, local, event = end
    bound = bound_of(problem, fields, known)
    if bound is not known:
        latin.sweeps += bound.sweeps * problem.steps / problem.scene.steps
    event = replace(event, memory=None)
    return Iterated(fields, local, bound, *why, latin.number, latin.sweeps, event,
                    history or [replace(event, state=event.state[:0].copy())],
                    {monitor.name: monitor.found(problem) for monitor in latin.monitors})


def _key(monitor: Monitor, name: str) -> str:
    kind, _, own = name.partition("/")
    return f"{kind}/{MONITOR}{monitor.name}.{own}"


def _arrays_of(monitor: Monitor, memory: Memory) -> list[str]:
    """Names of a monitor's arrays, as its ``state`` has them."""
    found, own = [name.partition("/") for name in memory.arrays], f"{MONITOR}{monitor.name}."
    return [f"{kind}/{name.removeprefix(own)}" for kind, _, name in found if name.startswith(own)]
