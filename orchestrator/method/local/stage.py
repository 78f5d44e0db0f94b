"""Local stage where some interfaces are not perfect: their laws, pointwise, swept through the load steps.

The laws' history lives here alone: the linear stage stays parallel over the load steps. Perfect interfaces of the
same scene keep their exchange.

With k = k⁺ on both sides, d = w₂ − w₁ and n from side 1 to side 2:

    F = ½(f₁ − f₂) + ½k(w₂ − w₁),   f̂ = law(F),   d = (F − f̂)/keq,   keq = k/2
    f̂₁ = f̂, f̂₂ = −f̂,   ŵ₁ = ½(w₁ + w₂) − (f₁ + f₂)/(2k) − d/2,   ŵ₂ = ŵ₁ + d

Tied dofs of ten-node tets (see ``ties``) are prescribed, each side by itself: f̂ = f − k (w − ŵ).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from orchestrator.laws.status import BONDED
from orchestrator.method.interface.pairs import Pairs, PairTraces
from orchestrator.method.interface.search_direction import SearchDirection, conditioning
from orchestrator.method.local.exchange import Exchange
from orchestrator.method.local.state import LocalState


class LawStage:
    """Local stage of a scene with interfaces that are not perfect.

    Parameters
    ----------
    direction : search direction k⁻
    pairs : node pairs that a law answers for: those of all interfaces that are not perfect
    previous : (3, P) jump before the first load step
    """

    def __init__(self, direction: SearchDirection, pairs: Pairs, previous: np.ndarray | None = None):
        self.direction, self.pairs, self.exchange = direction, pairs, Exchange(direction)
        self.previous = np.zeros((3, len(pairs))) if previous is None else previous

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺) on the pairs; perfect interfaces exchange and are at 1."""
        pairs, points = self.pairs, self.pairs.points
        roots = replace(points, stiff_n=1 / np.sqrt(2 * points.stiff_n), stiff_t=1 / np.sqrt(2 * points.stiff_t))
        mine = np.concatenate([pairs.one[pairs.free], pairs.two[pairs.free]])

        def root(x: np.ndarray) -> np.ndarray:
            result = np.empty_like(x)
            for side, part in ((pairs.one, x[: len(x) // 2]), (pairs.two, x[len(x) // 2 :])):
                values = np.zeros(pairs.free.shape)
                values[pairs.free] = part
                half = slice(None, len(x) // 2) if side is pairs.one else slice(len(x) // 2, None)
                result[half] = roots.stiffness(values)[pairs.free]
            return result

        return conditioning(self.direction.whole[mine][:, mine], root)

    @cached_property
    def exchanged(self) -> np.ndarray:
        """(q,) int, trace dofs of this rank that no law and no tie deals with: those of perfect interfaces."""
        pairs, rest = self.pairs, np.ones(len(self.direction.space.owner), bool)
        rest[pairs.one[pairs.free]] = rest[pairs.two[pairs.free]] = rest[pairs.tied] = False
        return np.flatnonzero(rest[: self.direction.space.size])

    def traces(self, w: np.ndarray, f: np.ndarray) -> PairTraces:
        """Of the traces (D, T) at the pairs."""
        return PairTraces.of(self.pairs, *self.direction.space.extended(w, f))

    def predicted(self, at: PairTraces) -> np.ndarray:
        """(T, 3, P) F."""
        half_jump = self.pairs.points.stiffness(at.w2 - at.w1)
        return self.pairs.masked(0.5 * (at.f1 - at.f2) + half_jump)

    def jump(self, F: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(3, P) d that goes with f̂."""
        return self.pairs.masked(self.pairs.points.compliance(F - force))

    def __call__(self, w: np.ndarray, f: np.ndarray) -> LocalState:
        """Local stage for the traces (D, T) of all steps."""
        pairs, space, k = self.pairs, self.direction.space, self.direction.k
        own, steps = space.size, w.shape[1]
        w, f = space.extended(w, f)
        at = PairTraces.of(pairs, w, f)
        F, previous = self.predicted(at), self.previous
        force, jump, status = np.empty_like(F), np.empty_like(F), np.empty((steps, len(pairs)), dtype=int)
        for t in range(steps):
            answer = pairs.force(F[t], previous)
            force[t], status[t] = answer.force, answer.status
            previous = jump[t] = self.jump(F[t], answer.force)
        first = 0.5 * (at.w1 + at.w2 - jump) - pairs.points.compliance(at.f1 + at.f2) / 4

        w_hat, f_hat = np.zeros((2, steps, len(w)))  # of ghosts, what the laws give is left out in the end
        one, two, tied = pairs.one[pairs.free], pairs.two[pairs.free], pairs.tied
        w_hat[:, one], w_hat[:, two] = first[:, pairs.free], (first + jump)[:, pairs.free]
        f_hat[:, one], f_hat[:, two] = force[:, pairs.free], -force[:, pairs.free]
        w_hat, f_hat = (np.ascontiguousarray(x[:, :own].T) for x in (w_hat, f_hat))
        w_hat[tied] = pairs.targets
        f_hat[tied] = f[tied] - pairs.tie_stiffness[:, None] * (w[tied] - pairs.targets)
        alone, partner = self.exchanged, space.partner[self.exchanged]
        w_hat[alone] = 0.5 * (w[alone] + w[partner])  # what perfect ones would tend to
        f_hat[alone] = 0.5 * (f[alone] - f[partner])
        k_hat = k @ w_hat
        s = f_hat + k_hat
        if len(alone):
            s[alone] = self.exchange.state(w, f)[alone]
        return LocalState(s, (w_hat, f_hat, k_hat), force, jump, status)

    @property
    def at_rest(self) -> np.ndarray:
        """(P,) int, status of pairs that nothing has moved."""
        nothing = np.zeros((3, len(self.pairs)))
        return self.pairs.force(nothing, nothing).status

    def counts(self, local: LocalState) -> dict[str, int]:
        """Per status that a law may give, this rank's pairs, summed over the steps."""
        return {status.name: int((local.status == status)[:, self.pairs.mine].sum())
                for status in self.pairs.statuses if status != BONDED}
