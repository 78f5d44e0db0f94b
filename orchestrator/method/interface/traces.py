"""Numbering of interface unknowns: where every trace, on both sides of every interface, lives.

Two numberings are used throughout the method:

- *boundary dofs* (B of them): the unprescribed interface dofs of each subdomain, once per
  subdomain, subdomains one after the other (eq. 4). What travels to and from the black box.
- *trace dofs* (D of them): one per interface, side and free component. A dof of a subdomain
  that lies on several interfaces (cross point) has one trace dof for each of them.

The trace operator of eq. 1 is then a gather, ``w = u[gather]``; its transpose adds up. Where ten-node
tets are in contact, a change of basis follows (see ``ties``). A component that is prescribed on one side of an opening
interface is no unknown of its body: *held* trace dofs have no boundary dof, their displacement is ``known``, and their
force acts on the support. All fields are rows, one per load step: (T, B), (T, D).
How the two sides of an interface meet, the operators of eq. 5, is the ``transfer``'s business.

Where several ranks share a scene, each holds the part of its own subdomains: its boundary dofs, its D trace
dofs, and after those its G *ghosts*, the trace dofs of the neighbours' sides of its interfaces. ``extended``
brings the ghosts' values, point to point; fields are kept without them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import narrow, times
from orchestrator.method.interface.ties import Ties, make_ties, traced
from orchestrator.method.interface.transfer import Transfer
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.model import Scene, Subdomain


@dataclass
class TraceSpace:
    """Numbering of the interface unknowns of a scene, or of a rank's part of it.

    Parameters
    ----------
    subdomains : those numbered here, ascending
    boundary : for each, the slice of its boundary dofs
    global_dof : (B,) int, 3 * node of the scene, or of the rank's part of it, + component
    gather : (D,) int, boundary dof of each trace dof; anything where it is held
    held : (h,) int, ascending, trace dofs whose displacement is prescribed
    held_at : (h, 2) int, the subdomain of each of these, and its dof there, 3 * node + component
    dof : (D,) int, 3 * node + component of each trace dof, in the same numbering
    transfer : how the two sides of all interfaces meet, with a point for every component that is free on both
    sides : per interface of the scene, the trace dofs (below D + G) of side 1 and of side 2; empty where neither
        is of this part
    owner : (D + G,) int, subdomain of each trace dof
    perfect : per interface of the scene, whether it is perfect
    ties : mid-edge nodes tied to their corners, if there are any
    number : (D,) int, trace dofs in the numbering of the whole scene
    boundary_number : (B,) int, boundary dofs in the numbering of the whole scene
    total, subdomain_count : trace dofs and subdomains of all parts
    label : (B,) int, boundary dofs that perfect interfaces with matching nodes make one and the same
    labels : (classes,) int, ascending, what these are called in the numbering of the whole scene
    team : whom the other parts belong to
    sends, receives : per neighbouring rank, trace dofs to send and ghosts to receive
    shared : per rank that has boundary dofs of the same labels, these labels
    """

    subdomains: list[int]
    boundary: list[slice]
    global_dof: np.ndarray
    gather: np.ndarray
    transfer: Transfer
    sides: list[tuple[np.ndarray, np.ndarray]]
    owner: np.ndarray
    perfect: list[bool]
    number: np.ndarray
    boundary_number: np.ndarray
    total: int
    subdomain_count: int
    label: np.ndarray
    labels: np.ndarray
    held: np.ndarray
    held_at: np.ndarray
    dof: np.ndarray
    ties: Ties | None = None
    team: Team = ALONE
    sends: dict[int, np.ndarray] = field(default_factory=dict)
    receives: dict[int, np.ndarray] = field(default_factory=dict)
    shared: dict[int, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, sides: list[list[tuple[int, int]]], traces: list[np.ndarray]) -> "TraceSpace":
        """Number the traces.

        Parameters
        ----------
        sides : per subdomain, its (interface, side) pairs
        traces : per subdomain, its (t,) boundary dofs in local numbering, ascending
        """
        ends = np.cumsum([0] + [len(t) for t in traces])
        boundary = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]
        global_dof = [3 * s.nodes[t // 3] + t % 3 for s, t in zip(scene.subdomains, traces)]
        listed = [(e, scene.interfaces[index], side) for e, pairs in enumerate(sides) for index, side in pairs]
        free = _joined([traced(i, side) for _, i, side in listed], (0, 3)).astype(bool)
        at = np.repeat([e for e, _, _ in listed], [len(i.nodes[side]) for _, i, side in listed]).astype(int)
        nodes = _joined([i.nodes[side] for _, i, side in listed])
        dofs, owner = (3 * nodes[:, None] + np.arange(3))[free], np.broadcast_to(at[:, None], free.shape)[free]
        # all subdomains' own dofs, one after the other
        starts = np.cumsum([0] + [3 * len(s.nodes) for s in scene.subdomains])
        everywhere = starts[owner] + dofs
        fixed = _joined([s.fixed.ravel() for s in scene.subdomains]).astype(bool)[everywhere]
        place = np.zeros(starts[-1], dtype=int)
        place[_joined([start + trace for start, trace in zip(starts, traces)])] = np.arange(ends[-1])
        gather, held = place[everywhere], np.flatnonzero(fixed)
        gather[held] = 0
        held_at = np.column_stack([owner[held], dofs[held]])
        trace_dof = 3 * _joined([s.nodes for s in scene.subdomains])[everywhere // 3] + dofs % 3
        count, stop = len(dofs), np.cumsum([0] + [len(i.nodes[side]) for _, i, side in listed])
        stop = np.concatenate([[0], np.cumsum(free.sum(axis=1))])[stop]
        number = np.arange(count)
        own_sides: list[list] = [[None, None] for _ in scene.interfaces]
        for (_, interface, side), a, b in zip(listed, stop[:-1].tolist(), stop[1:].tolist()):
            own_sides[interface.index][side] = number[a:b]
        perfect = [i.law.perfect for i in scene.interfaces]
        transfer = Transfer.of(scene.interfaces, own_sides, count)
        label = _labels(transfer, perfect, gather, int(ends[-1]))
        return cls(list(range(len(sides))), boundary, _joined(global_dof), gather, transfer,
                   [tuple(s) for s in own_sides], owner, perfect, np.arange(count),
                   np.arange(ends[-1]), count, len(sides),
                   label, np.arange(label.max(initial=-1) + 1), held, held_at, trace_dof,
                   make_ties(scene, own_sides, count))

    def part(self, rank_of: np.ndarray, this: int, nodes: np.ndarray) -> "TraceSpace":
        """A rank's part of the numbering of a whole scene; the rank itself enters its ``team``.

        Parameters
        ----------
        rank_of : (subdomains,) int, the rank of each
        this : which rank
        nodes : (n,) int, ascending, the nodes of its part of the scene, in which ``global_dof`` and ``dof`` then count

        Notes
        -----
        Both sides of a message list its dofs in the order of the whole numbering: nothing has to be agreed on.
        """
        mine = np.flatnonzero(rank_of == this)
        rank = rank_of[self.owner]
        own = np.flatnonzero(rank == this)
        far = self.transfer.opposite(own)
        far = far[rank[far] != this]
        held = np.concatenate([own, far])
        place = np.full(self.size, -1)
        place[held] = np.arange(len(held))
        theirs = {int(r): far[rank[far] == r] for r in np.unique(rank[far])}
        receives = {r: place[ghosts] for r, ghosts in theirs.items()}
        met = {r: self.transfer.opposite(ghosts) for r, ghosts in theirs.items()}
        sends = {r: place[dofs[rank[dofs] == this]] for r, dofs in met.items()}
        none = np.empty(0, int)
        sides = [(place[a], place[b]) if len(a) and place[a[0]] >= 0 else (none, none) for a, b in self.sides]

        chosen = _joined([np.arange(s.start, s.stop) for s in (self.boundary[e] for e in mine)])
        ends = np.cumsum([0] + [self.boundary[e].stop - self.boundary[e].start for e in mine])
        position = np.zeros(len(self.global_dof), dtype=int)  # held trace dofs have no boundary dof to be found
        position[chosen] = np.arange(len(chosen))
        labels, label = np.unique(self.label[chosen], return_inverse=True)
        shared = {}
        rank_of_dof = np.repeat(rank_of, [s.stop - s.start for s in self.boundary])
        for r in range(int(rank_of.max()) + 1):
            if r != this:
                common = np.flatnonzero(np.isin(labels, self.label[rank_of_dof == r]))
                if len(common):
                    shared[r] = common
        return TraceSpace(mine.tolist(), [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])],
                          _on_nodes(self.global_dof[chosen], nodes), position[self.gather[own]],
                          self.transfer.renumbered(place, len(own), len(held)), sides, self.owner[held], self.perfect, own,
                          chosen, self.total, self.subdomain_count, label, labels, np.flatnonzero(np.isin(own, self.held)),
                          self.held_at[np.isin(self.held, own)], _on_nodes(self.dof[own], nodes),
                          self.ties and self.ties.part(held, len(own)), ALONE, sends, receives, shared)

    @property
    def size(self) -> int:
        """Number D of trace dofs, both sides counted, ghosts not."""
        return len(self.gather)

    def extended(self, *fields: np.ndarray) -> tuple[np.ndarray, ...]:
        """Fields (rows, D) with the values of the ghosts behind, (rows, D + G): one message per neighbour."""
        return self.extended_later(*fields)()[0]

    def extended_later(self, *fields: np.ndarray, values: np.ndarray | None = None
                       ) -> Callable[[], tuple[tuple[np.ndarray, ...], np.ndarray | None]]:
        """Begin what ``extended`` does; calling what is returned waits for it.

        Parameters
        ----------
        values : (T, B) boundary values whose ``class_sums`` are returned too, and travel in the same messages; all ranks
            give them, or none does
        """
        summed = None if values is None else times(self.classes, values)
        met = {} if values is None else self.shared
        if not self.receives and not met:
            return lambda: (fields, summed)
        counts, none = [len(f) for f in fields], np.empty(0, int)
        rows, steps = sum(counts), 0 if values is None else len(values)
        ends, outgoing, incoming = {}, {}, {}
        for r in sorted({*self.receives, *met}):
            ghosts, dofs, classes = self.receives.get(r, none), self.sends.get(r, none), met.get(r, none)
            ends[r] = rows * len(ghosts)
            outgoing[r], incoming[r] = np.empty(rows * len(dofs) + steps * len(classes)), np.empty(ends[r] + steps * len(classes))
            own, begin = outgoing[r], 0
            for sent, at in [*((f, dofs) for f in fields), *([] if summed is None else [(summed, classes)])]:
                stop = begin + len(sent) * len(at)
                np.take(sent, at, axis=1, out=own[begin:stop].reshape(len(sent), len(at)), mode="clip")
                begin = stop
        wait = self.team.exchange(outgoing, incoming)

        def result() -> tuple[tuple[np.ndarray, ...], np.ndarray | None]:
            arrived = wait()
            ghosts = np.empty((rows, len(self.owner) - self.size))
            for r, dofs in self.receives.items():
                ghosts[:, dofs - self.size] = arrived[r][: ends[r]].reshape(rows, len(dofs))
            total = summed
            if met:
                total = np.zeros_like(summed)
                for r in sorted([*met, self.team.rank]):  # in one order, for the same bits on all ranks
                    if r == self.team.rank:
                        total += summed
                    else:
                        total[:, met[r]] += arrived[r][ends[r] :].reshape(steps, len(met[r]))
            return tuple(np.hstack([f, theirs]) for f, theirs in zip(fields, np.split(ghosts, np.cumsum(counts)[:-1]))), total

        return result

    def across(self, field: np.ndarray) -> np.ndarray:
        """(rows, D) what the other sides have where a field (rows, D) has its own."""
        return self.transfer.across(self.extended(field)[0])

    @cached_property
    def held_everywhere(self) -> np.ndarray:
        """(D + G,) bool, trace dofs whose displacement is prescribed, ghosts included; all ranks have to ask."""
        mask = np.zeros((1, self.size))
        mask[:, self.held] = 1.0
        return self.extended(mask)[0][0] > 0

    @cached_property
    def scatter(self) -> sp.csr_array:
        """(B, D) transpose of the trace operator: sums trace forces into boundary forces; held ones load no body."""
        d = self.size
        loose = np.delete(np.arange(d), self.held)
        sums = sp.csr_array((np.ones(len(loose)), (self.gather[loose], loose)), shape=(len(self.global_dof), d))
        return narrow(sums if self.ties is None else sp.csr_array(sums @ self.ties.change.T))

    def trace(self, boundary: np.ndarray) -> np.ndarray:
        """(T, D) traces w = N u of boundary displacements (T, B), eq. 1; held ones at rest."""
        return self.changed(self.gathered(boundary))

    def gathered(self, boundary: np.ndarray) -> np.ndarray:
        """(T, D) at every trace dof what its boundary dof has, of (T, B); zero where it is held."""
        if not boundary.shape[1]:
            return np.zeros((len(boundary), self.size))
        traces = boundary.take(self.gather, axis=1)
        if len(self.held):
            traces[:, self.held] = 0.0
        return traces

    def changed(self, traces: np.ndarray) -> np.ndarray:
        """(T, D) traces of the nodes in the basis of the ties, if there are any."""
        return traces if self.ties is None else times(self.ties.change, traces)

    def known(self, subdomains: Sequence[Subdomain]) -> np.ndarray | None:
        """(T, D) what ``trace`` lacks: the prescribed displacement of held trace dofs; None where none is held.

        Parameters
        ----------
        subdomains : of the scene
        """
        if not len(self.held):
            return None
        steps = len(subdomains[0].prescribed)
        traces = np.zeros((steps, self.size))
        for e in np.unique(self.held_at[:, 0]):
            mine = self.held_at[:, 0] == e
            traces[:, self.held[mine]] = subdomains[e].prescribed.reshape(steps, -1)[:, self.held_at[mine, 1]]
        return self.changed(traces)

    def on_supports(self, forces: np.ndarray) -> np.ndarray:
        """(T, h) what trace forces (T, D) do at the nodes of held trace dofs."""
        forces = forces if self.ties is None else times(sp.csr_array(self.ties.change.T), forces)
        return forces[:, self.held]

    def loads(self, forces: np.ndarray) -> np.ndarray:
        """(T, B) boundary forces Nᵀ f of trace forces (T, D)."""
        return times(self.scatter, forces)

    @cached_property
    def classes(self) -> sp.csr_array:
        """(classes, B) 0/1 matrix: boundary dofs that perfect interfaces make one and the same."""
        b = len(self.label)
        return narrow(sp.csr_array((np.ones(b), (self.label, np.arange(b))), shape=(self.label.max(initial=-1) + 1, b)))

    def class_sums(self, values: np.ndarray) -> np.ndarray:
        """(T, classes) sums of boundary values (T, B) over each class, other ranks' included."""
        return self.extended_later(values=values)()[1]


def _on_nodes(dofs: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Dofs 3 * node + component where nodes are numbered by their place among some, ascending."""
    return 3 * np.searchsorted(nodes, dofs // 3) + dofs % 3


def _labels(transfer: Transfer, perfect: list[bool], gather: np.ndarray, size: int) -> np.ndarray:
    """(B,) int, number of the class of each boundary dof."""
    bonded = np.repeat(np.array(perfect, bool), np.diff(transfer.bounds)) & transfer.at_pairs
    one, two = (gather[side[bonded]] for side in (transfer.one, transfer.two))
    graph = sp.csr_array((np.ones(len(one)), (one, two)), shape=(size, size))
    return sp.csgraph.connected_components(graph, directed=False)[1] if size else np.empty(0, int)


def _joined(parts: list[np.ndarray], empty: tuple[int, ...] = (0,)) -> np.ndarray:
    return np.concatenate(parts) if parts else np.empty(empty, int)
