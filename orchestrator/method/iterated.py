"""The iterations' result: the input of all that is delivered; and load steps that need none,
because they follow from others.

Where all interfaces are perfect the problem is linear. The load vectors of all steps (prescribed
displacements and nodal forces) are combinations of a few of them, and so are the solutions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.linalg as la

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Iteration
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.latin import Latin
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local_stage import LocalState
from orchestrator.method.monitors import Evaluation
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.model import Scene, Subdomain


@dataclass(frozen=True)
class Iterated:
    """Result of the iterations, this rank's part.

    fields : best admissible fields
    local : the last local stage
    bound : their error bound, energy and continuity
    converged, stop_reason : and why
    iterations : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step, iterations alone
    last : the last event
    history : all events, without their states
    found : monitor's name → what it has found, case after case; path: see ``increments``
    problem : the decomposition for these load steps, or for a part of one, as it was in the end;
        None: several of them
    part : whether this is a part of a load step, of which nothing is delivered
    met : the pairs that met in its load steps, and what those before had left, increment by
        increment; none where all is bonded
    between : load steps that were halved, from 0 → their parts but for the last one
    """

    fields: Admissible
    local: LocalState
    bound: Judged
    converged: bool
    stop_reason: str
    iterations: int
    sweeps: float
    last: Iteration
    history: list[Iteration] = field(default_factory=list)
    found: Mapping[str, list[Any]] = field(default_factory=dict)
    problem: Decomposition | None = None
    part: bool = False
    met: Sequence[tuple[Pairs, History]] = ()
    between: Mapping[int, Sequence[Iterated]] = field(default_factory=dict)

    @classmethod
    def joined(cls, increments: Sequence[Iterated]) -> Iterated:
        """Join the results of increments, in order; the reason is that of the first failure, and
        the error the largest.
        """
        if len(increments) == 1:
            return increments[0]
        decisive, final = next((x for x in increments if not x.converged),
                               increments[-1]), increments[-1]
        whole, between, step = [], {}, 0
        for x in increments:
            if x.part:
                between.setdefault(step, []).append(x)
                continue
            whole.append(x)
            step += len(x.fields.s)
        bound = Judged.joined([x.bound for x in whole])
        if between:
            bound = replace(bound,
                            relative=float(
                                np.max([bound.relative,
                                        *(x.bound.relative for x in increments if x.part)])))
        return cls(Admissible.joined([x.fields for x in whole]),
                   LocalState.joined([x.local for x in whole]), bound,
            decisive.converged, decisive.stop_reason, final.iterations, final.sweeps, decisive.last,
                   [event for x in increments for event in x.history],
            {name: [found for x in whole for found in x.found[name]] for name in whole[0].found},
                   between=between, met=[met for x in whole for met in x.met])

    def left(self) -> History:
        """The state that the next load step begins with: where an energy error is known the
        displacements that it is measured with, lest
        the next step's be measured from another beginning than it is solved with."""
        if self.bound.pair is not None and not self.bound.pair.missing:
            # points of perfect interfaces come last
            return self.bound.pair.before[-1].take(slice(0, self.local.jump.shape[2]))
        return self.local.left()

    def by_pairing(self) -> Iterator[tuple[slice, Pairs, History]]:
        """Load steps in which the same pairs meet, from one beginning; these, and what the step
        before has left; the scene has their operators meanwhile.
        """
        step = 0
        for pairs, before in self.met:
            for i in pairs.interfaces:
                i.mortar = pairs.mortars.get(i.index, i.mortar)
            yield slice(step, step + len(pairs.numbers)), pairs, before
            step += len(pairs.numbers)


def event_of(now: Evaluation, sweeps: float, seconds: float) -> Iteration:
    """The event of an iteration, once the next state is known.

    sweeps, seconds : spent in iterations, and in all
    """
    measures, verdict, coarse = now.measures, now.verdict, now.problem.coarse
    values = {"iteration": now.number, "sweeps": now.problem.made.sweeps + sweeps,
              "seconds": seconds, **measures.values, **verdict.told}
    if coarse is not None:
        values |= {"newton_steps": coarse.problem.newton_steps,
                   "coarse_left": max(coarse.problem.left.values(), default=0.0)}
    return Iteration(values, verdict.target, now.best.s, measures.counts,
                     {} if verdict.laws is None else verdict.laws.measures,
                     {} if coarse is None else dict(coarse.problem.ends))


