"""Points of laws, and the nodes of bodies that they meet at.

A body has a trace at a node for each of its interfaces there, and feels the sum of their forces
alone. With N the sums over the traces of a body's node, and k⁺ of each trace,

    f_b = N f,    C = (N k⁺ Nᵀ)⁻¹,    d = B Nᵀ (w_b − C f_b) − S q,    S = B Nᵀ C N Bᵀ

are the jumps d of points under their forces q. C is zero where a support holds a component, which
no force moves. Of the nodes of other ranks' bodies a rank knows B
alone; what they lack, ``node_visits`` brings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.answering import LawPoints
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.point_traces import inverses
from orchestrator.method.interface.rows import rows_of
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.scene.mesh.faces import components


@dataclass(frozen=True)
class NodePoints:
    """Points, and nodes of bodies, by names that are the same on all ranks.

    point : (P, 2) int, interface and number there; node : (M, 3) int, subdomain, trace, and 0 where
        traces join
    place : (P,) int, which of the rank's pairs each is
    B : (3P, 3M) B Nᵀ, component after component of the points, node after node
    C : (M, 3, 3) compliance of the nodes, zero where another rank knows it
    own : (M,) bool, nodes of this rank's bodies
    mine : (P,) bool, points that this rank tells others of
    apart : (P,) bool, points where S is not 1/keq though no other shares their nodes: of interfaces
        whose nodes do not match, and where a support holds one side in a component that is free
    between : (P,) bool, points of interfaces between ranks
    laws : what the points answer
    slid : (3, P) what B w lacks of their jumps
    """

    point: np.ndarray
    node: np.ndarray
    place: np.ndarray
    B: sp.csr_array
    C: np.ndarray
    own: np.ndarray
    mine: np.ndarray
    apart: np.ndarray
    between: np.ndarray
    laws: LawPoints
    slid: np.ndarray

    @classmethod
    def of(cls, space: TraceSpace, pairs: Pairs) -> tuple[NodePoints, sp.csr_array]:
        """Return what a rank knows, of laws that answer pair by pair, and N (3M, D) of its own
        nodes; all ranks ask.
        """
        number, dofs, blocks, name = _nodes(space, pairs)
        there, M = dofs >= 0, len(name)
        row = (3 * number[:, None] + np.arange(3))[there]
        N = sp.csr_array((np.ones(len(row)), (row, dofs[there])),
                         shape=(3 * M, pairs.transfer.total))
        own = np.isin(name[:, 0], space.subdomains)
        K, held = np.zeros((M, 3, 3)), np.zeros((M, 3), bool)
        np.add.at(K, number, inverses(blocks, np.einsum("nii->ni", blocks) > 0))
        held.flat[row] = space.held_everywhere[dofs[there]]
        C = np.where(own[:, None, None],
                     inverses(K, (np.einsum("nii->ni", K) > 0) & ~held), 0.0)
        counts = np.diff(pairs.bounds)

        def each(values: list, kind: type) -> np.ndarray:
            return np.repeat(np.array(values, dtype=kind), counts)

        here = set(space.subdomains)
        point = np.column_stack([each([i.index for i in pairs.interfaces], int),
                                 np.arange(len(pairs)) - np.repeat(pairs.bounds[:-1], counts)])
        place = np.flatnonzero(each([i.law.pairwise for i in pairs.interfaces], bool))
        B = sp.csr_array(pairs.transfer.B @ N.T)[rows_of(place, len(pairs))]
        one_sided = (abs(B) @ held.ravel()).reshape(3, -1).any(axis=0)
        apart = each([i.mortar is not None for i in pairs.interfaces], bool)
        apart[place] |= one_sided
        between = each([not here.issuperset(i.subdomains) for i in pairs.interfaces], bool)
        flags = pairs.mine, apart, between
        slid = np.zeros((3, len(place))) if pairs.slid is None else pairs.slid[:, place]
        sums = sp.csr_array(N[:, : space.size])
        return cls(point[place], name, place, sp.csr_array(B), C, own, *(x[place] for x in flags),
                   pairs.alone(place), slid), sums

    def some(self, points: np.ndarray) -> NodePoints:
        """Return some of the points (Q,) int, ascending, with the nodes that they reach."""
        B = sp.csr_array(self.B[rows_of(points, len(self.point))])
        nodes = np.unique(B.indices // 3)
        return replace(self, node=self.node[nodes], own=self.own[nodes], C=self.C[nodes],
                       B=sp.csr_array(B[:, nodewise(nodes)]), point=self.point[points],
                       place=self.place[points],
                       mine=self.mine[points], apart=self.apart[points],
                       between=self.between[points],
                       laws=self.laws.alone(points), slid=self.slid[:, points])


def labelled(B: sp.csr_array, gives: np.ndarray) -> np.ndarray:
    """Return groups (P,) int of points that B (3P, 3M) joins, by way of nodes (M,) bool that give
    way.
    """
    P, M = B.shape[0] // 3, B.shape[1] // 3
    i, j = (x.astype(int) for x in B.tocoo().coords)
    i, j = i % max(P, 1), j // 3
    i, j = i[gives[j]], j[gives[j]]
    return components(i, P + j, P + M)[1][:P]


def nodewise(nodes: np.ndarray) -> np.ndarray:
    """Return (3m,) int, the components of nodes (m,), node after node."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _nodes(space: TraceSpace, pairs: Pairs) -> tuple[np.ndarray, ...]:
    """Of the traces' nodes (n,) which of the bodies' nodes, dofs (n, 3), C (n, 3, 3); names (M, 3)
    of the bodies' nodes.

    Traces of a law that answers for all of its points stay alone.
    """
    joins = np.zeros(pairs.transfer.total)
    for i in pairs.interfaces:
        for side in pairs.transfer.sides[i.index] if i.law.pairwise else ():
            joins[side] = 1.0
    node, trace = space.extended(np.stack([space.dof // 3, np.arange(space.size)]).astype(float))[
        0].astype(int)
    nodes = pairs.nodes
    kept = nodes.dofs.max(axis=1, initial=-1) >= 0
    dofs, blocks = nodes.dofs[kept], nodes.blocks[kept]
    first = dofs.max(axis=1, initial=-1)
    alone = joins[first] == 0
    key = np.column_stack([space.owner[first], np.where(alone, trace[first], node[first]), alone])
    name, number = np.unique(key, axis=0, return_inverse=True)
    return number.ravel(), dofs, blocks, name.reshape(-1, 3)
