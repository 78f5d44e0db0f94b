"""Whether a run looks for a balance that cannot be: it ends at a limit load.

That no forces of the laws balance the loads is shown by a rigid motion (``stopping.limit_load``),
and by nothing else. It is looked for where it may be the reason of what is seen: a body is far
away, springs of stabilisation alone keep a run from its end, the iterations end, go on for long, or
change nothing but by rounding beside how far a body has gone; or laws hold to the tolerance though
they do not balance a body to it by its own measure, as where a light one slides off beside a press
fit. It depends on the loads, not on the iterations, but for two things that change what is asked
for again: sides that are paired anew, and damage.

Where forces of some pressures would do, springs may still carry what friction at the pressures that
are there does not: a shaft that is pulled out of a ring presses no more for being pulled. All else
has settled then, and the motion is looked for with that friction. It counts once weaker springs
have shown the same: what springs carry where bodies are still on their way is no sign of a limit.
Where nothing settles, as bodies fly off, pressures are those of the last load that was carried, and
it counts once bodies have been far for ``PATIENCE`` iterations. Of load steps that are solved
together it shows no more than that they are to be solved one by one (``increments``).

A body that is pressed at one of these load steps and by nothing at the next may be jammed: where
nothing acts no forces at all obey every law, whether or not a way leads there. That is for load
steps one by one to say as well.

What supports prescribe always goes on, but bodies may make way for it that no force of the laws
holds: what is pressed there carries nothing, and springs alone say where it goes. Where solves of
the coarse contact problem find no rest that is looked for, and told. It ends a run that still finds
none after ``OFTEN`` iterations, or where its iterations end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.halving import LEAST
from orchestrator.method.monitors.ending import HELD, ROUNDING
from orchestrator.method.stopping.limit_load import BodyMotion, LimitLoad, LimitLoads

LIMIT, LET_GO = "limit load", "a body is let go"
PATIENCE = 20  # iterations that a body is far away in, before which it may come back
OFTEN = 50  # iterations after which it is looked for whatever is seen: most runs have ended by then


class LimitLoadMonitor(Monitor):
    """The limit loads of one case.

    known : load step of the scene, from 0 → its limit load at any pressure as sides meet now; None:
        it is carried
    shown : ε of springs, over that at the beginning, beside which friction of the pressures that
        were there did not do; 0: none
    limits : what has been found
    way : load step of the scene, from 0 → bodies that make way there for what is prescribed; None:
        some force resists it
    unsolved : solves of the coarse problem that had ended before their tolerance
    settled : forces and jumps (3, P) that the last load which was carried has ended with; None:
        there is none
    far : iterations in a row in which bodies have been far away
    shares : load step, from 1 → share of it that was carried by the pressures at which that was
        asked last, for all monitors of a run
    """

    name, remembered = "limit_load", ("shown", "unsolved", "far")

    def __init__(self, loads: LimitLoads, case: Case):
        self.loads, self.limits, self.known, self.shown, self.meeting = loads, [], {}, 0.0, None
        last = next((x.local for x in reversed(case.before) if x.converged), None)
        self.settled = None if last is None or last.lawful is None else (last.lawful[-1],
                                                                         last.jump[-1])
        self.shares: dict[int, float] = case.given.setdefault("shares", {})
        self.way: dict[float, LimitLoad | None] = {}
        self.far = self.unsolved = 0

    @classmethod
    def of(cls, case: Case) -> LimitLoadMonitor | None:
        if case.problem.all_perfect:
            return None
        loads = LimitLoads(case.problem)
        return cls(loads, case) if loads.loose else None

    def judge(self, now: Evaluation) -> Verdict:
        verdict, pairs = now.verdict, now.problem.local.pairs
        if verdict.changes:  # sides are to be paired anew
            return Verdict()
        if pairs.transfer is not self.meeting:
            self.meeting, self.known, self.way = pairs.transfer, {}, {}
        value = verdict.target[1]
        if (verdict.met and now.problem.path_dependent
                and self.loads.let_go(now.problem, now.local.lawful, value)):
            return Verdict(False, LET_GO, led=True)
        held = now.held
        still = now.measures.residual <= ROUNDING and not verdict.met
        ends = verdict.met or held or now.last or still
        lost = far = np.flatnonzero((verdict.lengths.excess > 1).any(axis=0))
        self.far = self.far + 1 if len(far) else 0
        if ends or now.number % OFTEN == 0:
            lost = [t for t, force in enumerate(now.local.lawful) if still
                    or self.loads.missing(now.problem.local, pairs.numbers[t], force).max() > value]
        self.limits = [found for t in lost if (found := self.at_any_pressure(now, t)) is not None]
        if held and not self.limits:
            self.limits = self.at_pressures(now, lost)
            # what is there may be what no way leads to
            if self.shown and now.problem.path_dependent:
                self.limits = []
                return Verdict(False, HELD, led=True)
        if not self.limits and not verdict.met and self.far >= PATIENCE:
            self.limits = self.at_friction(now, far, 1)
            if self.limits:
                return Verdict(False, LIMIT, led=self.changing(self.limits[0]))
        told, restless = self.restless(now)
        if not self.limits and not verdict.met and (now.last or held
                                                    or (restless and now.number % OFTEN == 0)):
            self.limits = [way for t in range(now.problem.steps)
                           if (way := self.making_way(now, t)) is not None]
            ends = bool(self.limits)
        # load steps before the first one that has no balance have one, which is worth to be found
        worthless = any(limit.load_step == math.ceil(pairs.numbers[0]) + 1 for limit in self.limits)
        if self.limits and (ends or worthless):
            return Verdict(False, LIMIT, led=any(limit.pressures for limit in self.limits))
        return Verdict(warnings=told)

    def restless(self, now: Evaluation) -> tuple[tuple[str, ...], bool]:
        """Whether solves of the coarse contact problem have found no rest in this iteration; and
        where they do so for the first time, that
        bodies make way."""
        coarse = now.problem.coarse
        ends = {} if coarse is None else coarse.problem.ends
        before, self.unsolved = self.unsolved, sum(ends.values()) - ends.get("tolerance", 0)
        if self.unsolved <= before or self.way:
            return (), self.unsolved > before
        found = self.making_way(now, 0)
        return () if found is None else (str(found),), True

    def making_way(self, now: Evaluation, t: int) -> LimitLoad | None:
        """The bodies that make way at a load step."""
        number = float(now.problem.local.pairs.numbers[t])
        if number not in self.way:
            self.way[number] = self.loads.making_way(now.problem, t)
        return self.way[number]

    def at_any_pressure(self, now: Evaluation, t: int) -> LimitLoad | None:
        """The limit load of a load step, whatever the pressures."""
        local = now.problem.local
        number = float(local.pairs.numbers[t])
        if number not in self.known:
            self.known[number] = self.loads(local, number)
        return self.known[number]

    def at_pressures(self, now: Evaluation, steps: Sequence[int]) -> list[LimitLoad]:
        """The limit loads of load steps with the friction of the pressures that are there, if
        stiffer springs have shown such as well.
        """
        springs, found = now.problem.local.pairs.springs, self.at_friction(now, steps)
        again, self.shown = bool(found) and springs < self.shown, max(
            springs, self.shown) if found else 0.0
        return found if again else []

    def at_friction(self, now: Evaluation, steps: Sequence[int], back: int = 0) -> list[LimitLoad]:
        """The limit loads of load steps with the friction of the pressures that the load so many
        steps
        ``back`` has ended with; 0: of those that are there."""
        here, local = now.local, now.problem.local
        states = [self.settled if t < back else (here.lawful[t - back], here.jump[t - back])
                  for t in steps]
        return [limit for t, state in zip(steps, states)
                if state and (limit := self.loads(local, local.pairs.numbers[t], state))]

    def changing(self, limit: LimitLoad) -> bool:
        """Whether what has been carried since has changed the share of a load step that is, by more
        than halving it tells.
        """
        share = np.nan if limit.factor is None else limit.factor
        before, self.shares[limit.load_step] = self.shares.get(limit.load_step, np.nan), share
        return not abs(share - before) <= LEAST

    def state(self) -> dict[str, Any]:
        return super().state() | {"limits": [asdict(limit) for limit in self.limits]}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.limits = [
            LimitLoad(**limit | {"motions": [BodyMotion(**motion) for motion in limit["motions"]]})
            for limit in state["limits"]]
        return super().restore(state, problem)

    def found(self, problem: Decomposition) -> list[LimitLoad]:
        return self.limits

