"""Numbering of interface unknowns: where every trace, on both sides of every interface, lives.

Two numberings are used throughout the method:

- *boundary dofs* (B of them): the unprescribed interface dofs of each subdomain, once per
  subdomain, subdomains one after the other (eq. 4). What travels to and from the black box.
- *trace dofs* (D of them): one per interface, side and free component. A dof of a subdomain
  that lies on several interfaces (cross point) has one trace dof for each of them.

The trace operator of eq. 1 is then a gather, ``w = u[gather]``; its transpose adds up. A component that is
prescribed on one side of an opening interface is no unknown of its body: *held* trace dofs have no boundary dof, their
displacement is ``known``, and their force acts on the support. All fields are rows, one per load step: (T, B), (T, D).

Where several ranks share a scene, each holds the part of its own subdomains: its boundary dofs, its D trace
dofs, and after those its G *ghosts*, the trace dofs of the neighbours' sides of its interfaces. ``extended``
brings the ghosts' values, point to point; fields are kept without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import joined, narrow, times
from orchestrator.method.interface.transfer import Sides, Transfer
from orchestrator.parallel.team import ALONE, Borders, Team
from orchestrator.scene.model import Scene, Subdomain


@dataclass
class Link:
    """A rank's exchange with its neighbours."""

    number: np.ndarray  # (D,) and (B,) int, its trace dofs and boundary dofs in the numbering of the whole scene
    boundary_number: np.ndarray
    total: int  # trace dofs and subdomains of the whole scene
    subdomain_count: int
    sends: dict[int, np.ndarray] = field(default_factory=dict)  # per neighbouring rank, trace dofs to send and ghosts to receive
    receives: dict[int, np.ndarray] = field(default_factory=dict)
    team: Team = ALONE


