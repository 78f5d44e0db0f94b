"""Local stage on perfect interfaces: ŵ continuous, f̂ balanced (paper, eq. 7 and eq. 10).

For a search direction k⁺ on each side,

    ŵ = (k⁺ + k⁺')⁻¹ (k⁺ w + k⁺' w' − f − f'),      f̂ = f − k⁺(w − ŵ),      s = f̂ + k⁻ŵ

Three choices of k⁺:

- ``exchange``: the neighbour's sole. Then s = k⁻ w' − f' and nothing is factorised: the two-sided
  optimised Schwarz method. With symmetric soles it is the same as ``full``.
- ``full``: one's own sole, k⁺ = k⁻; a factorisation per interface.
- ``diagonal``: its diagonal, which makes the stage pointwise, as the paper does.

Where nodes do not match there is no exchange, and k⁺ = k⁻ whatever is chosen: ŵ are the traces without jump that are
``Nearest``, f̂ = −Bᵀ q. Where nodes match and both sides have the same sole that is the exchange.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import Factor
from orchestrator.method.interface.rows import joined, times
from orchestrator.method.interface.search_direction import Nearest, SearchDirection, conditioning
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState


class Exchange:
    """Local stage of perfect interfaces.

    direction : search direction k⁻
    kplus : "exchange", "full" or "diagonal"
    """

    def __init__(self, direction: SearchDirection, kplus: str = "exchange"):
        self.direction, self.kplus, transfer = direction, kplus, direction.space.transfer
        self._apart = [i for i in np.flatnonzero(transfer.perfect & ~transfer.matched) if len(transfer.sides[i][0])]
        self._held = None if transfer.picks else direction.space.held_everywhere  # all ranks ask

    def __call__(self, fields: Admissible) -> LocalState:
        """Next state s = f̂ + k⁻ŵ from the traces of the linear stage."""
        if self.kplus == "exchange":
            return LocalState(self.exchanged(*fields.extended)[0])
        w_hat, f_hat = self.hats(*fields.extended)
        k_hat = self.direction.times(w_hat)
        return LocalState(f_hat + k_hat, (w_hat, f_hat, k_hat))

    def exchanged(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(T, D) s = k⁻ w' − f' of ``exchange``, w' and f', from traces with ghosts (T, D + G).

        Where nodes do not match w' = 2ŵ − w, f' = f − 2f̂, as they are elsewhere.
        """
        across = self.direction.space.transfer.across
        w_other, f_other = across(w), across(f)
        s = self.direction.times(w_other) - f_other
        if self._apart:
            at, s[:, at], w_hat, f_hat = self._nearest_to(w, f)
            w_other[:, at], f_other[:, at] = 2 * w_hat - w[:, at], f[:, at] - 2 * f_hat
        return s, w_other, f_other

    def hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂, each (T, D), eq. 10, from traces with ghosts (T, D + G)."""
        k, other, solve = self._factors
        own_w, own_f = (x[:, : k.shape[0]] for x in (w, f))
        across = self.direction.space.transfer.across
        w_hat = solve(times(k, own_w) - own_f + times(other, across(w)) - across(f))
        return self._with_apart(w, f, w_hat, own_f - times(k, own_w - w_hat))

    def lumped_hats(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ and f̂ for the diagonal of k⁻ in the place of k⁺: no factorisation; parameters as of ``hats``."""
        k, across = self.direction.diagonal, self.direction.space.transfer.across
        own_w, own_f = w[:, : len(k)], f[:, : len(k)]
        kw = self.direction.whole_diagonal * w - f
        w_hat = (kw[:, : len(k)] + across(kw)) / (k + across(self.direction.whole_diagonal))
        return self._with_apart(w, f, w_hat, own_f - k * (own_w - w_hat))

    def _with_apart(self, w: np.ndarray, f: np.ndarray, w_hat: np.ndarray, f_hat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same with what belongs to interfaces whose nodes do not match."""
        if self._apart:
            at, _, w_hat[:, at], f_hat[:, at] = self._nearest_to(w, f)
        return w_hat, f_hat

    def _nearest_to(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, ...]:
        """This rank's trace dofs of interfaces whose nodes do not match, and s, ŵ and f̂ there."""
        dofs, nearest = self._nearest
        own = dofs < self.direction.space.size
        move, f_hat = nearest.moves(w[:, dofs], f[:, dofs])
        w_hat = w[:, dofs] + move
        return dofs[own], *(x[:, own] for x in (f_hat + times(nearest.k, w_hat), w_hat, f_hat))

    @cached_property
    def _nearest(self) -> tuple[np.ndarray, Nearest]:
        """Trace dofs of interfaces whose nodes do not match, ghosts included, and their problem."""
        transfer = self.direction.space.transfer
        dofs = joined([side for i in self._apart for side in transfer.sides[i]])
        points = joined([np.arange(transfer.bounds[i], transfer.bounds[i + 1]) for i in self._apart])
        return dofs, Nearest(sp.csr_array(self.direction.whole[dofs][:, dofs]), sp.csr_array(transfer.B[points][:, dofs]), self._held[dofs])

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
        """k⁺ of this side and of the other, seen from here, (D, D) each, and a solver of their sum."""
        k, other = self.direction.k, self.direction.other
        if self.kplus == "exchange":
            k, other = other, k
        elif self.kplus == "diagonal":
            k, other = (sp.csr_array(sp.diags_array(x.diagonal())) for x in (k, other))
        if self.kplus != "diagonal" and not (k - other).count_nonzero():  # symmetric soles: one factorisation serves both
            return k, other, lambda rows: 0.5 * self.direction.solve(rows)
        return k, other, Factor(sp.csr_array(k + other), patches=True)
