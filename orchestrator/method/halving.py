"""Load steps that are solved together, and parts of one that is halved, each solved from where the
one before has ended.

Loads, prescribed displacements and what laws are given at each load step (a gap, the force of a
bolt) go from one load step to the next in proportion. Of a part nothing is delivered; what it
leaves is the history that the next one begins with. A part takes two back-substitutions per
subdomain for its loads, and no factorisation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.linear.loading import Loading, apply_loads, partway
from orchestrator.method.monitors import Evaluation
from orchestrator.method.monitors.ending import HELD
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.scene.model import Scene

# An increment does not settle whose law residual has not fallen to such a share of its least in so
# many iterations.
FALLS, PATIENCE = 0.5, 100
UNSETTLED = "law residual stands still"
TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4  # load steps of a batch where there are more
# of a load step, the smallest part: what does not settle in it snaps, and no path leads through
LEAST = 1 / 16


@dataclass(frozen=True)
class Increment:
    """Load steps that are solved together, or a part of one.

    steps : of the decomposition
    begin, end : of what a single load step adds, where the part begins and where it ends; else 0
        and 1
    """

    steps: slice
    begin: float = 0.0
    end: float = 1.0

    def __len__(self) -> int:
        return self.steps.stop - self.steps.start

    @property
    def one_by_one(self) -> list[Increment]:
        """An increment for each of its load steps."""
        return [Increment(slice(t, t + 1)) for t in range(self.steps.start, self.steps.stop)]

    @property
    def halves(self) -> list[Increment]:
        """Both halves of a load step or of a part of one; none if they are too small."""
        middle = 0.5 * (self.begin + self.end)
        both = [replace(self, end=middle), replace(self, begin=middle)]
        return both if middle - self.begin >= LEAST else []


def follow_each_other(scene: Scene) -> bool:
    """Whether load steps are solved one by one: matter remembers them, or sides are paired anew as
    they slide.
    """
    return scene.remembers or any(i.follows for i in scene.interfaces)


def increments_of(steps: int, scene: Scene, method) -> list[Increment]:
    """Return so many load steps in increments that are solved together."""
    if scene.bonded and not follow_each_other(scene):
        return [Increment(slice(0, steps))]
    size = 1 if follow_each_other(scene) else method.increment
    if size == "auto":
        size = steps if steps <= TOGETHER else INCREMENT
    return [Increment(slice(a, min(a + size, steps))) for a in range(0, steps, size)]


def proportional(d: Decomposition) -> bool:
    """Whether half of what the first load step adds has half of its solution, so that its halves
    are no easier; all ranks ask.

    Nothing acts but the loads, and no law knows a length: no gaps, no press fits, no damage.
    """
    knows = any(law.acts or np.any(law.distance) or law.variables for i in d.scene.interfaces
                for law in i.laws(1))
    return not d.space.team.max(float(knows))[0]


class Plan:
    """The increments of a run: those that have ended, the one under way, and those that follow.

    Where the way to a load counts one that does not settle is solved again in smaller steps.

    numbers : of the load steps, from 1, for people
    at : which one is under way
    path : of those that were solved again in smaller steps, or could not be: load steps, from 1,
        part, why and after which iteration
    least : law residual of the one under way, and the iteration from which it has fallen no more
    known : how many have ended in an earlier run
    """

    def __init__(self, d: Decomposition, method, numbers: Sequence[int]):
        self.increments, self.at, self.known = increments_of(d.steps, d.scene, method), 0, 0
        self.numbers, self.path, self.least = numbers, [], (np.inf, 0)
        self.asked, self.converged = method.contact.stabilisation != "auto", True
        self.has_history, self.proportional = d.has_history, proportional(d)
        # nonlinear matter cannot take back what it has gone through, sides that follow are paired
        # for load steps as they are, and the mesh's error is estimated for them
        self.halves = not follow_each_other(d.scene) and method.tolerance.error != "auto"

    @property
    def now(self) -> Increment:
        """The increment under way."""
        return self.increments[self.at]

    @property
    def left(self) -> int:
        """Number of increments that follow; −1: all have ended."""
        return len(self.increments) - 1 - self.at

    def resume(self, ended: Sequence[Any], latest: Sequence[Any]) -> None:
        """Plan as a run did that is gone on with; its checkpoints as in ``checkpoint.Start``."""
        for kept in (known := [*ended, *latest[-1:]]):
            if kept.load_steps < len(self.now):
                self._split(self.now.one_by_one)
            while self.now.end > kept.notes["part"][1]:
                self._split(self.now.halves)
            if kept.ended:
                self.passed(kept.notes["met"], kept.notes["reason"], 0)
        if known:
            self.at, self.known, self.path = 0, len(ended), list(known[-1].notes["path"])

    def smaller(self, now: Evaluation, most: int) -> str:
        """Return why the increment is to be solved again in smaller steps; empty: it is not.

        most : iterations that are allowed in all
        """
        parts = self._parts()
        if not parts or now.number + len(parts) + self.left > most:
            return ""
        reason, residual = now.verdict.reason, now.verdict.laws.largest_other
        if residual <= FALLS * self.least[0]:
            self.least = residual, now.number
        if not reason and now.number >= self.least[1] + PATIENCE:
            return UNSETTLED
        # in smaller parts springs would carry less, but a number for them is what it is
        asked = reason == HELD and len(self.now) == 1 and self.asked
        return reason if now.verdict.led and not asked else ""

    def split(self, why: str, after: int) -> str:
        """Have the increment solved again in smaller steps; return what a user is told."""
        single = len(self.now) == 1
        self._tell(why, after)
        self._split(self._parts())
        return path_sentence(self.path[-1]) if single else ""

    def passed(self, converged: bool, reason: str, after: int) -> None:
        """Go on to the next increment: of a load step a part of which does not converge, all that
        is left is tried as a whole.
        """
        now, self.converged = self.now, converged
        if not converged and now.end < 1:
            rest = [x for x in self.increments[self.at + 1:] if x.steps != now.steps]
            self.increments[self.at + 1:] = [Increment(now.steps, now.end), *rest]
            if self.at >= self.known:
                self._tell(reason, after, stuck=True)
        self.at += 1

    def _parts(self) -> list[Increment]:
        """Parts in which the increment would be solved again; none where the way to a load does not
        count.
        """
        now = self.now
        if not self.has_history:
            return []
        if len(now) > 1:
            return now.one_by_one
        stuck = now.begin > 0 and not self.converged
        vain = self.proportional and now.steps.start == 0 and now.begin == 0
        return now.halves if self.halves and not (stuck or vain) else []

    def _split(self, parts: Sequence[Increment]) -> None:
        self.increments[self.at:self.at + 1] = parts

    def _tell(self, why: str, after: int, stuck: bool = False) -> None:
        now, numbers = self.now, self.numbers[self.now.steps]
        self.path.append({"load_steps": [int(numbers[0]), int(numbers[-1])],
                          "part": [now.begin, now.end], "why": why, "after": after,
                          "stuck": stuck})


def part_of(d: Decomposition, part: Increment, before: History | None,
            bound: Judged | None) -> Decomposition:
    """The decomposition for a part of one of its load steps; ``before`` and ``bound`` as for
    ``Decomposition.batch``.
    """
    step, share = part.steps.start, part.end
    view = d.batch(part.steps, before, bound)
    certificate = view.certificate and view.certificate.estimated()
    if share == 1:
        return replace(view, certificate=certificate)
    stage, local, coarse = view.stage.under(_loading(d, step, share)), copy(view.local), copy(
        view.coarse)
    local.pairs = _at(local.pairs, step, share)
    if coarse is not None:
        coarse.start_from(local)
    if certificate is not None:
        certificate.pairs, certificate.stage = _at(certificate.pairs, step, share), stage
        certificate.external = partway(d.certificate.external, step, share)[None]
        certificate.pushed = partway(d.certificate.pushed, step, share)[None]
    return replace(view, stage=stage, local=local, coarse=coarse, certificate=certificate)


def _at(pairs: Pairs, step: int, share: float) -> Pairs:
    return replace(pairs, numbers=np.array([step - (1 - share)]))


def _loading(d: Decomposition, step: int, share: float) -> Loading:
    """Answers to the loads of a part alone."""
    subdomains = [replace(s, prescribed=partway(s.prescribed, step, share)[None],
                          loads=partway(s.loads, step, share)[None])
                  for s in d.scene.subdomains]
    scene: Scene = replace(d.scene, subdomains=subdomains, steps=1)
    return apply_loads(scene, d.stage.direction, d.made.node_counts, d.made.traces, d.made.rims,
                       d.blackbox,
                       d.made.carried.between(step, share))


def path_sentence(found: Mapping[str, Any]) -> str:
    """Sentence on load steps that were solved again in smaller ones, or could not be."""
    (first, last), (begin,
                    end), why = found["load_steps"], found[
                        "part"], f"{found['why']} (iteration {found['after']})"
    if first != last:
        return f"load steps {first} to {last} were solved again one by one: {why}"
    if found["stuck"]:
        return (
            f"load step {first} could not be followed from {begin:.4g} to {end:.4g} of what it "
            f"adds: {why}; smaller parts would not do, and the rest was tried as a whole")
    part = "" if (begin, end) == (0, 1) else f" from {begin:.4g} to {end:.4g} of what it adds"
    what = f"load step {first}{part}"
    return f"{what} was solved again in two halves: {why}"
