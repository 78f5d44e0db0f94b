"""One batch of load steps: Algorithm 1 of the paper, mended, from a state to the stopping criterion.

What an iteration has to remember is told with its event, as a ``Memory``; ``recall`` goes on from it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial

import numpy as np

from orchestrator.method.acceleration.choice import make_acceleration
from orchestrator.method.coarse.self_stress import RESTING
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.method.following import WORTH
from orchestrator.method.iterated import Iterated, Paired
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import INTERVAL, Memory
from orchestrator.method.placing import Placing, Unbalanced
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.criteria import Criterion, Verdict, make_criterion
from orchestrator.method.stopping.ending import DIVERGED, Ending
from orchestrator.method.stopping.far_bodies import FarBodies, FarBody, sentences
from orchestrator.method.stopping.places import Places
from orchestrator.method.stopping.giving_way import SHARE, GivingWay
from orchestrator.method.stopping.indicator import Measures, measure
from orchestrator.timing import Stopwatch

# (fields, bound) → relative energy error; ``silent`` where it asks no code
ErrorOf = Callable[[Admissible, Bound | None], float]
# (decomposition of some load steps, fields, bound) → estimated discretisation error, relative, energy norm
EstimateOf = Callable[[Decomposition, Admissible, Bound], float]
# An iteration gains a digit at the best: where the measure is further than this from its tolerance, another one follows.
NEAR = 10.0
# Where so many have shown what an iteration gains here, it is taken to gain no more than the best two of them did together.
SHOWN = 5
_DELIVERED = [("trace", "s"), ("boundary", "u"), ("macro", "alpha"), ("trace", "w"), ("trace", "f")]


class Batch:
    """A batch of load steps: linear and local stages alternate until the stopping criterion holds for all of them.

    Parameters
    ----------
    d : for these load steps
    place : number of the batch, number of batches, load steps of all of them
    numbers : of these load steps, from 1, for people
    others as for ``iterate``
    """

    def __init__(self, d: Decomposition, method, place: tuple[int, int, int], numbers: Sequence[int],
                 watch: Stopwatch, true_error: ErrorOf | None,
                 estimate: EstimateOf | None, placing: Placing | None = None):
        self.d, self.method, self.place, self.watch, self.true_error = d, method, place, watch, true_error
        self.placing = placing
        # nobody but the linear stage and the criterion asks the codes
        estimating = estimate is not None and method.tolerance.error == "auto"
        self.alone = not estimating and (true_error is None or getattr(true_error, "silent", False))
        self.numbers, self.estimate = numbers, estimate
        self.acceleration = make_acceleration(d, method)
        self.criterion = make_criterion(d, method.tolerance, estimate and partial(estimate, d), method.skip.bound)
        self.ending = Ending(0) if d.all_perfect else Ending(0, d.local.pairs.weakest(d.space.team))
        self.far = None if d.all_perfect else FarBodies(d, self.criterion.lengths, numbers)
        self.places = Places() if d.coarse is not None and d.local.pairs.stabilisation is not None else None
        # where something else decides, springs keep no run from its end
        self.giving_way = GivingWay() if self.places is not None and self.criterion.name == "law_residual" else None
        # (T, D) traces at which springs of stabilisation have given way, and what they carried then at most, force per area
        self.yielded: tuple[np.ndarray, float] | None = None
        self.anew = False
        self.frozen, self.left_out = np.zeros(d.steps, dtype=bool), 0
        self.measured = np.nan  # what the criterion has compared last
        self.resting = False  # whether it has been so small already that what is left may be self-stress
        self.gains: deque[float] = deque(maxlen=SHOWN)  # by what it has fallen; nothing but who waits for whom hangs on it

    def end_at(self, last: int) -> None:
        """Stop after the iteration ``last`` at the latest, but do the one that gives the fields."""
        self.ending.last = max(last, self.iteration + 1)

    def begin(self, s: np.ndarray, iteration: int, sweeps: float) -> None:
        """Begin from a state (T, D), after so many iterations and sweeps."""
        self.s, self.iteration, self.sweeps = s.copy(), iteration, sweeps  # those who listen write into what they were given
        self.whole_at = iteration + 1
        self.measured, self.resting = np.nan, False
        self.gains.clear()

    def recall(self, latest: Sequence[Memory]) -> None:
        """Go on after the last of these iterations as if nothing had happened."""
        last = latest[-1]
        notes = last.notes["batch"]
        self._recall_place(last, "trace/place")
        if not notes["anew"]:
            with self.watch("acceleration"):
                self.acceleration.recall(latest)
            if self.d.coarse is not None:
                self.d.coarse.recall(last)
        self.criterion.recall(last.notes["criterion"])
        self.ending.recall(last.notes["ending"])
        if self.far is not None:
            self.far.recall(last.notes["far"])
        if self.places is not None:
            self.places.recall(last.arrays)
        self._recall_yielded(last, "trace/yielded")
        self.begin(np.empty(0), last.iteration, notes["sweeps"])
        self.whole_at, self.left_out, self.resting = notes["whole_at"], notes["left_out"], notes["resting"]
        self.s = last.arrays["trace/s"].copy() if notes["anew"] else self._next(last.arrays.get("trace/asked"))

    def recalled(self, memory: Memory) -> Iterated:
        """The end of a batch, from its last iteration."""
        notes = memory.notes
        self._recall_place(memory, "trace/delivered.place")
        self._recall_yielded(memory, "trace/delivered.yielded")
        delivered = Admissible(*(memory.arrays[f"{kind}/delivered.{name}"] for kind, name in _DELIVERED), self.d.space)
        local, delivered = self.d.local(delivered), self.d.stage.ended(delivered)
        bound, _ = self.criterion.final(delivered, None)
        event = notes["event"]
        if self.far is not None:
            self.far.recall(notes["far"])
        if self.places is not None:
            self.places.recall(memory.arrays)
        last = Iteration(**{**event, "target": tuple(event["target"])}, state=delivered.s)
        return Iterated(delivered, local, bound, notes["met"], notes["reason"], memory.iteration,
                        notes["batch"]["sweeps"], last, [replace(last, state=delivered.s[:0].copy())], notes["batch"]["left_out"],
                        self._strayed, self._paired, self._open, self._gave_way)

    def iterate(self, told: Subscriber, earlier: float = 0.0) -> Iterated:
        """Iterate to the end: eq. 6 is solved.

        Parameters
        ----------
        earlier : seconds spent by the runs that this one goes on from
        """
        d, watch, criterion, acceleration = self.d, self.watch, self.criterion, self.acceleration
        exact = self.method.tolerance.indicator is not None
        share = d.steps / d.scene.steps  # of a sweep through all load steps
        reason, history = None, []
        while reason is None:
            self.iteration += 1
            with watch("linear_stage"):
                evaluated = d.stage(self.s)
                evaluated.send(None if d.bound is None else d.bound.continuity.weight)
                largest = np.abs(evaluated.w).max(initial=0.0), self.s.any()
            with watch("acceleration"):
                acceleration.ahead()
            if d.coarse is not None:
                with watch("coarse"):
                    evaluated = d.coarse(evaluated)
                    at_nodes = d.self_stress() if self.resting and d.self_stress is not None else None
                    if at_nodes is not None:
                        evaluated = at_nodes(evaluated, d.local)
            with watch("local_stage"):
                local = d.local(evaluated)
            with watch("acceleration"):
                beside = criterion.early(evaluated)
                if d.nonlinear is None:
                    residual, early = acceleration.take(evaluated, local.s, beside)
                    foreseen = self._foreseen(evaluated.s)
                    best = acceleration.best(evaluated)
                else:  # what the coarse problem has changed is extrapolated: the point is the one that was asked
                    residual, early = acceleration.take(replace(evaluated, s=self.s), local.s, beside)
                    foreseen, best = None, evaluated
            with watch("bound"):
                more, ends = criterion.begin(best, local, early)
                if self.placing is not None:
                    more.append(self.placing.told())
                measures = measure(d.stage, d.local, best, local, residual, exact, more, [*ends, *largest])
                verdict = criterion(best, local, measures)
                moved, asked = measures().largest[-2:]
                self.sweeps += asked * share * (1 - self.frozen.mean())
                self.gains.append(self.measured / verdict.approached if verdict.approached > 0 else np.inf)
                self.measured = verdict.approached
                self.resting |= self.measured <= RESTING
                self.sweeps += verdict.sweeps * share
                event = _event(criterion, verdict, measures(), iteration=self.iteration,
                               sweeps=d.setup_sweeps + self.sweeps, seconds=earlier + watch.total, state=best.s,
                               **_of_coarse(d))
            if self.true_error is not None:
                event = replace(event, true_error=self.true_error(best, verdict.bound))
            self.anew = self._slid_on(evaluated, verdict)
            gives_way = self.giving_way is not None and not self.anew and self.giving_way(
                self.iteration, verdict.laws, criterion.value)
            reason = self.ending.reason(
                self.iteration, verdict.met and not self.anew, event.residual, moved,
                verdict.laws is not None and not gives_way and verdict.laws.held_by_springs(criterion.value))
            if self.far is not None:
                strayed = self.far(self.iteration, verdict.lengths.rigid, local, reason is not None)
                event = replace(event, far_bodies=len(self.far.found))
                for sentence in sentences(strayed):
                    told.warned(sentence)
            if self.places is not None:
                self.places(verdict.lengths.rigid)
                if reason is not None and reason != DIVERGED:
                    with watch("bound"):
                        self.places.end(d, criterion.lengths, best, local)
            yielded = self.yielded
            if gives_way:
                self._give_way(best.w, SHARE * criterion.value * verdict.laws.traction)
            history.append(replace(event, state=event.state[:0].copy()))  # the states themselves are large, and views hold them
            told.iteration(replace(event, memory=self._memory(event, evaluated, best, verdict.met and not self.anew, reason, yielded)))
            if reason is None and self.placing is not None:
                self._place(measures().more[-1])
            if reason is None and self.anew:
                with watch("local_stage"):
                    self._pair_anew(evaluated.w)
                criterion, acceleration, self.s = self.criterion, self.acceleration, evaluated.s.copy()
            elif reason is None:
                with watch("acceleration"):
                    self.s = self._next(evaluated.s, foreseen)
            d = self.d
        if d.nonlinear is not None:
            with watch("linear_stage"):
                best = d.stage.ended(best)
        with watch("bound"):
            d.stage.forget()
            bound, spent = criterion.final(best, verdict.bound)
            self.sweeps += spent * share
        return Iterated(best, local, bound, verdict.met and not self.anew, reason, self.iteration, self.sweeps, event, history,
                        self.left_out, self._strayed, self._paired, self._open, self._gave_way)

    def _place(self, table: np.ndarray) -> None:
        try:
            self.placing.judge(table, self.iteration)
        except Unbalanced:
            self.d.stage.forget()
            raise

    @property
    def _paired(self) -> list[Paired]:
        if self.d.following is None:
            return []
        local = self.d.local
        return [Paired(local.pairs, {i.index: i.mortar for i in self.d.following.interfaces}, local.before)]

    def _slid_on(self, fields: Admissible, verdict: Verdict) -> bool:
        """Whether sides that follow have slid so far since they were paired that they are to be paired anew."""
        if self.d.following is None:
            return False
        moved = self.d.following.moved(self.d.local.pairs, fields)
        return moved > self.criterion.value and verdict.measure <= max(self.criterion.value, WORTH * min(moved, 1.0))

    def _pair_anew(self, place: np.ndarray) -> None:
        """Pair the sides that follow where traces (1, D) have brought them; what was known of the pairs before is forgotten."""
        self.d = self.d.paired(place)
        if self.yielded is not None:
            self.d = self.d.yielding(*self.yielded)
        notes, far, told = self.criterion.notes, self.far.notes, self.criterion.lengths.told
        self.acceleration = make_acceleration(self.d, self.method)
        self.criterion = make_criterion(self.d, self.method.tolerance, self.estimate and partial(self.estimate, self.d),
                                        self.method.skip.bound)
        self.criterion.recall(notes)
        self.criterion.lengths.told, self.measured = told, np.nan
        self.gains.clear()
        self.far = FarBodies(self.d, self.criterion.lengths, self.numbers)
        self.far.recall(far)

    def _give_way(self, w: np.ndarray, most: float) -> None:
        """Have springs of stabilisation carry no more than ``most``, force per area, where traces w (T, D) have brought the pairs."""
        self.d, self.yielded = self.d.yielding(w, most), (w, most)

    def _recall_yielded(self, memory: Memory, name: str) -> None:
        """Have springs give way where they have."""
        if self.giving_way is not None:
            self.giving_way.recall(memory.notes["giving_way"])
        if name in memory.arrays:
            self._give_way(memory.arrays[name], memory.notes["yielded"][name])

    @property
    def _gave_way(self) -> list[int]:
        return [] if self.giving_way is None else self.giving_way.at

    def _recall_place(self, memory: Memory, name: str) -> None:
        """Pair the sides that follow where they were paired."""
        place = memory.arrays.get(name)
        if place is not None and (memory.notes["batch"]["anew"] or not np.array_equal(place, self.d.following.place)):
            if memory.notes["batch"]["anew"] and self.d.coarse is not None:
                self.d.coarse.recall(memory)  # what it has spent goes on, what it has kept does not
            self._pair_anew(place)

    @property
    def _strayed(self) -> list[FarBody]:
        return [] if self.far is None else self.far.found

    @property
    def _open(self) -> np.ndarray | None:
        return None if self.places is None else self.places.open

    def _foreseen(self, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """What will be evaluated next unless another load step is done, and for which load steps that holds; where by all
        appearances there will be another iteration, the codes are told at once: they work while this one is judged.
        """
        if not (self.alone and self.iteration < self.ending.last and self.measured > self._reach * self.criterion.value):
            return None
        done = self.criterion.done.copy()
        s = self._state(asked, done)
        self.d.stage.begin(s)
        return done, s

    @property
    def _reach(self) -> float:
        """By what factor the measure may fall in the next iteration."""
        if len(self.gains) < SHOWN or not np.isfinite(self.gains).all():
            return NEAR
        return min(NEAR, max(1.0, np.prod(sorted(self.gains)[-2:])))

    def _next(self, asked: np.ndarray | None, foreseen: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """The state to evaluate next."""
        done = self.criterion.done
        if self.method.skip.frozen:
            self.frozen = done
            self.left_out += int(done.sum())
        if foreseen is not None and (foreseen[0] == done).all():
            return foreseen[1]
        return self._state(asked, done)

    def _state(self, asked: np.ndarray | None, done: np.ndarray) -> np.ndarray:
        """The acceleration's next state. Where load steps are done it is what has been asked for: answers are remembered."""
        s = self.acceleration.next()
        if self.method.skip.frozen and done.any():
            s[done] = asked[done]
        return s

    def _memory(self, event: Iteration, evaluated: Admissible, best: Admissible, met: bool,
                reason: str | None, yielded: tuple[np.ndarray, float] | None) -> Memory:
        """What has to be known to go on after this iteration, or of how it ended, with springs that had ``yielded`` by then."""
        ended = reason is not None
        if ended or self.iteration - self.whole_at >= INTERVAL:
            self.whole_at = self.iteration
        whole = self.whole_at == self.iteration
        arrays, notes, back = self.acceleration.told(whole)
        if ended and met:
            arrays = {}  # nobody goes on from here: what follows begins with what is delivered
        notes = {"acceleration": notes, "criterion": self.criterion.notes, "ending": self.ending.notes, "reason": reason,
                 "batch": {"sweeps": self.sweeps, "left_out": self.left_out, "whole_at": self.whole_at, "anew": self.anew,
                           "resting": bool(self.resting)},
                 "last": self.place[0] == self.place[1] - 1, "steps": self.place[2], "seconds": event.seconds}
        if self.d.coarse is not None:
            more, notes["coarse"] = self.d.coarse.told()
            arrays |= more
        if self.far is not None:
            notes["far"] = self.far.notes
        if self.places is not None:
            arrays |= self.places.told
        if self.giving_way is not None:
            notes["giving_way"], notes["yielded"] = self.giving_way.notes, {}
        for name, given in (("trace/yielded", self.yielded), ("trace/delivered.yielded", yielded if ended else None)):
            if given is not None:
                arrays[name], notes["yielded"][name] = given
        if self.criterion.done.any():
            arrays["trace/asked"] = evaluated.s
        if self.d.following is not None:
            arrays["trace/place"] = evaluated.w if self.anew else self.d.following.place
            if ended:
                arrays["trace/delivered.place"] = self.d.following.place
        if ended:
            arrays |= {f"{kind}/delivered.{name}": array for (kind, name), array in zip(_DELIVERED, best.rows)}
            notes["met"] = met
            notes["event"] = {f.name: getattr(event, f.name) for f in fields(event) if f.name not in ("state", "memory")}
        return Memory(self.iteration, self.place[0], max(back, self.iteration - self.whole_at + 1), arrays, notes)


def _of_coarse(d: Decomposition) -> dict[str, object]:
    """What is told of the coarse contact problem, where there is one."""
    if d.coarse is None:
        return {}
    problem = d.coarse.problem
    return {"newton_steps": problem.newton_steps, "coarse_left": max(problem.left.values(), default=0.0),
            "coarse_ends": dict(problem.ends)}


def _event(criterion: Criterion, verdict: Verdict, measures: Measures, **progress) -> Iteration:
    """What is told of an iteration."""
    laws = {} if verdict.laws is None else {"law_residual": verdict.laws.largest, "laws": verdict.laws.measures}
    return Iteration(
        **progress, indicator=measures.indicator, displacement_jump=measures.displacement_jump,
        force_imbalance=measures.force_imbalance, residual=measures.residual, macro_imbalance=measures.macro_imbalance,
        counts=measures.counts, target=(criterion.name, criterion.value),
        error_bound=verdict.error_bound, discretisation_error=verdict.discretisation_error, **laws)