def delivered(latin: Latin, end: tuple[Admissible, LocalState, Iteration], why: tuple[bool, str],
              history: list[Iteration],
              known: Judged | None = None) -> Iterated:
    """Result of an increment's iterations.

    end : fields, local stage and event
    why : whether they have converged, and the reason
    known : the bound of the fields, as far as it is known
    """
    problem, (fields, local, event) = latin.problem, end
    bound = problem.bounded(fields, known)
    if bound is not known:
        latin.sweeps += bound.sweeps * problem.steps / problem.scene.steps
    event = replace(event, checkpoint=None)
    return Iterated(fields, local, bound, *why, latin.number, latin.sweeps, event,
                    history or [event.without_state()],
                    {monitor.name: monitor.found(problem) for monitor in latin.monitors}, problem,
                    met=() if problem.all_perfect
                    else [(problem.local.pairs, problem.local.before)])


SAME = 1e-12  # part of a load vector that the others leave unexplained, relative to it


@dataclass(frozen=True)
class LoadCases:
    """The load steps that are solved, and how all follow from them.

    chosen : (r,) int, ascending
    weights : (r, T) step t = Σᵢ weights[i, t] × step chosen[i]
    """

    chosen: np.ndarray
    weights: np.ndarray

    @property
    def left_out(self) -> int:
        """Number of steps that are not solved."""
        return self.weights.shape[1] - len(self.chosen)

    def all_steps(self, values: np.ndarray) -> np.ndarray:
        """(T, …) of what is linear in the load, given (r, …)."""
        return np.tensordot(self.weights.T, values, axes=1) if self.left_out else values

    def part_of(self, d: Decomposition) -> Decomposition:
        """The decomposition for the chosen steps, with a bound that holds for all of them."""
        if not self.left_out:
            return d
        part = d.batch(self.chosen)
        return replace(part, bound=part.bound and part.bound.for_cases(self.weights))


def load_cases(scene: Scene, own: Sequence[Subdomain] | None = None,
               team: Team = ALONE) -> LoadCases:
    """The steps to solve, the same on all ranks, which ask together.

    own : this rank's subdomains of its part of the scene; None: all
    """
    remembers = team.max(float(scene.remembers))[0]
    if scene.steps > 1 and scene.bonded and not remembers:
        return _independent(_load_vectors(scene.steps, scene.subdomains if own is None else own,
                                          team))
    return LoadCases(np.arange(scene.steps), np.eye(scene.steps))


def _load_vectors(steps: int, own: Sequence[Subdomain], team: Team) -> np.ndarray:
    """(n, T) prescribed displacements and forces, each relative to the largest; of several ranks
    the triangle of their least squares.
    """
    parts = []
    for name in ("prescribed", "loads"):
        values = np.hstack([getattr(s, name).reshape(steps, -1) for s in own]).T
        values = values[values.any(axis=1)]
        parts.append(values / team.max(np.abs(values).max(initial=np.finfo(float).tiny))[0])
    loads = np.vstack(parts)
    return loads if team.size == 1 else np.vstack(
        team.all_gather(la.qr(loads, mode="r")[0][:steps] if len(loads) else loads))


def _independent(loads: np.ndarray) -> LoadCases:
    """Linear: a rank-revealing QR picks the steps, the largest first."""
    if not loads.any():
        return LoadCases(np.array([0]), np.ones((1, loads.shape[1])))
    _, triangle, order = la.qr(loads, mode="economic", pivoting=True)
    # what a column has below row r is what r steps leave unexplained of it; largest columns come
    # first
    left = np.sqrt(np.cumsum(triangle[::-1] ** 2, axis=0)[::-1])
    size = left[0]
    rank = next((r for r in range(1, len(left)) if (left[r] <= SAME * size).all()), len(left))
    weights = np.zeros((rank, loads.shape[1]))
    weights[:, order] = la.solve_triangular(triangle[:rank, :rank], triangle[:rank])
    ascending = np.argsort(order[:rank])
    return LoadCases(order[:rank][ascending], weights[ascending])


def expanded(d: Decomposition, iterated: Iterated, cases: LoadCases) -> Iterated:
    """Result for all load steps, from that for the solved ones.

    d : the decomposition with all load steps

    The bound that ended the iterations already held for all steps, see ``ErrorBound.for_cases``;
    energies and the correction to u_D are evaluated again.
    """
    if not cases.left_out:
        return iterated
    fields = iterated.fields.combined(cases.weights)
    bound = replace(d.bound.first(fields)[0], relative=iterated.bound.relative,
                    steps=iterated.bound.steps)
    return replace(iterated, fields=fields, local=LocalState(cases.weights.T @ iterated.local.s),
                   bound=bound)
