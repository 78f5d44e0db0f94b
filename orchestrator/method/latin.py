"""The multiscale LATIN method: Algorithm 1 of the paper, mended, for load steps that are solved
together.

    s                       the state, s = f̂ + k ŵ
    linear stage            admissible fields u, w, f of s, eq. 20, with the macro problem, eq. 33
                            and 38
    coarse problem          whole bodies moved under the true laws, where there are such
    local stage             ŵ, f̂ that satisfy the interface laws, eq. 3, 7 and 10, and the next
                            state F(s) = f̂ + k ŵ
    acceleration            relaxation, eq. 12, or the combination of all evaluations whose residual
                            F(s) − s is least
    measures and monitors   indicator η, eq. 16, stopping criterion, and whatever else watches

It knows no law, no code, no file and no monitor by name.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.acceleration import make_acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import peak
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.monitors import Evaluation, Monitor
from orchestrator.method.stopping.indicator import measure
from orchestrator.timing import Stopwatch


class Latin:
    """The iterations of one case.

    problem : the decomposition for these load steps
    method : ``method`` of the configuration
    monitors : in the order in which they are asked
    watch : where seconds are counted
    s : (T, D) state to evaluate next
    number, sweeps : iterations, and back-substitutions per subdomain and load step, done so far
    last : iteration after which there is no other
    taken : evaluations that the acceleration has taken in
    """

    def __init__(self, problem: Decomposition, method, monitors: Sequence[Monitor],
                 watch: Stopwatch):
        self.problem, self.method, self.monitors, self.watch = problem, method, monitors, watch
        self.acceleration = make_acceleration(problem, method)
        self.s, self.number, self.sweeps, self.last, self.taken = np.empty(0), 0, 0.0, 0, 0

    def iterate(self) -> Evaluation:
        """One iteration; ``s`` then is the state of the next one, if another follows
        (``verdict.reason``).
        """
        problem, watch, s = self.problem, self.watch, self.s
        self.number += 1
        with watch("linear_stage"):
            fields = problem.stage(s)
            ends = peak(fields.w), float(s.any())
        with watch("coarse"):
            fields = problem.corrected(fields)
        with watch("local_stage"):
            local = problem.local(fields)
            fields = local.fields or fields
        with watch("acceleration"):
            point = problem.point(s, fields)
            residual = self.take(point, local.s)
            best = self.acceleration.best(fields)
        now = Evaluation(self.number, self.number >= self.last, problem, point, fields, best, local)
        with watch("bound"):
            now.measures = measure(problem, best, local, residual,
                                   self.method.tolerance.indicator is not None, ends)
            for monitor in self.monitors:  # each sees what those before it have said
                now.verdict = now.verdict.and_then(monitor.judge(now))
        share = problem.steps / problem.scene.steps  # of a sweep through all load steps
        self.sweeps += share * (now.measures.asked + now.verdict.sweeps)
        if not now.verdict.reason:
            self.go_on(now)
        return now

    def take(self, point: Admissible, image: np.ndarray) -> np.ndarray:
        """Have the acceleration take in an evaluation; the residual at its best point."""
        self.taken += 1
        return self.acceleration.take(point, image)

    @property
    def evaluations(self) -> int:
        """Number of the last evaluations that decide about what follows."""
        return self.taken if self.acceleration.depth is None else min(
            self.taken, self.acceleration.depth)

    def go_on(self, now: Evaluation) -> None:
        """Change the problem as monitors want it changed, and choose the next state."""
        for monitor in self.monitors:
            if monitor.name in now.verdict.changes:
                now.problem = monitor.change(now)
        self.problem = now.problem
        with self.watch("acceleration"):
            if now.verdict.anew:
                self.acceleration, self.taken, self.s = make_acceleration(
                    self.problem, self.method), 0, now.fields.s.copy()
            else:
                self.s = self.acceleration.next()
