"""Local stage on perfect interfaces: ŵ continuous, f̂ balanced (paper, eq. 7 and eq. 10).

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

from orchestrator.method.interface.factor import Factor
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.search_direction import SearchDirection, conditioning
from orchestrator.method.linear.stage import Admissible
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

    def __call__(self, fields: Admissible) -> LocalState:
        """Next state s = f̂ + k⁻ŵ from the traces of the linear stage."""
        w, f = fields.w, fields.f
        if self.kplus == "exchange":
            return LocalState(self.exchanged(*fields.extended)[0])
        w_hat, f_hat = self.hats(w, f)
        k_hat = self.direction.times(w_hat)
        return LocalState(f_hat + k_hat, (w_hat, f_hat, k_hat))

    def exchanged(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(T, D) s = k⁻ w' − f' of ``exchange``, w' and f', from traces with ghosts (T, D + G)."""
        across = self.direction.space.transfer.across
        w, f = across(w), across(f)
        return self.direction.times(w) - f, w, f

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (T, D), eq. 10."""
        k, solve = self._factors
        kw = times(k, w) - f
        w_hat = solve(kw + self.direction.space.across(kw))
        return w_hat, f - times(k, w - w_hat)

    def lumped_hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂ for the diagonal of k⁻ in the place of k⁺: no factorisation."""
        k, theirs = self.direction.diagonal, self.direction.other_diagonal
        kw = k * w - f
        w_hat = (kw + self.direction.space.across(kw)) / (k + theirs)
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
        return k, Factor(sp.csr_array(k + other))
