"""Where several interfaces meet at a node: forces of its pairs that no body feels, set up once.

A body feels the sum of what the interfaces do to a node of its own. Where three bodies meet at an edge, a force that goes
from the first to the second, on to the third and back to the first leaves every sum as it is; where a body is between two
whose nodes are prescribed, so does a force that passes through it. Pairs q that hang together by their nodes are a *group*,
and with one row for each component of each node that is free, +1 where it is on side 1 of the pair and −1 on side 2,

    rows · δq = 0,    δq = G λ

are its states of *self-stress*, r of them, from the singular vectors of the rows. Groups of the same shape share G.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.linalg import svd

HELD, NONE = -1, -2  # in place of a number: prescribed; neither side is free
RANK = 1e-9  # singular value of rows of 0, 1 and −1 that is none


@dataclass
class Groups:
    """Groups of the same number of pairs and of states of self-stress.

    slots : (n, m) int, the pairs of each group on this rank; −1 where another knows it
    states : (n, m, 3, r) G
    shared : (n,) bool, several ranks have bodies there, and all have these groups, in the same order
    """

    slots: np.ndarray
    states: np.ndarray
    shared: np.ndarray


def node_loops(space: TraceSpace, pairs: Pairs) -> list[Groups]:
    """The groups that have self-stress, of interfaces whose laws do not join their sides; nodes match everywhere."""
    opens = np.repeat([not i.law.joins for i in pairs.interfaces], np.diff(pairs.bounds)).astype(bool)
    pairs_here, (interface, position, number, rank) = np.flatnonzero(opens), _everyones(space, pairs, opens)
    if not len(interface):
        return []
    group = _groups(number)
    here = np.full(len(group), -1)
    index = np.array([i.index for i in pairs.interfaces], dtype=int)
    at = np.repeat(np.arange(len(index)), np.diff(pairs.bounds))[pairs_here]
    stride = int(position.max()) + 1
    here[np.searchsorted(interface * stride + position, index[at] * stride + pairs_here - pairs.bounds[at])] = pairs_here
    order = np.argsort(group, kind="stable")
    start, counts = np.unique(group[order], return_index=True, return_counts=True)[1:]
    result = []
    for m in range(2, int(counts.max()) + 1):
        members = order[start[counts == m, None] + np.arange(m)]
        shared = (rank[members] != rank[members[:, :1], :1]).any(axis=(1, 2)) if len(members) else np.zeros(0, bool)
        kept = shared | (here[members] >= 0).any(axis=1)
        result += _of_size(members[kept], number, here, shared[kept])
    return result


def _everyones(space: TraceSpace, pairs: Pairs, opens: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of all ranks' pairs, by interface and position: these (Q,) each, numbers (Q, 2, 3) of the boundary dofs of both sides,
    and the ranks (Q, 2) of these."""
    free = pairs.free[:, opens].T
    interface = np.repeat([i.index for i in pairs.interfaces], np.diff(pairs.bounds)).astype(int)[opens]
    position = (np.arange(len(opens)) - np.repeat(pairs.bounds[:-1], np.diff(pairs.bounds)))[opens]
    number = np.full(space.size + 1, NONE)
    number[:-1] = space.link.boundary_number[space.gather] if len(space.link.boundary_number) else HELD
    number[space.held] = HELD
    tables = []
    for side, dofs in enumerate((pairs.transfer.one, pairs.transfer.two)):
        dofs = dofs[:, opens].T
        own = (free & (dofs < space.size)).any(axis=1)
        found = np.where(free, number[np.minimum(dofs, space.size)], NONE)[own]
        head = np.column_stack([interface[own], position[own], np.full((own.sum(), 1), side), np.full((own.sum(), 1), space.team.rank)])
        tables.append(np.hstack([head, found]))
    table = np.concatenate(sum(space.team.all_gather(tables), []))
    table = table[np.lexsort(table[:, 2::-1].T)].reshape(-1, 2, 7)
    return table[:, 0, 0], table[:, 0, 1], table[:, :, 4:], table[:, :, 3]


def _groups(number: np.ndarray) -> np.ndarray:
    """(Q,) the group of each pair: those that share a dof of a body hang together."""
    count = len(number)
    pair, dof = np.repeat(np.arange(count), 6), number.reshape(-1)
    known, dof = dof >= 0, dof + count
    size = count + int(number.max(initial=0)) + 1
    graph = sp.coo_array((np.ones(known.sum()), (pair[known], dof[known])), shape=(size, size))
    return connected_components(graph, directed=False)[1][:count]


def _of_size(members: np.ndarray, number: np.ndarray, here: np.ndarray, shared: np.ndarray) -> list[Groups]:
    """Groups (n, m) of m pairs each, by the number of their states."""
    if not len(members):
        return []
    n, m = members.shape
    numbers = number[members].reshape(n, -1)
    order = np.argsort(numbers, axis=1, kind="stable")
    ascending = np.take_along_axis(numbers, order, axis=1)
    label = np.zeros_like(numbers)
    np.put_along_axis(label, order, np.cumsum(np.diff(ascending, axis=1, prepend=ascending[:, :1]) > 0, axis=1), axis=1)
    shapes, shape = np.unique(np.where(numbers < 0, numbers, label), axis=0, return_inverse=True)
    states = [_states(each.reshape(m, 2, 3)) for each in shapes]
    width = np.array([s.shape[2] for s in states])[shape.reshape(-1)]
    return [Groups(here[members[width == r]], np.stack([states[s] for s in shape.reshape(-1)[width == r]]), shared[width == r])
            for r in np.unique(width[width > 0])]


def _states(label: np.ndarray) -> np.ndarray:
    """(m, 3, r) G of a group whose dofs (m, 2, 3) have these labels."""
    m = len(label)
    rows = np.zeros((int(label.max(initial=-1)) + 1, m, 3))
    for side, sign in ((0, 1.0), (1, -1.0)):
        pair, component = np.nonzero(label[:, side] >= 0)
        np.add.at(rows, (label[pair, side, component], pair, component), sign)
    nothing = np.eye(3 * m)[(label == NONE).all(axis=1).reshape(-1)]
    size, vectors = svd(np.vstack([rows.reshape(len(rows), -1), nothing]))[1:]
    return vectors[int((size > RANK).sum()):].T.reshape(m, 3, -1)
