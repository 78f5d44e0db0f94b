"""Dual problems: what a unit load q does to a scene as it stands, where q·u is a quantity that is asked of it.

    K z = q  on every subdomain, supports at rest,      f̂ = keq Dᵀ keq⁻¹ F,   D = ∂law/∂F  where the solution is

Laws are held by their slopes: what is closed stays closed, what sticks stays stuck, and what slips feels no other direction; springs are
springs. So the answer is linear in q. Subdomains, soles, factors, macro and coarse problem are those of the solution: a dual problem costs
some iterations of it, all at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.errors import Refusal
from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer, BONDED, Points
from orchestrator.method.acceleration.residual_minimisation import ResidualMinimisation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.recovery import Parts, recover
from orchestrator.method.interface.pairs import History, Run
from orchestrator.method.interface.rows import dots
from orchestrator.method.iterated import Iterated
from orchestrator.method.latin import Latin
from orchestrator.method.linear.loading import Carried, apply_loads
from orchestrator.method.local_stage import LawStage
from orchestrator.timing import Stopwatch

LEFT = 1e-3  # ‖F(s) − s‖ / ‖F(s)‖ of every load: what multiplies an estimated error need not be known better
MOST = 200  # iterations


class Held(Law):
    """f̂ = S F, with S (3, 3) of every point."""

    name, Parameters, has_history = "held", Entry, False

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
        slope, count = points["slope"], F.shape[1]
        answer = Answer(np.einsum("ijp,jp->ip", slope, F), np.full(count, BONDED))
        if derivative:
            answer.active, answer.derivative = np.arange(count), slope
        return answer


def check_duals(d: Decomposition) -> None:
    """Raises Refusal: a scene in which a unit load has no answer that is linear in it."""
    if any(d.blackbox.traits(s.code).own_matter for s in d.own):
        raise Refusal("dual problem", why="in matter of a code's own, of which stresses are not known")
    if d.nonlinear is not None:
        raise Refusal("dual problem", why="beside nonlinear matter")
    if d.following is not None:
        raise Refusal("dual problem", why="beside pairing: follow")
    if not d.all_perfect and d.local.pairs.stabilisation is not None:
        raise Refusal("dual problem", why="where springs of stabilisation hold bodies that nothing else holds")
    if not d.all_perfect:
        pairs, none = d.local.pairs, History.none(len(d.local.pairs))
        for number in pairs.numbers:
            _alone(pairs.force(np.zeros((3, len(pairs))), none, number, derivative=True))


def solve_duals(d: Decomposition, iterated: Iterated, loads: Sequence[np.ndarray], steps: Sequence[int], method,
                watch: Stopwatch) -> Parts:
    """Per subdomain (R, n_E, 3) the answers, None for other ranks'; all ranks call this.

    loads : per own subdomain (R, n_E, 3)
    iterated : the solution; steps : (R,) of it, from 0, at which laws are held, where some are not perfect
    method : ``method`` of the configuration
    Raises Refusal: laws that cannot be held by their slopes; a dual problem that is not solved
    """
    problem = _held(_loaded(d, loads), d, iterated, steps)
    latin = Latin(problem, method.model_copy(update={"acceleration": "gmres", "memory": "auto", "relaxation": "auto"}), [], watch)
    latin.s, latin.last = np.zeros((len(steps), d.space.size)), MOST
    while True:
        now = latin.iterate()
        if (left := _left(latin.acceleration)) <= LEFT:
            return recover(problem, now.best, problem.bounded(now.best))[1]
        if now.last:
            raise Refusal("dual problem", why=f"whose dual problem is not solved: after {MOST} iterations {left:.0e} are left")


def _left(acceleration: ResidualMinimisation) -> float:
    """The largest ‖F(s) − s‖ / ‖F(s)‖ of any row: their loads are of different units."""
    left, size = np.sqrt(acceleration.team.sum(*(
        dots(x, x) for x in (acceleration.r, acceleration.root * acceleration.point[0] + acceleration.r))))
    return float(np.max(left / np.where(size > 0, size, 1.0)))


def _loaded(d: Decomposition, loads: Sequence[np.ndarray]) -> Decomposition:
    """Answers to loads alone, per own subdomain (R, n_E, 3): R load steps."""
    own, steps = dict(zip(d.space.subdomains, loads)), len(loads[0])
    given = [own.get(s.index, np.zeros((steps, len(s.nodes), 3))) for s in d.scene.subdomains]
    scene = replace(d.scene, steps=steps, subdomains=[
        replace(s, loads=q, prescribed=np.zeros_like(q)) for s, q in zip(d.scene.subdomains, given)])
    bodies = Carried(d.made.carried.body, {})
    loading = apply_loads(scene, d.stage.direction, d.made.node_counts, d.made.traces, d.made.rims, d.blackbox, bodies)
    stage, bound = d.stage.under(loading), None
    if d.bound is not None:
        bound = d.bound.of(stage)
        bound.external = np.hstack([q.reshape(scene.steps, -1)[:, trace] for q, trace in zip(loads, d.made.traces)])
    return replace(d, scene=scene, stage=stage, bound=bound, certificate=None, following=None, self_stress=None, at_nodes=False)


def _held(problem: Decomposition, d: Decomposition, iterated: Iterated, steps: Sequence[int]) -> Decomposition:
    """Answers with laws held as they are at load steps of the solution, a row each."""
    if d.all_perfect:
        return problem
    lawful, every = d.local.pairs, d.local.pairs if d.coarse is None else d.coarse.pairs
    slopes = _slopes(d, iterated)[np.array(steps)]
    bonded = [run for run in every.runs if run.law.perfect]
    points = replace(lawful.points, stepped={"slope": slopes})
    pairs = replace(every, runs=[Run(Held, slice(0, len(lawful)), points), *bonded], laws=[Held], slid=None,
                    numbers=np.arange(len(slopes)))
    local, coarse = LawStage(problem.stage.direction, pairs.lawful), None
    if d.coarse is not None:
        coarse = d.coarse.paired(pairs)
        coarse.radius = None
        coarse.start_from(local)
    return replace(problem, local=local, coarse=coarse)


def _slopes(d: Decomposition, iterated: Iterated) -> np.ndarray:
    """(T, 3, 3, P) keq Dᵀ keq⁻¹ at the points of interfaces that are not perfect."""
    result = np.zeros((d.steps, 3, 3, len(d.local.pairs)))
    for steps, pairs, before in iterated.by_pairing(d):
        points = pairs.points
        for t in range(*steps.indices(d.steps)):
            force, jump = iterated.local.force[t], iterated.local.jump[t]
            answer = pairs.force(force + points.stiffness(jump), before, pairs.numbers[t - steps.start], derivative=True)
            _alone(answer)
            some = points.some(answer.active)
            columns = some.compliance(answer.derivative.swapaxes(0, 1))  # Dᵀ keq⁻¹: keq is symmetric
            result[t][:, :, answer.active] = some.stiffness(columns.swapaxes(0, 1)).swapaxes(0, 1)
            before = History(jump, {name: x[t] for name, x in iterated.local.own.items()})
    return result


def _alone(answer: Answer) -> None:
    """Raises Refusal: points answer together."""
    if answer.collective is not None:
        raise Refusal("dual problem", why="beside what is tightened, or moved as one: all its points answer together")
