"""Local stage where some interfaces are not perfect: their laws (paper, eq. 3), pointwise, swept through the load steps.

The laws' history lives here alone: the linear stage stays parallel over the load steps. Perfect interfaces of the
same scene keep their exchange.

At points with the jump d, from the predicted force F to the traces as ``point_traces`` has it:

    f̂ = law(F),   d = (F − f̂)/keq;      stabilised:   f̂ = (1 − ε) law(F) + ε (F − keq d_before)

Tied dofs of ten-node tets (see ``ties``) are prescribed, each side by itself: f̂ = f − k (w − ŵ).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from orchestrator.laws.points import Answer
from orchestrator.laws.status import BONDED
from orchestrator.method.history import History
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.search_direction import SearchDirection, conditioning
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.exchange import Exchange
from orchestrator.method.local.state import LocalState


# Steps in which the forces of points that share nodes settle. With a slave of half and a third of the master's size 46 and
# 62 iterations to 1e-6 become 42 and 57 with one, 33 and 41 with three, 29 and 34 with ten and with thirty; matching
# meshes of the slave's size take 29 and 36.
COUPLED = 10


class LawStage:
    """Local stage of a scene with interfaces that are not perfect.

    direction : search direction k⁻
    pairs : node pairs that a law answers for: those of all interfaces that are not perfect
    before : what the load step before the first one has left; None: nothing was before
    """

    def __init__(self, direction: SearchDirection, pairs: Pairs, before: History | None = None):
        self.direction, self.pairs, self.exchange = direction, pairs, Exchange(direction)
        self.before = History.none(len(pairs)) if before is None else before

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺) on the pairs; perfect interfaces exchange and are at 1."""
        root = self.pairs.nodes.root
        at = np.flatnonzero(root.diagonal() > 0)
        root = root[at][:, at]
        return conditioning(self.direction.whole[at][:, at], lambda x: root @ x)

    @cached_property
    def perfect(self) -> np.ndarray:
        """(q,) int, trace dofs of this rank that no law and no tie deals with: those of perfect interfaces."""
        pairs = self.pairs
        rest = ~pairs.nodes.there
        rest[pairs.tied.dofs] = False
        return np.flatnonzero(rest[: self.direction.space.size])

    def __call__(self, fields: Admissible) -> LocalState:
        """Local stage for the fields of all steps."""
        pairs, steps = self.pairs, len(fields.s)
        w, f = fields.extended
        at = pairs.traces(w, f)
        F, before, own = at.predicted(), self.before, []
        force, jump, status = np.empty_like(F), np.empty_like(F), np.empty((steps, len(pairs)), dtype=int)
        lawful = force if pairs.stabilisation is None else np.empty_like(F)
        for t in range(steps):
            answer = pairs.force(F[t], before, pairs.numbers[t])
            force[t], jump[t] = pairs.settled(answer.force, F[t], before.jump)
            if pairs.nodes.coupling is not None:
                answer, force[t], jump[t] = self._coupled(F[t], at.force[t], force[t], before, t)
            lawful[t], status[t] = answer.force, answer.status
            before = History(jump[t], answer.own)
            own.append(answer.own)
        w_hat, f_hat = at.hats(force)
        tied, targets, stiffness = pairs.tied
        w_hat[:, tied] = targets
        f_hat[:, tied] = f[:, tied] - stiffness * (w[:, tied] - targets)
        alone = self.perfect
        if len(alone):
            exchanged, w_other, f_other = (x[:, alone] for x in self.exchange.exchanged(w, f))
            w_hat[:, alone] = 0.5 * (w[:, alone] + w_other)  # what they tend to: the exchange itself forms none
            f_hat[:, alone] = 0.5 * (f[:, alone] - f_other)
        k_hat = self.direction.times(w_hat)
        s = f_hat + k_hat
        if len(alone):
            s[:, alone] = exchanged
        return LocalState(s, (w_hat, f_hat, k_hat), force, lawful, jump, status,
                          {name: np.stack([each[name] for each in own]) for name in own[0]}, at)

    def _coupled(self, F: np.ndarray, q: np.ndarray, force: np.ndarray, before: History, t: int) -> tuple[Answer, np.ndarray, np.ndarray]:
        """What the laws answer, f̂ and d, (3, P) each, where points feel each other through the nodes they share:

            f̂ ← law(f̂ + keq d),   d = d* − S (f̂ − q*)

        Points whose nodes match have S = 1/keq: for them nothing changes.

        F, q : (3, P) predicted forces F = q* + keq d*, and q*
        force : f̂ = law(F) to begin with; before : what the load step before has left
        t : of the load steps here
        """
        pairs, coupling = self.pairs, self.pairs.nodes.coupling
        alone = pairs.points.compliance(F - q)

        def moved(force: np.ndarray) -> np.ndarray:
            return pairs.masked(alone - (coupling @ (force - q).ravel()).reshape(force.shape))

        for _ in range(COUPLED):
            F = force + pairs.points.stiffness(moved(force))
            answer = pairs.force(F, before, pairs.numbers[t])
            force = pairs.settled(answer.force, F, before.jump)[0]
        return answer, force, moved(force)

    def counts(self, local: LocalState) -> dict[str, int]:
        """Per status that a law may give, this rank's pairs, summed over the steps."""
        mine = self.pairs.mine
        found = local.status if mine.all() else local.status[:, mine]
        return {status.name: int(np.count_nonzero(found == status)) for status in self.pairs.statuses if status != BONDED}
