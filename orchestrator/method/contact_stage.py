"""Local stage where interfaces open, stick and slip: pointwise, swept through the load steps.

The history of friction lives here alone: the linear stage stays parallel over the load steps.
Perfect interfaces of the same scene keep the exchange of ``local_stage``.

With k = k⁺ on both sides, d = w₂ − w₁ and n from side 1 to side 2:

    F = ½(f₁ − f₂) + ½k(w₂ − w₁),   f̂ = law(F),   d = (F − f̂)/keq,   keq = k/2
    f̂₁ = f̂, f̂₂ = −f̂,   ŵ₁ = ½(w₁ + w₂) − (f₁ + f₂)/(2k) − d/2,   ŵ₂ = ŵ₁ + d

Tied dofs of ten-node tets (see ``ties``) are prescribed, each side by itself: f̂ = f − k (w − ŵ).
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.local_state import LocalState
from orchestrator.method.pairs import Pairs
from orchestrator.method.search_direction import SearchDirection, conditioning


class ContactStage:
    """Local stage for scenes with non-perfect interfaces.

    Parameters
    ----------
    direction : search direction k⁻
    pairs : node pairs of all interfaces that are not perfect
    previous : (P, 3) jump before the first load step
    """

    def __init__(self, direction: SearchDirection, pairs: Pairs, previous: np.ndarray | None = None):
        self.direction, self.pairs = direction, pairs
        self.previous = np.zeros((len(pairs), 3)) if previous is None else previous

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺) on the pairs; perfect interfaces exchange and are at 1."""
        pairs, points = self.pairs, self.pairs.points
        stiff_n, stiff_t = 1 / np.sqrt(2 * points.stiff_n), 1 / np.sqrt(2 * points.stiff_t)
        mine = np.concatenate([pairs.one[pairs.free], pairs.two[pairs.free]])

        def root(x: np.ndarray) -> np.ndarray:
            result = np.empty_like(x)
            for side, part in ((pairs.one, x[: len(x) // 2]), (pairs.two, x[len(x) // 2 :])):
                values = np.zeros(pairs.free.shape)
                values[pairs.free] = part
                scaled = stiff_t[:, None] * values + (
                    (stiff_n - stiff_t) * points.along(values))[:, None] * points.normal
                half = slice(None, len(x) // 2) if side is pairs.one else slice(len(x) // 2, None)
                result[half] = scaled[pairs.free]
            return result

        return conditioning(self.direction.whole[mine][:, mine], root)

    def predicted(self, w: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(P, 3) F from traces (D + G,) of one step."""
        p = self.pairs
        half_jump = p.points.stiffness(p.gather(w, p.two) - p.gather(w, p.one))
        return np.where(p.free, 0.5 * (p.gather(f, p.one) - p.gather(f, p.two)) + half_jump, 0.0)

    def jump(self, F: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(P, 3) d that goes with f̂."""
        return np.where(self.pairs.free, self.pairs.points.compliance(F - force), 0.0)

    def __call__(self, w: np.ndarray, f: np.ndarray) -> LocalState:
        """Local stage for the traces (D, T) of all steps."""
        pairs, points, direction, space = self.pairs, self.pairs.points, self.direction, self.direction.space
        partner, free, own = space.partner, pairs.free, space.size
        steps = w.shape[1]
        w, f = space.extended(w, f)
        s = direction.k @ w[partner] - f[partner]  # perfect interfaces; the others are replaced
        w_hat, f_hat = np.zeros_like(w), np.zeros_like(f)  # of ghosts, only what the laws give
        w_hat[:own] = 0.5 * (w[:own] + w[partner])  # what perfect ones would tend to
        f_hat[:own] = 0.5 * (f[:own] - f[partner])
        force, jump = np.empty((steps, len(pairs), 3)), np.empty((steps, len(pairs), 3))
        status = np.empty((steps, len(pairs)), dtype=int)
        previous = self.previous
        for t in range(steps):
            F = self.predicted(w[:, t], f[:, t])
            answer = pairs.force(F, previous)
            force[t], status[t] = answer.force, answer.status
            previous = jump[t] = self.jump(F, answer.force)
            w1, w2 = pairs.gather(w[:, t], pairs.one), pairs.gather(w[:, t], pairs.two)
            total = pairs.gather(f[:, t], pairs.one) + pairs.gather(f[:, t], pairs.two)
            first = 0.5 * (w1 + w2) - points.compliance(total) / 4 - previous / 2
            w_hat[pairs.one[free], t] = first[free]
            w_hat[pairs.two[free], t] = (first + previous)[free]
        one, two, tied = pairs.one[free], pairs.two[free], pairs.tied
        f_hat[one], f_hat[two] = force.transpose(1, 2, 0)[free], -force.transpose(1, 2, 0)[free]
        w_hat[tied] = pairs.targets
        f_hat[tied] = f[tied] - pairs.tie_stiffness[:, None] * (w[tied] - pairs.targets)
        mine = np.concatenate([one, two, tied])
        mine = mine[mine < own]
        w_hat, f_hat = w_hat[:own], f_hat[:own]
        s[mine] = (f_hat + direction.k @ w_hat)[mine]
        return LocalState(s, (w_hat, f_hat), force, jump, status, pairs.mine)
