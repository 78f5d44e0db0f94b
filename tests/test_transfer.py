"""Whatever crosses an interface goes through its transfer: with products in the place of index arrays, the same results."""

import numpy as np
import pytest
import scipy.sparse as sp

from contact_case import contact
from method_case import CUBES, SLICES, config, method
from orchestrator.config import config_from
from orchestrator.method.interface import pairs, traces
from orchestrator.method.interface.transfer import Matching
from orchestrator.run import solve
from orchestrator.scene.build import build_scene


class Products(Matching):
    """The transfer written as sparse G₁ and G₂, as sides with other meshes will have it."""

    used: set[str] = set()

    def _picks(self, side: np.ndarray) -> sp.csr_array:
        dofs = side.ravel()
        there = np.ones(len(dofs)) if self.exists is None else self.exists.ravel().astype(float)
        return sp.csr_array((there, (np.arange(len(dofs)), dofs)), shape=(len(dofs), self.total))

    def _both(self, name: str) -> tuple[sp.csr_array, sp.csr_array]:
        self.used.add(name)
        return self._picks(self.one), self._picks(self.two)

    def _times(self, G: sp.csr_array, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        rows = x.reshape(-1, G.shape[1])
        return (G @ rows.T).T.reshape(*x.shape[: x.ndim - 1], *shape)

    def first(self, x):
        return self._times(self._both("first")[0], x, self.one.shape)

    def second(self, x):
        return self._times(self._both("second")[1], x, self.two.shape)

    def spread(self, one, two):
        G1, G2 = self._both("spread")
        lead = one.shape[: one.ndim - self.one.ndim]
        flat = (x.reshape(-1, G1.shape[0]) for x in (one, two))
        return sum((G.T @ x.T).T for G, x in zip((G1, G2), flat)).reshape(*lead, self.total)

    def across(self, x):
        G1, G2 = self._both("across")
        return self._times((G1.T @ G2 + G2.T @ G1)[: self.size], x, (self.size,))

    def seen_across(self, matrix):
        G1, G2 = self._both("seen_across")
        turn = sp.csr_array((G1.T @ G2 + G2.T @ G1)[: self.size])
        return sp.csr_array(turn @ matrix @ turn.T)

    def rows(self, fields):
        return tuple(sp.csr_array(G @ fields) for G in self._both("rows"))

    def at_points(self, matrix):
        return tuple(sp.csr_array(G @ matrix @ G.T) for G in self._both("at_points"))

    def node_blocks(self, matrix):
        count = self.one.shape[1]
        result = []
        for G in self._both("node_blocks"):
            dense = (G @ matrix @ G.T).toarray().reshape(3, count, 3, count)
            result.append(np.einsum("ipjp->pij", dense))
        return tuple(result)

    def both_sides(self, bases, signs):
        G1, G2 = self._both("both_sides")
        fields = sp.csr_array(sp.block_diag([sp.csr_array(b) for b in bases]))
        return sp.csr_array((signs[0] * G1.T @ fields + signs[1] * G2.T @ fields)[: self.size])


@pytest.mark.parametrize("case, asked", [
    (config(**CUBES), {"first", "second", "spread", "across", "rows", "at_points", "both_sides"}),
    (config(**CUBES, **method(macro={"strategy": "none"}, search_direction={"kplus": "full"})), {"seen_across", "rows"}),
    (config(subdomains=SLICES, **method(macro={"strategy": "continuity"}, sole={"kind": "layer"})), {"seen_across"}),
    (contact(0.3), {"first", "second", "spread", "node_blocks", "across"}),
], ids=["equilibrium", "mono-scale", "continuity", "contact"])
def test_products_give_what_index_arrays_give(case, asked, monkeypatch):
    picked = solve(case, build_scene(case))
    monkeypatch.setattr(Products, "used", set())
    for module in (traces, pairs):
        monkeypatch.setattr(module, "Matching", Products)
    multiplied = solve(case, build_scene(case))
    assert asked <= Products.used, "what crosses asks the transfer"
    assert multiplied.summary["iterations"] == picked.summary["iterations"]
    size = np.abs(picked.displacement).max()
    assert np.abs(multiplied.displacement - picked.displacement).max() <= 1e-11 * size
    assert multiplied.summary["error_bound"] == pytest.approx(picked.summary["error_bound"], rel=1e-4, nan_ok=True)
    assert multiplied.summary.get("status_counts") == picked.summary.get("status_counts")
