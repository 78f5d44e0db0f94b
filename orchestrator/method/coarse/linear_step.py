"""Linearised steps of the coarse contact problem, at pairs that answer together where they share
nodes of bodies.

    [K₀ − Σ Tᵀ A L − Σ Tᵀ X D] dy = −ρ(y),     ρ(y) = Uᵀf + K₀ y − Σ Tᵀ q(y),     A ← (1 − ε) A + ε

q are the laws' answers, those of groups together (``interface.node_stage``), X what they change
with the fields (``group_fields``). Springs ε are in the matrix alone: nothing of them is left at
the end. Where a few steps do not bring ‖ρ‖ to a tenth bodies are on their way to places that no
linear problem knows: there the nonlinear one finds them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.method.coarse.group_fields import GroupFields
from orchestrator.method.coarse.load_step import Bodies
from orchestrator.method.coarse.newton import LEAST, search
from orchestrator.method.coarse.responses import Responses
from orchestrator.method.interface.node_groups import NodeGroups
from orchestrator.method.interface.node_stage import NodeStage
from orchestrator.method.interface.pairs import History
from orchestrator.method.sparse.blocks import BlockPattern, SharedFactors

# ε: fields that are softer come to rest over many iterations (125 grains: 82 at 1e-3, 34 from 1e-4
# down to 1e-6); with none loose bodies double the Newton steps
SPRINGS = 1e-5
STEPS, ENOUGH = 4, 0.1  # at most, and ‖ρ‖ left over that at the start
ROUNDING = 1e-14  # of what forces do in the fields, below which ρ is noise


@dataclass(frozen=True)
class LinearSteps:
    """Matrices and fields that load steps have in common.

    bodies : of the coarse problem; pattern : of the matrices
    grouped : fields at pairs that answer together; None where there are none here
    alone : (P,) 1 at pairs that this rank adds up and that answer alone, else 0
    matrices, factors : load step → its last matrix, as its values, and what solves with it; they
        do in most iterations, for one step
    """

    bodies: Bodies
    pattern: BlockPattern
    grouped: GroupFields | None
    alone: np.ndarray
    matrices: dict[int, np.ndarray]
    factors: dict[int, SharedFactors] = field(default_factory=dict)

    @property
    def groups(self) -> NodeGroups | None:
        """The groups."""
        return None if self.grouped is None else self.grouped.groups

    @classmethod
    def of(cls, bodies: Bodies, groups: NodeGroups | None, response: Responses,
           matrices: dict[int, np.ndarray]) -> LinearSteps:
        """Return the steps; all ranks ask together, or none has groups."""
        grouped = None if groups is None else GroupFields.of(groups, bodies, response)
        alone, fields = bodies.theirs.astype(float), bodies.fields
        pairs = fields.ends[bodies.counted] if grouped is None else grouped.pairs
        if groups is not None:
            alone[grouped.chosen] = 0.0
        return cls(bodies, BlockPattern(pairs, fields.count, fields.size, bodies.team), grouped,
                   alone, matrices)


class NodeStep:
    """One load step, whose pairs answer by nodes.

    number : of the load step in the scene, t of those solved together
    F0 : (3, P) predicted forces; resultant : (bodies, n) Uᵀf; before : what the load step before
        has left
    anchor : (3, P) jump at which springs carry nothing
    nodes : what answers the groups here; None: there are none
    F, after : (3, P) forces predicted at the last fields, and what these leave to the next load
        step
    """

    def __init__(self, of: LinearSteps, t: int, number: int, F0: np.ndarray, resultant: np.ndarray,
                 before: History,
                 anchor: np.ndarray, nodes: NodeStage | None):
        self.of, self.t, self.number, self.F0, self.resultant = of, t, number, F0, resultant
        self.before, self.anchor, self.nodes = before, anchor, nodes
        self.y = np.zeros_like(resultant)
        self.rho = self.residual(self.y)
        self.start = np.linalg.norm(self.rho)

    def residual(self, y: np.ndarray) -> np.ndarray:
        """Return ρ (bodies, n) of fields y (bodies, n)."""
        fields, bodies = self.of.bodies.fields, self.of.bodies
        self.F = fields.predicted(self.F0, y)
        if self.nodes is not None:
            chosen = self.of.grouped.chosen
            self.F[:, chosen], together = self.nodes.predicted(self.t, self.of.grouped.moved(y))
        answer = fields.pairs.force(self.F, self.before, self.number)
        force, jump = fields.pairs.settled(answer.force, self.F, self.anchor)
        if self.nodes is not None:
            jump[:, chosen] = together
        self.after = History(jump, answer.own)
        carried, = bodies.team.sum(fields.carried(force, bodies.theirs.astype(float)))
        self.least = ROUNDING * np.linalg.norm(carried)
        return self.resultant + np.einsum("bij,bj->bi", bodies.K0, y) - carried

    def matrix(self) -> np.ndarray:
        """Return values of the matrix at the last fields."""
        fields, grouped = self.of.bodies.fields, self.of.grouped
        answer = fields.pairs.force(self.F, self.before, self.number, derivative=True)
        every = np.arange(self.F.shape[1])
        slopes = fields.slopes(replace(answer, active=every,
                                       derivative=fields.pairs.slopes(answer, SPRINGS)),
                               self.of.alone)
        slopes = slopes[self.of.bodies.counted]
        if grouped is not None:
            result = np.zeros((len(grouped.pairs), *slopes.shape[1:]))
            result[: len(slopes)] = slopes
            laws, asked = grouped.groups.laws, self.nodes.question
            answer = laws.force(asked.drawn(self.nodes.q[self.t]), asked.before, self.number,
                                derivative=True)
            grouped.add(laws.slopes(answer, SPRINGS), result)
            slopes = result
        return self.of.pattern.values(-slopes.astype(fields.all_L.dtype), self.of.bodies.K0)

    def taken(self) -> int:
        """Take steps until ‖ρ‖ is a tenth of what it was; how many, 0 if it does not come to
        that.
        """
        t, matrices, factors = self.t, self.of.matrices, self.of.factors
        for number in range(1, STEPS + 1):
            known = number == 1 and t in matrices
            if not known:
                matrices[t] = self.matrix()
            if not known or t not in factors:
                factors[t] = self.of.pattern.factors(matrices[t], LEAST)
            self._step(factors[t], known)
            if np.linalg.norm(self.rho) <= max(ENOUGH * self.start, self.least):
                return number
        del matrices[t]
        return 0

    def _step(self, factors: SharedFactors, known: bool) -> None:
        """Move y by a step, or not at all where factors that were known before lead nowhere."""
        size, dy, length = np.linalg.norm(self.rho), -factors.solve(self.rho), 1.0
        work, rho = np.vdot(dy, self.rho), self.residual(self.y + dy)
        if np.linalg.norm(rho) > (size if known else ENOUGH * size) and (known or work < 0):
            length = 0.0 if known else search(
                lambda theta: np.vdot(dy, self.residual(self.y + theta * dy)), work)
            rho = self.residual(self.y + length * dy)
        self.y, self.rho = self.y + length * dy, rho
