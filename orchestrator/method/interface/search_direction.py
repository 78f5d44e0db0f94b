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

from orchestrator.blackbox.models import sole_model, sole_models
from orchestrator.blackbox.protocol import Model
from orchestrator.method.sparse.symmetric import factorise, Solve
from orchestrator.method.interface.rows import eigenvalue, placed, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.ring import Ring


class SearchDirection:
    """k⁻ on all trace dofs.

    whole : (D + G, D + G) sparse, symmetric positive definite, one block per interface and side,
        ghosts included
    space : numbering

    k : (D, D) the part without ghosts
    diagonal, whole_diagonal : their diagonals, (D,) and (D + G,)
    """

    def __init__(self, whole: sp.csr_array, space: TraceSpace):
        self.whole, self.space, d = whole, space, space.size
        # own rows come first and meet no ghosts: the same numbers, not a copy
        own = whole.indptr[d]
        self.k = sp.csr_array((whole.data[:own], whole.indices[:own], whole.indptr[: d + 1]),
                              shape=(d, d))
        self.whole_diagonal = whole.diagonal()
        self.diagonal = self.whole_diagonal[:d]

    def scaled(self, factors: np.ndarray) -> SearchDirection:
        """The search direction of soles whose moduli are multiplied by factors (interfaces of the
        scene,).
        """
        each = np.ones(self.whole.shape[0])
        for factor, sides in zip(factors, self.space.sides):
            for dofs in sides:
                each[dofs] = factor
        # no entry couples two interfaces
        return SearchDirection(sp.diags_array(each) @ self.whole, self.space)

    @cached_property
    def solve(self) -> Solve:
        """k⁻¹ applied to rows (T, D), by a factorisation made at the first call."""
        return factorise(self.k, patches=True)

    def times(self, w: np.ndarray) -> np.ndarray:
        """(T, D) k⁻ w."""
        return times(self.k, w)

    def robin(self, u: np.ndarray) -> np.ndarray:
        """(T, B) NᵀkN u of boundary displacements (T, B): forces of what the soles add to the
        stiffness there.
        """
        return self.space.loads(self.times(self.space.trace(u)))

    def robin_blocks(self, subdomains: Sequence[int]) -> list[sp.csr_array]:
        """(t, t) NᵀkN on the boundary dofs of each of these, numbered as they are in
        ``space.subdomains``.
        """
        rows, whole = self.space.scatter, self.k  # no entry couples two subdomains
        if len(subdomains) and not self.space.by_nodes:
            whole = rows @ whole @ rows.T
        return [whole[part, part] for part in (self.space.boundary[e] for e in subdomains)]

    @cached_property
    def other(self) -> sp.csr_array:
        """(D, D) the neighbour's k⁻, seen from this side."""
        return self.space.transfer.seen_across(self.whole)


Request = tuple[Model, np.ndarray, list[np.ndarray]]


def sole_requests(scene: Scene, space: TraceSpace, soles) -> list[Request]:
    """Return models of the soles, which components of their nodes are free, and which trace dofs
    these are.

    soles : of both sides of interfaces, or rings of this rank's subdomains
    """
    return _of_rings(scene, space, soles) if space.by_nodes else _of_sides(scene, space, soles)


def placed_soles(space: TraceSpace, requests: Sequence[Request],
                 found: Sequence[sp.csr_array]) -> SearchDirection:
    """Place the soles' stiffness on the trace dofs: k⁻ of eq. 13.

    found : per request, the stiffness (3n, 3n) that the black box has assembled
    """
    different, numbers, slots = {}, [], []
    for stiffness, (_, free, own) in zip(found, requests):
        key = id(stiffness), free.tobytes()  # congruent soles share theirs; outer nodes are clamped
        number = different.setdefault(key, (len(different), stiffness, np.flatnonzero(free)))[0]
        numbers += [number] * len(own)
        slots += own
    blocks = [stiffness[chosen][:, chosen] for _, stiffness, chosen in different.values()]
    return SearchDirection(placed([blocks[number] for number in numbers], slots, len(space.owner)),
                           space)


def _of_sides(scene: Scene, space: TraceSpace, soles) -> list[Request]:
    """``sole_requests`` of interfaces."""
    return [(model, scene.interfaces[index].traced(side), list(
        space.sides[index] if soles[index][0] is soles[index][1]
        else [space.sides[index][side]]))
        for model, (index, side) in sole_models(scene, soles)]


def _of_rings(scene: Scene, space: TraceSpace, rings: Sequence[Ring]) -> list[Request]:
    """``sole_requests`` of rings."""
    own = zip((scene.subdomains[e] for e in space.subdomains), rings, space.boundary)
    return [(sole_model(f"ring of {s.name}", scene.mesh.nodes[s.nodes[ring.nodes]], ring, s.code),
             ~s.fixed[ring.nodes], [np.arange(part.start, part.stop)])
            for s, ring, part in own if len(ring.cells)]


class Nearest:
    """Traces without jump that are nearest to given ones, on interfaces that do not couple:

        min ½ ‖ŵ − w‖²_k + fᵀŵ   where   B ŵ = 0

    What is prescribed stays what it is. One sparse factorisation, in which no side is to be
    inverted and no mesh need be the finer one,

        [k  Bᵀ] [ŵ − w]   [ −f ]
        [B  0 ] [  q  ] = [−B w]

    k : (n, n) sparse, stiffness of both sides' soles
    B : (Q, n) sparse
    held : (n,) bool, what is prescribed
    """

    def __init__(self, k: sp.csr_array, B: sp.csr_array, held: np.ndarray):
        self.k, self.B, self.free = k, B, np.flatnonzero(~held)
        # forces in units of displacements: pivots are compared with each other
        self.unit = float(k.diagonal().mean())
        inside, across = k[self.free][:, self.free] / self.unit, B[:, self.free]
        self.factor = sla.splu(sp.csc_array(sp.block_array([[inside, across.T], [across, None]])))

    def moves(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ŵ − w and f̂ = −Bᵀq, (T, n) each, of traces (T, n) and forces; f̂ = f + k(ŵ − w) but for
        what is prescribed.
        """
        right = np.hstack([-f[:, self.free] / self.unit, -times(self.B, w)])
        found = self.factor.solve(np.ascontiguousarray(right.T))
        move = np.zeros_like(w)
        move[:, self.free] = found[: len(self.free)].T
        return move, -self.unit * times(self.B.T, np.ascontiguousarray(found[len(self.free):].T))


def conditioning(k: sp.csr_array, root: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Extreme eigenvalues λ of k⁻ x = λ k⁺ x, to about one per cent.

    The fixed point is stable for relaxations α < 2/(1 + max(λ_max, 1/λ_min)) or so.

    k : (D, D) k⁻
    root : applies (k⁺)^-½ to (D,)
    """
    if k.shape[0] < 3:
        return 1.0, 1.0
    low, high = (eigenvalue(lambda x: root(k @ root(np.ravel(x))), k.shape[0], end)
                 for end in ("SA", "LA"))
    return low, high
