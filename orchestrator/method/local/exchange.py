"""Local stage on perfect interfaces: ŵ continuous, f̂ balanced (paper, eqs. 7 and 10).

For a search direction k⁺ on each side,

    ŵ = (k⁺ + k⁺')⁻¹ (k⁺ w + k⁺' w' − f − f'),      f̂ = f − k⁺(w − ŵ),      s = f̂ + k⁻ŵ

Three choices of k⁺:

- ``exchange``: the neighbour's sole. Then s = k⁻ w' − f' and nothing is factorised: the two-sided
  optimised Schwarz method. With symmetric soles it is the same as ``full``.
- ``full``: one's own sole, k⁺ = k⁻; a factorisation per interface.
- ``diagonal``: its diagonal, which makes the stage pointwise, as the paper does.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.search_direction import SearchDirection, conditioning, factorised
from orchestrator.method.local.state import LocalState


class Exchange:
    """Local stage of perfect interfaces.

    Parameters
    ----------
    direction : search direction k⁻
    kplus : "exchange", "full" or "diagonal"
    """

    def __init__(self, direction: SearchDirection, kplus: str = "exchange"):
        self.direction, self.kplus = direction, kplus

    def __call__(self, w: np.ndarray, f: np.ndarray) -> LocalState:
        """Next state s = f̂ + k⁻ŵ from the traces (D, T) of the linear stage."""
        if self.kplus == "exchange":
            return LocalState(self.state(*self.direction.space.extended(w, f)))
        w_hat, f_hat = self.hats(w, f)
        k_hat = self.direction.k @ w_hat
        return LocalState(f_hat + k_hat, (w_hat, f_hat, k_hat))

    def state(self, w: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(D, T) s = k⁻ w' − f' of ``exchange``, from traces with ghosts (D + G, T)."""
        partner = self.direction.space.partner
        return self.direction.k @ w[partner] - f[partner]

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (D, T)."""
        k, solve = self._factors
        kw = k @ w - f
        w_hat = solve(kw + self.direction.space.swapped(kw))
        return w_hat, f - k @ (w - w_hat)

    def lumped_hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂ for the diagonal of k⁻ in the place of k⁺: no factorisation."""
        k, theirs = self.direction.diagonal[:, None], self.direction.other.diagonal()[:, None]
        kw = k * w - f
        w_hat = (kw + self.direction.space.swapped(kw)) / (k + theirs)
        return w_hat, f - k * (w - w_hat)

    def counts(self, local: LocalState) -> dict[str, int]:
        """Nothing to count: perfect interfaces have one status."""
        return {}

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺); both 1 but for the diagonal."""
        if self.kplus != "diagonal":
            return 1.0, 1.0
        root = 1 / np.sqrt(self.direction.diagonal)
        return conditioning(self.direction.k, lambda x: root * x)

    @cached_property
    def _factors(self):
        """k⁺ of this side, (D, D), and a solver of the sum of both sides'."""
        k, other = self.direction.k, self.direction.other
        if self.kplus == "exchange":
            k, other = other, k
        elif self.kplus == "diagonal":
            k, other = (sp.csr_array(sp.diags_array(x.diagonal())) for x in (k, other))
        return k, factorised(sp.csr_array(k + other))