@dataclass
class TraceSpace:
    """Numbering of the interface unknowns of a scene, or of a rank's part of it."""

    subdomains: list[int]  # those numbered here, ascending
    boundary: list[slice]  # for each, the slice of its boundary dofs
    global_dof: np.ndarray  # (B,) int, 3 * node of the scene, or of the rank's part of it, + component
    gather: np.ndarray  # (D,) int, boundary dof of each trace dof; −1 where it is held
    dof: np.ndarray  # (D,) int, 3 * node + component of each trace dof, in the same numbering
    owner: np.ndarray  # (D + G,) int, subdomain of each trace dof
    held_at: np.ndarray  # (h, 2) int, of each held trace dof, ascending, the subdomain, and the dof there, 3 * node + component
    transfer: Transfer  # how the two sides of all interfaces meet, with a point for every component that is free on both
    label: np.ndarray  # (B,) int, boundary dofs that perfect interfaces with matching nodes make one and the same, a class
    labels: np.ndarray  # (classes,) int, ascending, what these are called in the numbering of the whole scene
    link: Link  # what other parts have of it

    @classmethod
    def of(cls, scene: Scene, sides: list[list[tuple[int, int]]], traces: list[np.ndarray]) -> TraceSpace:
        """Number the traces.

        sides : per subdomain, its (interface, side) pairs
        traces : per subdomain, its (t,) boundary dofs in local numbering, ascending
        """
        subdomains, ends = scene.subdomains, np.cumsum([0] + [len(t) for t in traces])
        listed = [(e, scene.interfaces[index], side) for e, pairs in enumerate(sides) for index, side in pairs]
        free = joined([i.traced(side) for _, i, side in listed], (0, 3)).astype(bool)
        nodes, counts = joined([i.nodes[side] for _, i, side in listed]), [len(i.nodes[side]) for _, i, side in listed]
        at = np.repeat([e for e, _, _ in listed], counts).astype(int)
        dofs, owner = (3 * nodes[:, None] + np.arange(3))[free], np.broadcast_to(at[:, None], free.shape)[free]
        # all subdomains' own dofs, one after the other
        starts = np.cumsum([0] + [3 * len(s.nodes) for s in subdomains])
        everywhere = starts[owner] + dofs
        held = np.flatnonzero(joined([s.fixed.ravel() for s in subdomains]).astype(bool)[everywhere])
        place = np.zeros(starts[-1], dtype=int)
        place[joined([start + trace for start, trace in zip(starts, traces)])] = np.arange(ends[-1])
        gather, count = place[everywhere], len(dofs)
        gather[held] = -1
        stops = np.concatenate([[0], np.cumsum(free.sum(axis=1))])[np.cumsum([0] + counts)]
        own: list[list] = [[None, None] for _ in scene.interfaces]
        for (_, i, side), a, b in zip(listed, stops[:-1], stops[1:]):
            own[i.index][side] = np.arange(a, b)
        transfer = Transfer.of(scene.interfaces, [tuple(s) for s in own], count)
        label = _labels(transfer, gather, int(ends[-1]))
        global_dof = joined([3 * s.nodes[t // 3] + t % 3 for s, t in zip(subdomains, traces)])
        return cls(list(range(len(sides))), _slices(ends), global_dof, gather,
                   3 * joined([s.nodes for s in subdomains])[everywhere // 3] + dofs % 3, owner,
                   np.column_stack([owner[held], dofs[held]]), transfer, label, np.arange(label.max(initial=-1) + 1),
                   Link(np.arange(count), np.arange(ends[-1]), count, len(sides)))

    def part(self, rank_of: np.ndarray, this: int, nodes: np.ndarray) -> TraceSpace:
        """A rank's part of the numbering of a whole scene; the rank itself enters its ``team``.

        rank_of : (subdomains,) int, the rank of each
        this : which rank
        nodes : (n,) int, ascending, the nodes of its part of the scene, in which ``global_dof`` and ``dof`` then count

        Both sides of a message list its dofs in the order of the whole numbering: nothing has to be agreed on.
        """
        mine, rank = np.flatnonzero(rank_of == this), rank_of[self.owner]
        own = np.flatnonzero(rank == this)
        far = self.transfer.opposite(own)
        far = far[rank[far] != this]
        here = np.concatenate([own, far])
        place = np.full(self.size, -1)
        place[here] = np.arange(len(here))
        theirs = {int(r): far[rank[far] == r] for r in np.unique(rank[far])}
        met = {r: self.transfer.opposite(ghosts) for r, ghosts in theirs.items()}

        counts = np.array([part.stop - part.start for part in self.boundary])
        chosen = np.flatnonzero(np.repeat(rank_of, counts) == this)
        position = np.full(len(self.global_dof) + 1, -1)  # held trace dofs have no boundary dof: the last one's, −1
        position[chosen] = np.arange(len(chosen))
        labels, label = np.unique(self.label[chosen], return_inverse=True)
        link = Link(own, chosen, self.link.total, self.link.subdomain_count,
                    {r: place[dofs[rank[dofs] == this]] for r, dofs in met.items()}, {r: place[ghosts] for r, ghosts in theirs.items()})
        return TraceSpace(mine.tolist(), _slices(np.cumsum([0, *counts[mine]])), _on_nodes(self.global_dof[chosen], nodes),
                          position[self.gather[own]], _on_nodes(self.dof[own], nodes), self.owner[here],
                          self.held_at[np.isin(self.held, own)], self.transfer.renumbered(place, len(own), len(here)),
                          label, labels, link)

    @property
    def size(self) -> int:
        """Number D of trace dofs, both sides counted, ghosts not."""
        return len(self.gather)

    @property
    def team(self) -> Team:
        """The ranks that have the other parts."""
        return self.link.team

    @property
    def sides(self) -> Sides:
        """Per interface of the scene, the trace dofs (below D + G) of side 1 and of side 2."""
        return self.transfer.sides

    @cached_property
    def parts(self) -> list[slice]:
        """The trace dofs of each own subdomain, which lie together."""
        return _slices(np.searchsorted(self.owner[: self.size], [*self.subdomains, np.inf]))

    @cached_property
    def held(self) -> np.ndarray:
        """(h,) int, ascending, trace dofs whose displacement is prescribed."""
        return np.flatnonzero(self.gather < 0)

    # ---- other ranks ---------------------------------------------------------------------------

    def extended(self, *fields: np.ndarray) -> tuple[np.ndarray, ...]:
        """Fields (rows, D) with the values of the ghosts behind, (rows, D + G): one message per neighbour."""
        link, rows = self.link, sum(map(len, fields))
        if not link.receives:
            return fields
        outgoing = {r: np.concatenate([f[:, dofs] for f in fields]) for r, dofs in link.sends.items()}
        arrived = self.team.exchange(outgoing, {r: np.empty((rows, len(dofs))) for r, dofs in link.receives.items()})
        ghosts = np.empty((rows, len(self.owner) - self.size))
        for r, dofs in link.receives.items():
            ghosts[:, dofs - self.size] = arrived[r]
        stops = np.cumsum([len(f) for f in fields])[:-1]
        return tuple(np.hstack([f, theirs]) for f, theirs in zip(fields, np.split(ghosts, stops)))

    def across(self, field: np.ndarray) -> np.ndarray:
        """(rows, D) what the other sides have where a field (rows, D) has its own."""
        return self.transfer.across(self.extended(field)[0])

    @cached_property
    def held_everywhere(self) -> np.ndarray:
        """(D + G,) bool, trace dofs whose displacement is prescribed, ghosts included; all ranks have to ask."""
        return self.extended((self.gather < 0).astype(float)[None])[0][0] > 0

    @cached_property
    def classes(self) -> sp.csr_array:
        """(classes, B) 0/1 matrix: boundary dofs that perfect interfaces make one and the same."""
        b = len(self.label)
        return narrow(sp.csr_array((np.ones(b), (self.label, np.arange(b))), shape=(len(self.labels), b)))

    def class_sums(self, values: np.ndarray) -> np.ndarray:
        """(T, classes) sums of boundary values (T, B) over each class, other ranks' included."""
        return self._borders(times(self.classes, values))

    @cached_property
    def _borders(self) -> Borders:
        """Classes that other ranks have, too; all ranks have to ask."""
        names, count = np.unique(np.concatenate(self.team.all_gather(self.labels)), return_counts=True)
        at = np.flatnonzero(np.isin(self.labels, names[count > 1]))
        return Borders(self.labels[at, None], at, self.team)

    # ---- traces and forces ---------------------------------------------------------------------

    @cached_property
    def scatter(self) -> sp.csr_array:
        """(B, D) transpose of the trace operator: sums trace forces into boundary forces; held ones load no body."""
        loose = np.flatnonzero(self.gather >= 0)
        sums = sp.csr_array((np.ones(len(loose)), (self.gather[loose], loose)), shape=(len(self.global_dof), self.size))
        return narrow(sums)

    def trace(self, boundary: np.ndarray) -> np.ndarray:
        """(T, D) traces w = N u of boundary displacements (T, B), eq. 1; held ones at rest."""
        if not boundary.shape[1]:
            return np.zeros((len(boundary), self.size))
        traces = boundary.take(self.gather, axis=1)
        if len(self.held):
            traces[:, self.held] = 0.0
        return traces

    def side_by_side(self, fields: Mapping[int, np.ndarray], count: int) -> np.ndarray:
        """(count, B) fields of boundary dofs, from (boundary dofs, at most ``count``) of subdomains by their place; else zero."""
        result = np.zeros((count, len(self.global_dof)))
        for e, own in fields.items():
            result[: own.shape[1], self.boundary[e]] = own.T
        return result

    def known(self, subdomains: Sequence[Subdomain]) -> np.ndarray | None:
        """(T, D) what ``trace`` lacks: the prescribed displacement of held trace dofs; None where none is held.

        subdomains : of the scene
        """
        if not len(self.held):
            return None
        steps = len(subdomains[0].prescribed)
        traces = np.zeros((steps, self.size))
        for e in np.unique(self.held_at[:, 0]):
            mine = self.held_at[:, 0] == e
            traces[:, self.held[mine]] = subdomains[e].prescribed.reshape(steps, -1)[:, self.held_at[mine, 1]]
        return traces

    def loads(self, forces: np.ndarray) -> np.ndarray:
        """(T, B) boundary forces Nᵀ f of trace forces (T, D)."""
        return times(self.scatter, forces)


def _slices(ends: np.ndarray) -> list[slice]:
    return [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]


def _on_nodes(dofs: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Dofs 3 * node + component where nodes are numbered by their place among some, ascending."""
    return 3 * np.searchsorted(nodes, dofs // 3) + dofs % 3


def _labels(transfer: Transfer, gather: np.ndarray, size: int) -> np.ndarray:
    """(B,) int, number of the class of each boundary dof."""
    bonded = np.repeat(transfer.perfect, np.diff(transfer.bounds)) & transfer.at_pairs
    one, two = (gather[side[bonded]] for side in (transfer.one, transfer.two))
    one, two = (side[(one >= 0) & (two >= 0)] for side in (one, two))  # held dofs are prescribed on either side
    graph = sp.csr_array((np.ones(len(one)), (one, two)), shape=(size, size))
    return sp.csgraph.connected_components(graph, directed=False)[1] if size else np.empty(0, int)
