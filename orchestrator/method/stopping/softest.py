"""How soft subdomains are beside their soles: σ, the least eigenvalue above zero of S x = σ k x on a subdomain's boundary.

Conjugate gradients on S, preconditioned with M = S + k, leave a residual r whose energy is then known from above,

    rᵀS⁺r ≤ (1 + 1/σ) rᵀM⁻¹r

for r in balance with all rigid motions. M⁻¹k, one back-substitution, has the eigenvalues 1/(1 + σ): the largest of them beside those
of rigid motions, which are 1, is found by Lanczos' method in the product of k, all subdomains at once. Ritz values come from one side:
σ goes on to fall twice as its last two steps have let it fall, and is halved. A residual says nothing where many fields are about as
soft as each other: with moduli 1:1000 brick by brick σ is known to a third by then, and each residual is larger than all of it.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.rows import DEPENDENT, ColumnSegments, scattered
from orchestrator.method.linear.stage import LinearStage

STEPS = 12  # by then the largest eigenvalue of ten grains' and of blocks' is known to a hundredth
BACK = 2  # steps before the last, beside which it has fallen
SAFE = 0.5  # of σ
LEAST = 1e-8  # what is softer is taken to be as soft


class BesideRigid:
    """Fields and forces of the own subdomains beside their rigid motions, orthogonal in k.

    rigid : (6, B) rigid motions, zero where supports leave fewer
    """

    def __init__(self, stage: LinearStage, rigid: np.ndarray):
        self.of, self.rigid = ColumnSegments(stage.space.boundary), rigid
        self.carried = np.concatenate([stage.direction.robin(one[None]) for one in rigid])  # all at once take six times as much
        gram = np.stack([self.of.sums(rigid * one) for one in self.carried]).transpose(2, 1, 0)
        self.inverse = np.linalg.pinv(gram, rcond=DEPENDENT, hermitian=True)

    def deformed(self, x: np.ndarray) -> np.ndarray:
        """(…, B) fields without rigid motions."""
        return x - self._part(self.carried, self.rigid, x)

    def balanced(self, h: np.ndarray) -> np.ndarray:
        """(…, B) forces without resultants."""
        return h - self._part(self.rigid, self.carried, h)

    def rigid_work(self, x: np.ndarray, pushed: np.ndarray, h: np.ndarray) -> np.ndarray:
        """(T,) work that forces do in the rigid motions of fields x (T, B).

        pushed : (T, 6, S) what some forces do in ``rigid``, of each subdomain with boundary dofs; h : (T, B) the others
        """
        acting = pushed + np.stack([self.of.sums(one * h) for one in self.rigid], axis=-2)
        return np.einsum("tis,tis->t", self._share(self.carried, x), acting)

    def _share(self, measured: np.ndarray, x: np.ndarray) -> np.ndarray:
        share = np.stack([self.of.sums(one * x) for one in measured], axis=-2)
        return np.einsum("sij,...js->...is", self.inverse, share)

    def _part(self, measured: np.ndarray, given: np.ndarray, x: np.ndarray) -> np.ndarray:
        share = self._share(measured, x)
        return sum(one * self.of.spread(share[..., i, :]) for i, one in enumerate(given))


def softest(stage: LinearStage, beside: BesideRigid) -> np.ndarray:
    """(S,) a lower bound of σ, to be believed if not to be proved, of each own subdomain that has boundary dofs."""
    robin, of, deformed = stage.direction.robin, beside.of, beside.deformed
    start = deformed(scattered(stage.space.link.boundary_number))
    matrices = of.lanczos(start, lambda x: robin(x[None])[0], lambda kx: deformed(stage.solve(kx[None])[0]), STEPS)
    # of eigenvalues 1/(1 + σ)
    before, now = (1 / np.clip(np.linalg.eigvalsh(matrices[:, :n, :n])[:, -1], LEAST, 1 - LEAST) - 1 for n in (STEPS - BACK, STEPS))
    return SAFE * np.maximum(now * np.minimum(now / before, 1.0) ** 2, LEAST)
