"""How soft subdomains are beside their soles: σ, the least eigenvalue above zero of S x = σ k x on
a subdomain's boundary.

Conjugate gradients on S, preconditioned with M = S + k, leave a residual r whose energy is then
known from above,

    rᵀS⁺r ≤ (1 + 1/σ) rᵀM⁻¹r

for r in balance with all rigid motions. M⁻¹S has the eigenvalues σ/(1 + σ): the least of them is
told by steps of the same conjugate gradients from forces in balance, all subdomains at once. Beside
answers that are known (``known_answers``) it is larger. Ritz values come from one side:
σ goes on to fall twice as its last two steps have let it fall, and is halved. A residual says
nothing where many fields are about as soft as each other: with moduli 1:1000 brick by brick σ is
known to a third by then, and each residual is larger than all of it.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.rows import DEPENDENT, ratio, ColumnSegments, scattered
from orchestrator.method.linear.stage import LinearStage
from orchestrator.method.stopping.dual_energy import Descent, Dual
from orchestrator.method.stopping.known_answers import KnownAnswers

STEPS = 12  # by then the largest eigenvalue of ten grains' and of blocks' is known to a hundredth
FEW = 6  # the same beside answers that are known
BACK = 2  # steps before the last, beside which it has fallen
SAFE = 0.5  # of σ
LEAST = 1e-8  # what is softer is taken to be as soft


class BesideRigid:
    """Fields and forces of the own subdomains beside their rigid motions, orthogonal in k.

    rigid : (6, B) rigid motions, zero where supports leave fewer
    """

    def __init__(self, stage: LinearStage, rigid: np.ndarray):
        self.of, self.rigid = ColumnSegments(stage.space.boundary), rigid
        # all at once take six times as much
        self.carried = np.concatenate([stage.direction.robin(one[None]) for one in rigid])
        gram = np.stack([self.of.sums(rigid * one) for one in self.carried]).transpose(2, 1, 0)
        self.inverse = np.linalg.pinv(gram, rcond=DEPENDENT, hermitian=True)

    def balanced(self, h: np.ndarray) -> np.ndarray:
        """(…, B) forces without resultants."""
        return h - self._part(self.rigid, self.carried, h)

    def rigid_work(self, x: np.ndarray, pushed: np.ndarray, h: np.ndarray) -> np.ndarray:
        """(T,) work that forces do in the rigid motions of fields x (T, B).

        pushed : (T, 6, S) what some forces do in ``rigid``, of each subdomain with boundary dofs; h
            : (T, B) the others
        """
        acting = pushed + np.stack([self.of.sums(one * h) for one in self.rigid], axis=-2)
        return np.einsum("tis,tis->t", self._share(self.carried, x), acting)

    def _share(self, measured: np.ndarray, x: np.ndarray) -> np.ndarray:
        share = np.stack([self.of.sums(one * x) for one in measured], axis=-2)
        return np.einsum("sij,...js->...is", self.inverse, share)

    def _part(self, measured: np.ndarray, given: np.ndarray, x: np.ndarray) -> np.ndarray:
        share = self._share(measured, x)
        return sum(one * self.of.spread(share[..., i, :]) for i, one in enumerate(given))


def softest(stage: LinearStage, beside: BesideRigid,
            aside: KnownAnswers | None = None) -> np.ndarray:
    """(S,) a lower bound of σ, to be believed if not to be proved, of each own subdomain that has
    boundary dofs.

    aside : answers that are known: of all fields beside them
    """
    start = beside.balanced(scattered(stage.space.link.boundary_number)[None])
    count = FEW if aside else STEPS
    begun = aside.answered(start) if aside else (np.zeros_like(start), start)
    descent = Descent(stage, Dual(np.zeros(1), 0, *begun, start), aside)
    every, at = np.ones((1, len(beside.of.slices)), dtype=bool), np.arange(count)
    rz, alpha = map(np.array, zip(*((descent.asked(every)[0], descent.moved()[0]) for _ in at)))
    there = (alpha > 0) & (rz > DEPENDENT * rz[0])  # what is exhausted tells no more
    inverse, beta = ratio(1.0, alpha, there), ratio(rz[1:], rz[:-1], there[1:])
    matrices = np.zeros((every.size, count, count))  # Lanczos' for M⁻¹S: the lower triangle is read
    matrices[:, at, at] = np.where(there, inverse, 1.0).T
    matrices[:, at[1:], at[1:]] += (beta * inverse[:-1]).T
    matrices[:, at[1:], at[:-1]] = -(np.sqrt(beta) * inverse[:-1]).T
    least = (np.linalg.eigvalsh(matrices[:, :n, :n])[:, 0] for n in (count - BACK, count))
    before, now = (1 / (1 / np.clip(each, LEAST, 1 - LEAST) - 1) for each in least)  # of σ/(1 + σ)
    return SAFE * np.maximum(now * np.minimum(now / before, 1.0) ** 2, LEAST)
