"""Local stage of bonded scenes that are solved by nodes: one state per node of a subdomain.

With the copies E of a node in the subdomains that share it, κ_E the stiffness of each there (the
diagonal of K_E, the mean of its three components), and f_E what acts on each,

    s_E = k_E w̃_E − (Σ f − f_E),     w̃_E = Σ' κ w / Σ' κ,   Σ' over the other copies

At the fixed point copies have moved alike and their forces add up to nothing. Where two subdomains
meet it is the exchange s = k w' − f' of ``local_stage``. On sides of interfaces, where three
subdomains or more meet each pair has copies of its own, and forces that go round in circles among
them are felt by no linear stage: nothing of that kind is left here.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.rows import dots, ratio
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local_stage import Exchange, LocalState

STEPS = 50  # eigenvalues of a graph of a node's copies are few
EXACT = 1e-28  # of the squared forces


class NodeExchange(Exchange):
    """Local stage of a conforming scene.

    direction : search direction k⁻, of rings
    weight : (B,) κ
    """

    kplus = "exchange"

    def __init__(self, direction: SearchDirection, weight: np.ndarray):
        self.direction, self.space, self.weight = direction, direction.space, weight
        self._others = np.maximum(_sum(self.space, weight) - weight, np.finfo(float).eps * weight)
        self._diagonal, self.lumped = _sum(self.space, direction.diagonal), self

    def __call__(self, fields: Admissible) -> LocalState:
        """Next state s = k⁻ w̃ − (Σ f − f)."""
        w, f = self.others(fields.w, fields.f)
        return LocalState(self.direction.times(w) - f)

    def others(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, B) means of displacements, and sums of forces, (T, B) each, of the other copies."""
        own = self.weight * w
        moved, pushed = np.split(self._spread(self.space.class_sums(np.concatenate([own, f]))), 2)
        return (moved - own) / self._others, pushed - f

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (T, B), from traces (T, B + G); k⁺ is one's own diagonal."""
        k = self.direction.diagonal
        w, f = w[:, : len(k)], f[:, : len(k)]
        w_hat = self._spread(self.space.class_sums(k * w - f)) / self._diagonal
        return w_hat, f - k * (w - w_hat)

    def _spread(self, sums: np.ndarray) -> np.ndarray:
        return sums.take(self.space.label, axis=1)


def _sum(space: TraceSpace, values: np.ndarray) -> np.ndarray:
    """(B,) sum of values (B,) over all copies of each node."""
    return space.class_sums(values[None])[0].take(space.label)


def pair_forces(space: TraceSpace, f: np.ndarray) -> np.ndarray:
    """(T, Q) forces between pairs of copies that stand behind forces (T, B) of the copies: the
    least
    whose sums come closest to these, by conjugate gradients. All ranks have to ask."""
    transfer, team = space.transfer, space.team
    copies, (least,) = _sum(space, np.ones(f.shape[1])), team.sum(EXACT * dots(f, f))
    left = f - space.class_sums(f).take(space.label, axis=1) / copies
    q, towards, before = np.zeros((len(f), len(transfer.one))), left, None
    for _ in range(STEPS):
        size, = team.sum(dots(left, left))
        towards = left if before is None else left + ratio(size, before)[:, None] * towards
        jump = -transfer.jump(space.extended(towards)[0])
        pushed = transfer.opposed(jump)[:, : space.size]
        work, = team.sum(dots(towards, pushed))
        step, before = ratio(size, work)[:, None], size
        q, left = q + step * jump, left - step * pushed
        if (size <= least).all():
            break
    return q
