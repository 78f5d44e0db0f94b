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

import numpy as np
import scipy.sparse as sp

from orchestrator.method.local.state import LocalState
from orchestrator.method.interface.search_direction import SearchDirection, conditioning, factorised


class PerfectInterfaces:
    """Local stage for interfaces that are all perfect.

    Parameters
    ----------
    direction : search direction k⁻
    kplus : "exchange", "full" or "diagonal"
    """

    def __init__(self, direction: SearchDirection, kplus: str):
        self.direction, self.kplus = direction, kplus
        if kplus == "exchange":
            self.k, self.k_other = direction.other, direction.k
        elif kplus == "full":
            self.k, self.k_other = direction.k, direction.other
        else:
            self.k, self.k_other = (sp.csr_array(sp.diags_array(k.diagonal())) for k in (direction.k, direction.other))
        self._sum_solve = None

    def __call__(self, w: np.ndarray, f: np.ndarray) -> LocalState:
        """Next state s = f̂ + k⁻ŵ from the traces (D, T) of the linear stage."""
        if self.kplus == "exchange":
            # the neighbour forms k w' − f', with our k: one message brings it
            return LocalState(self.direction.space.swapped(self.k @ w - f))
        w_hat, f_hat = self.hats(w, f)
        k_hat = self.direction.k @ w_hat
        return LocalState(f_hat + k_hat, (w_hat, f_hat, k_hat))

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (D, T)."""
        if self._sum_solve is None:
            self._sum_solve = factorised(sp.csr_array(self.k + self.k_other))
        kw = self.k @ w - f
        w_hat = self._sum_solve(kw + self.direction.space.swapped(kw))
        return w_hat, f - self.k @ (w - w_hat)

    def conditioning(self) -> tuple[float, float]:
        """Extreme eigenvalues of (k⁻, k⁺); both 1 but for the diagonal."""
        if self.kplus != "diagonal":
            return 1.0, 1.0
        root = 1 / np.sqrt(self.direction.diagonal)
        return conditioning(self.direction.k, lambda x: root * x)

    def lumped_hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂ for the diagonal of k⁻ in the place of k⁺: no factorisation."""
        k, theirs = self.direction.diagonal[:, None], self.direction.other.diagonal()[:, None]
        kw = k * w - f
        w_hat = (kw + self.direction.space.swapped(kw)) / (k + theirs)
        return w_hat, f - k * (w - w_hat)
