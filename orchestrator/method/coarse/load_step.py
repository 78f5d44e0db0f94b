"""One load step of the coarse contact problem: its imbalance ρ, and Newton's method for it.

    ρ(y) = Uᵀf + K₀ y − Σ Tᵀ f̂,     f̂ = (1 − ε) law(F) + ε (F − keq d₀),     F = F₀ + L y

Where pairs share nodes of bodies they may answer together, see ``group_fields``. A step is searched
along its line,

    [K₀ − Σ Tᵀ A L − Σ Tᵀ X D + δ] dy = −ρ(y),    A ← (1 − ε) ∂law/∂F + ε
    y ← y + θ dy,    |dy·ρ(y + θ dy)| ≤ ½ |dy·ρ(y)|

A loose body feels nothing until it touches, then more than before: ‖ρ‖ does not tell how far to go.
The work of the imbalance along the line does (Matthies & Strang, Int. J. Numer. Meth. Engng 14,
1979): without friction it is the slope of a convex energy, negative up to its least value. The
shift δ is none to speak of unless friction makes a line rise from its start.

Among ranks, what belongs to an interface is formed by one that touches it, see ``dealt``, and rank
0 eliminates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.method.coarse.group_fields import GroupFields
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.coarse.responses import Responses
from orchestrator.method.interface.node_groups import NodeGroups
from orchestrator.method.interface.node_stage import NodeStage
from orchestrator.method.interface.pairs import History
from orchestrator.method.sparse.blocks import BlockPattern
from orchestrator.parallel.team import Team

# shift relative to k: the first, by how much it grows, beyond what nothing is tried
LEAST, SLOWER, MOST = 1e-8, 100.0, 1e3
LEFT = 0.5  # work at the end of a step over that at its start; a closer search saves no steps
POINTS = 20  # of a line: regula falsi halves what is left in each but a few
ROUNDING = 1e-14  # of what forces do in the fields, below which ρ is noise


@dataclass(frozen=True)
class Bodies:
    """Bodies, as all load steps have them.

    team : the ranks
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, n, n) stiffness of the fields
    counted : int, interfaces that this rank adds up; theirs : (P,) 1 at their pairs, else 0
    alone : (P,) the same, and 0 at pairs that answer together
    pattern : of the matrices
    grouped : fields at pairs that answer together; None where there are none here
    """

    team: Team
    fields: PairFields
    K0: np.ndarray
    counted: np.ndarray
    theirs: np.ndarray
    alone: np.ndarray
    pattern: BlockPattern
    grouped: GroupFields | None = None

    @classmethod
    def of(cls, team: Team, own: np.ndarray, fields: PairFields, K0: np.ndarray) -> Bodies:
        """Deal out the interfaces, all of whose pairs answer alone; ``own``: bodies of this
        rank.
        """
        chosen = dealt(team, own, fields)
        theirs = np.repeat(chosen.astype(float), np.diff(fields.pairs.bounds))
        counted = np.flatnonzero(chosen)
        pattern = BlockPattern(fields.ends[counted], fields.count, fields.size, team)
        return cls(team, fields, K0, counted, theirs, theirs, pattern)

    def together(self, groups: NodeGroups | None, response: Responses) -> Bodies:
        """Return them with pairs that answer in groups, None where there are none here; all ranks
        ask.
        """
        fields, ends, alone, grouped = self.fields, self.fields.ends[self.counted], self.alone, None
        if groups is not None:
            grouped = GroupFields.of(groups, fields, ends, self.theirs, response)
            ends, alone = grouped.pairs, alone.copy()
            alone[groups.chosen] = 0.0
        return replace(self, grouped=grouped, alone=alone, pattern=BlockPattern(
            ends, fields.count, fields.size, self.team))


class LoadStep:
    """Iterates of one load step; it stands at the last ones.

    bodies : what all load steps share
    number : of the load step in the scene
    F0 : (3, P) predicted forces; resultant : (bodies, n) Uᵀf; before : what the load step before
        has left
    anchor : (3, P) jump at which springs of stabilisation carry nothing
    springs : ε in the matrix, (P,) or one for all; others than those of stabilisation do not
        change what is found
    nodes : what answers the groups, and the place of the load step there; None: all pairs alone

    y, rho : (bodies, n) fields and ρ; start : ‖ρ‖ at the start; least : what is noise of it
    F, answer, after : (3, P) forces predicted, what laws answer, and what that leaves to the next
        load step
    steps : taken so far
    """

    def __init__(self, bodies: Bodies, number: int, F0: np.ndarray, resultant: np.ndarray,
                 before: History, anchor: np.ndarray, springs: np.ndarray | float = 0.0,
                 nodes: tuple[NodeStage, int] | None = None):
        self.bodies, self.number, self.F0, self.resultant = bodies, number, F0, resultant
        self.before, self.anchor, self.springs, self.nodes = before, anchor, springs, nodes
        self.steps = 0
        self.move(np.zeros_like(resultant))
        self.start = self.size

    @property
    def size(self) -> float:
        """‖ρ‖."""
        return float(np.linalg.norm(self.rho))

    def move(self, y: np.ndarray) -> None:
        """Go to fields y (bodies, n)."""
        bodies, fields, pairs = self.bodies, self.bodies.fields, self.bodies.fields.pairs
        self.y, self.F = y, fields.predicted(self.F0, y)
        if self.nodes is not None:
            nodes, t = self.nodes
            chosen = nodes.groups.chosen
            self.F[:, chosen], together = nodes.predicted(t, bodies.grouped.moved(y))
        self.answer = pairs.force(self.F, self.before, self.number)
        force, jump = pairs.settled(self.answer.force, self.F, self.anchor)
        if self.nodes is not None:
            jump[:, chosen] = together
        self.after = History(jump, self.answer.own)
        carried, = bodies.team.sum(fields.carried(force, bodies.theirs))
        self.least = ROUNDING * np.linalg.norm(carried)
        self.rho = self.resultant + np.einsum("bij,bj->bi", bodies.K0, y) - carried

    def matrix(self) -> np.ndarray:
        """Return values of the matrix, for the pattern."""
        bodies, fields, pairs = self.bodies, self.bodies.fields, self.bodies.fields.pairs
        answer = pairs.force(self.F, self.before, self.number, derivative=True)
        result = fields.slopes(pairs.slopes(answer, self.springs), answer.collective,
                               bodies.alone)[bodies.counted]
        if self.nodes is not None:
            (nodes, t), grouped = self.nodes, bodies.grouped
            alone, result = result, np.zeros((len(grouped.pairs), *result.shape[1:]))
            result[: len(alone)] = alone
            laws, asked = grouped.groups.laws, nodes.question
            answer = laws.force(asked.predicted(nodes.q[t]), asked.before, self.number,
                                derivative=True)
            grouped.add(laws.slopes(answer, self.springs), result)
        return bodies.pattern.values(-result.astype(fields.L.dtype), bodies.K0)

    def solved(self, goal: float, most: int) -> str:
        """Take at most so many steps to a goal of ‖ρ‖; how they end: "tolerance", or why not
        there: "steps", or "no direction", whatever the shift.
        """
        while not self.size <= goal:
            if self.steps == most:
                return "steps"
            if not self.step():
                return "no direction"
            self.steps += 1
        return "tolerance"

    def step(self) -> bool:
        """Take a step; whether there was a direction for one."""
        matrix, shift, start = self.matrix(), LEAST, self.y
        while shift <= MOST:
            dy = -self.bodies.pattern.factors(matrix, shift).solve(self.rho)
            if (work := np.vdot(dy, self.rho)) < 0:
                break
            shift *= SLOWER
        else:
            return False

        def along(theta: float) -> float:
            self.move(start + theta * dy)
            return float(np.vdot(dy, self.rho))

        search(along, work)
        return True


def search(work: Callable[[float], float], first: float) -> float:
    """θ in (0, 1] where the work along a line has come down to a part of the first.

    Beyond the whole step's work comes the root of a parabola: it begins with the slope that makes
    the whole step Newton's, and bends up as pairs close on the way. Then the Illinois rule.
    """
    low, at_low, high, at_high, theta = 0.0, first, None, 0.0, 1.0
    before = 0
    for _ in range(POINTS):
        here = work(theta)
        # what is no number has no root
        if not abs(here) > LEFT * abs(first) or (here < 0 and high is None):
            break
        side = 1 if here > 0 else -1
        if side > 0:
            high, at_high, at_low = theta, here, at_low / (2 if before == side else 1)
        else:
            low, at_low, at_high = theta, here, at_high / (2 if before == side else 1)
        theta = low - at_low * (high - low) / (at_high - at_low)
        if not before:  # first + |first| θ + here θ² = 0
            theta = 2 / (1 + np.sqrt(1 + 4 * here / abs(first)))
        before = side
    return theta


def dealt(team: Team, own: np.ndarray, fields: PairFields) -> np.ndarray:
    """(I,) bool, which of the interfaces that this rank touches it adds up; of all ranks each
    interface is one's, and every rank has as many
    node pairs to work on as can be.

    Those that it alone touches are its own. Of those between two ranks the largest go first, each
    to the one that has less.

    own : (b,) int, the bodies of this rank
    """
    inside, index = np.isin(fields.ends,
                            own).all(axis=1), np.array([i.index for i in fields.pairs.interfaces],
                                                       dtype=int)
    pairs = np.diff(fields.pairs.bounds)
    everyones = team.all_gather((pairs[inside].sum(), index[~inside], pairs[~inside]))
    load = np.array([alone for alone, _, _ in everyones], float)
    between = np.concatenate([shared for _, shared, _ in everyones])
    size = np.concatenate([sizes for _, _, sizes in everyones])
    rank = np.repeat(np.arange(team.size), [len(shared) for _, shared, _ in everyones])
    order = np.lexsort((rank, between, -size))  # its two ranks one after the other
    mine = []
    for one, two in order.reshape(-1, 2):
        taker = min(rank[one], rank[two], key=load.__getitem__)
        load[taker] += size[one]
        if taker == team.rank:
            mine.append(between[one])
    return inside | np.isin(index, mine)
