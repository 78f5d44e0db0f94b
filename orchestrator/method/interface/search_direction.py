"""Search directions: the soles' stiffness k⁻ of the linear stage, and its companions k⁺.

k⁻ comes from the black box: it assembles the soles as plain matter, and clamping their outer
nodes leaves the rows and columns of the interface (paper, remark 2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.blackbox.models.assembly import assembled, cut
from orchestrator.blackbox.models.extended import both_alike, sole_models
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.interface.factor import Factor
from orchestrator.method.interface.placed import placed
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.ties import traced
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.savings import Savings
from orchestrator.scene.model import Scene


class SearchDirection:
    """k⁻ on all trace dofs.

    Parameters
    ----------
    whole : (D + G, D + G) sparse, symmetric positive definite, one block per interface and side, ghosts included
    space : numbering

    Attributes
    ----------
    k : (D, D) the part without ghosts
    """

    def __init__(self, whole: sp.csr_array, space: TraceSpace):
        self.whole, self.space = whole, space
        d = space.size
        # own rows come first and meet no ghosts: the same numbers, not a copy
        own = whole.indptr[d]
        self.k = whole if whole.shape[0] == d else sp.csr_array(
            (whole.data[:own], whole.indices[:own], whole.indptr[: d + 1]), shape=(d, d))
        self.diagonal = self.k.diagonal()

    def scaled(self, factors: np.ndarray) -> SearchDirection:
        """That of soles whose moduli are multiplied by factors (interfaces of the scene,)."""
        each = np.ones(self.whole.shape[0])
        for factor, sides in zip(factors, self.space.sides):
            for dofs in sides:
                each[dofs] = factor
        # no entry couples two interfaces
        return SearchDirection(sp.csr_array((self.whole.data * np.repeat(each, np.diff(self.whole.indptr)), self.whole.indices,
                                             self.whole.indptr), shape=self.whole.shape), self.space)

    @cached_property
    def solve(self):
        """k⁻¹ applied to rows (T, D), by a factorisation made at the first call."""
        return Factor(self.k, patches=True)

    def times(self, w: np.ndarray) -> np.ndarray:
        """(T, D) k⁻ w."""
        return times(self.k, w)

    def robin(self, u: np.ndarray) -> np.ndarray:
        """(T, B) NᵀkN u of boundary displacements (T, B): forces of what the soles add to the stiffness there."""
        return self.space.loads(self.times(self.space.trace(u)))

    def robin_blocks(self, subdomains: Sequence[int]) -> list[sp.csr_array]:
        """(t, t) NᵀkN on the boundary dofs of each of these, numbered as they are in ``space.subdomains``.

        Formed for all at once: no entry couples two subdomains.
        """
        parts = [self.space.boundary[e] for e in subdomains]
        if not parts:
            return []
        rows, k, starts = self.space.scatter, self.k, [part.start for part in parts]
        if sum(part.stop - part.start for part in parts) < rows.shape[0]:
            starts = np.cumsum([0] + [part.stop - part.start for part in parts]).tolist()
            rows = sp.csr_array(rows[np.concatenate([np.arange(part.start, part.stop) for part in parts])])
            own = np.unique(rows.indices)
            rows, k = rows[:, own], k[own][:, own]
        all_of_them = sp.csr_array(rows @ k @ rows.T)
        ends, blocks = all_of_them.indptr, []
        for part, first in zip(parts, starts):
            last = first + part.stop - part.start
            entries = slice(ends[first], ends[last])
            blocks.append(sp.csr_array((all_of_them.data[entries], all_of_them.indices[entries] - first,
                                        ends[first : last + 1] - ends[first]), shape=(last - first,) * 2))
        return blocks

    @cached_property
    def whole_diagonal(self) -> np.ndarray:
        """(D + G,) the diagonal of k⁻, ghosts included."""
        return self.diagonal if self.whole is self.k else self.whole.diagonal()

    @cached_property
    def other_diagonal(self) -> np.ndarray:
        """(D,) the diagonal of the neighbour's k⁻, seen from this side."""
        return self.space.transfer.across(self.whole_diagonal)

    @cached_property
    def other(self) -> sp.csr_array:
        """(D, D) the neighbour's k⁻, seen from this side."""
        return self.space.transfer.seen_across(self.whole)


def assemble_search_direction(scene: Scene, space: TraceSpace, soles, blackbox: BlackBox, workers: int,
                              share: bool, savings: Savings) -> SearchDirection:
    """Have the black box assemble every sole and place the results on the trace dofs: k⁻ of eq. 13.

    Parameters
    ----------
    share : congruent soles are assembled once

    Raises
    ------
    BlackBoxError : from the code
    """
    requests = sole_models(scene, soles)
    found, different, numbers, slots = assembled([model for model, _ in requests], blackbox, workers, share, savings), {}, [], []
    for stiffness, (_, (index, side)) in zip(found, requests):
        free = traced(scene.interfaces[index], side).ravel()
        key = id(stiffness), free.tobytes()  # congruent soles share their stiffness
        if key not in different:
            different[key] = len(different), stiffness, np.flatnonzero(free)  # the outer nodes are clamped
        both = both_alike(scene, index, soles[index])
        for slot in space.sides[index] if both else (space.sides[index][side],):
            numbers.append(different[key][0])
            slots.append(slot)
    blocks = cut([stiffness for _, stiffness, _ in different.values()], [chosen for *_, chosen in different.values()])
    k = placed([blocks[number] for number in numbers], slots, len(space.owner))
    if space.ties is not None:
        k = sp.csr_array(space.ties.inverse.T @ k @ space.ties.inverse)
    return SearchDirection(k, space)


def conditioning(k: sp.csr_array, root: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Extreme eigenvalues λ of k⁻ x = λ k⁺ x, to about one per cent.

    Parameters
    ----------
    k : (D, D) k⁻
    root : applies (k⁺)^-½ to (D,)

    Notes
    -----
    The fixed point is stable for relaxations α < 2/(1 + max(λ_max, 1/λ_min)) or so.
    """
    if k.shape[0] < 3:
        return 1.0, 1.0
    operator = sla.LinearOperator(k.shape, matvec=lambda x: root(k @ root(np.ravel(x))), dtype=float)
    start = np.random.default_rng(0).standard_normal(k.shape[0])
    low, high = (float(sla.eigsh(operator, k=1, which=end, tol=1e-2, v0=start, maxiter=2000,
                                 return_eigenvectors=False)[0]) for end in ("SA", "LA"))
    return low, high
