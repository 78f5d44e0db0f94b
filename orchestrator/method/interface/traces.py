"""Numbering of interface unknowns: where every trace, on both sides of every interface, lives.

Two numberings are used throughout the method:

- *boundary dofs* (B of them): the unprescribed interface dofs of each subdomain, once per
  subdomain, subdomains one after the other (eq. 4). What travels to and from the black box.
- *trace dofs* (D of them): one per interface, side and free component. A dof of a subdomain
  that lies on several interfaces (cross point) has one trace dof for each of them.

Where a scene is solved *by nodes* (``scene.soles.ring``) a subdomain has one trace dof for each
boundary dof, whatever the number of interfaces there: the sides of interfaces share them.

The trace operator of eq. 1 is then a gather, ``w = u[gather]``; its transpose adds up. A component
that is prescribed on one side of an opening interface is no unknown of its body: *held* trace dofs
have no boundary dof, their displacement is ``known``, and their force acts on the support. All
fields are rows, one per load step: (T, B), (T, D).

Where several ranks share a scene, each holds the part of its own subdomains: its boundary dofs, its
D trace dofs, and after those its G *ghosts*, the trace dofs of the neighbours' sides of its
interfaces. ``extended`` brings the ghosts' values, point to point; fields are kept without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import bounds_of, joined, narrow, times
from orchestrator.method.interface.transfer import Sides, Transfer
from orchestrator.parallel.numbering import Borders, classes, Link
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.model import Scene, Subdomain


@dataclass
class TraceSpace:
    """Numbering of the interface unknowns of a scene, or of a rank's part of it."""

    subdomains: list[int]  # those numbered here, ascending
    boundary: list[slice]  # for each, the slice of its boundary dofs
    # (B,) int, 3 * node of the scene, or of the rank's part of it, + component
    global_dof: np.ndarray
    gather: np.ndarray  # (D,) int, boundary dof of each trace dof; −1 where it is held
    dof: np.ndarray  # (D,) int, 3 * node + component of each trace dof, in the same numbering
    owner: np.ndarray  # (D + G,) int, subdomain of each trace dof
    # (h, 2) int, of each held trace dof, ascending, the subdomain, and the dof there, 3 * node +
    # component
    held_at: np.ndarray
    # how the two sides of all interfaces meet, with a point for every component that is free on
    # both
    transfer: Transfer
    # (B,) int, boundary dofs that perfect interfaces with matching nodes make one and the same, a
    # class
    label: np.ndarray
    # (classes,) int, ascending, what these are called on all ranks: the lowest of their numbers in
    # the whole scene
    labels: np.ndarray
    link: Link  # what other parts have of it
    by_nodes: bool = False  # whether trace dofs are the boundary dofs, shared by sides

    @classmethod
    def of(cls, scene: Scene, sides: list[list[tuple[int, int]]], traces: list[np.ndarray],
           rank_of: np.ndarray,
           team: Team = ALONE, by_nodes: bool = False) -> TraceSpace:
        """Number the traces; where several ranks share a scene they do it together, each from its
        part.

        sides : per subdomain, its (interface, side) pairs
        traces : per subdomain of this rank, its (t,) boundary dofs in local numbering, ascending
        rank_of : (subdomains,) int, the rank of each
        """
        mine = np.flatnonzero(rank_of == team.rank)
        listed = [(e, index, side) for e in mine.tolist() for index, side in sides[e]]
        count = len(listed)
        listed += _far(scene, listed, rank_of)
        dofs, owner, stops = _on_sides(scene, listed)
        size, subdomains, ends = int(stops[count]), [scene.subdomains[e]
                                                     for e in mine], bounds_of(
                                                         [len(t) for t in traces])
        # all own subdomains' dofs, one after the other
        starts = bounds_of([3 * len(s.nodes) for s in subdomains])
        everywhere = starts[np.searchsorted(mine, owner[:size])] + dofs[:size]
        held = np.flatnonzero(
            joined([s.fixed.ravel() for s in subdomains]).astype(bool)[everywhere])
        boundary = joined([start + trace for start, trace in zip(starts, traces)])
        place = np.zeros(starts[-1], dtype=int)
        place[boundary] = np.arange(ends[-1])
        gather = place[everywhere]
        gather[held] = -1
        number = np.arange(len(owner))  # of the trace dofs on the sides, one after the other
        if by_nodes:
            number = np.concatenate([gather, ends[-1] + np.arange(len(owner) - size)])
            owner = np.concatenate([np.repeat(mine, np.diff(ends)), owner[size:]])
            gather, everywhere, size = np.arange(ends[-1]), boundary, int(ends[-1])
            dofs = boundary - np.repeat(starts[:-1], np.diff(ends))
        none = np.empty(0, int)
        own: list[list] = [[none, none] for _ in scene.interfaces]
        for (_, index, side), a, b in zip(listed, stops[:-1], stops[1:]):
            own[index][side] = number[a:b]
        transfer = Transfer.of(scene.interfaces, scene.matched, [tuple(s) for s in own], size,
                               len(owner))
        link, rank = Link.of(mine, np.bincount(owner[:size], minlength=len(sides))[mine],
                             np.diff(ends), len(sides), team), rank_of[owner]
        met = [rank_of[scene.interfaces[index].subdomains[1 - side]]
               for _, index, side in listed[:count]]
        link.sends = {
            int(r): joined([own[index][side] for (_, index, side), to in zip(listed, met)
                            if to == r])
                      for r in np.unique(rank[size:])}
        link.receives = {r: size + np.flatnonzero(rank[size:] == r) for r in link.sends}
        labels, label = np.unique(_labels(transfer, gather, rank, link), return_inverse=True)
        return cls(mine.tolist(), _slices(ends),
                   joined([3 * s.nodes[t // 3] + t % 3 for s, t in zip(subdomains, traces)]),
                   gather,
                   3 * joined([s.nodes for s in subdomains])[everywhere // 3] + dofs[:size] % 3,
                   owner,
                   np.column_stack([owner[held], dofs[held]]), transfer, label.ravel(), labels,
                   link, by_nodes)

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
        """Fields (rows, D) with the values of the ghosts behind, (rows, D + G): one message per
        neighbour.
        """
        link, rows = self.link, sum(map(len, fields))
        if not link.receives:
            return fields
        outgoing = {r: np.concatenate([f[:, dofs] for f in fields])
                    for r, dofs in link.sends.items()}
        arrived = self.team.exchange(outgoing,
                                     {r: np.empty((rows, len(dofs)))
                                      for r, dofs in link.receives.items()})
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
        """(D + G,) bool, trace dofs whose displacement is prescribed, ghosts included; all ranks
        have to ask.
        """
        return self.extended((self.gather < 0).astype(float)[None])[0][0] > 0

    @cached_property
    def classes(self) -> sp.csr_array:
        """(classes, B) 0/1 matrix: boundary dofs that perfect interfaces make one and the same."""
        b = len(self.label)
        return narrow(sp.csr_array((np.ones(b), (self.label, np.arange(b))),
                                   shape=(len(self.labels), b)))

    def class_sums(self, values: np.ndarray) -> np.ndarray:
        """(T, classes) sums of boundary values (T, B) over each class, other ranks' included."""
        return self._borders(times(self.classes, values))

    @cached_property
    def on_borders(self) -> np.ndarray:
        """(classes,) bool, those that other ranks have, too."""
        sent = self.gather[joined([*self.link.sends.values()])]
        result = np.zeros(len(self.labels), dtype=bool)
        result[self.label[sent[sent >= 0]]] = True
        return result

    @cached_property
    def _borders(self) -> Borders:
        """Completes sums on borders; all ranks have to ask."""
        at = np.flatnonzero(self.on_borders)
        return Borders(self.labels[at, None], at, self.team)

    # ---- traces and forces ---------------------------------------------------------------------

    @cached_property
    def scatter(self) -> sp.csr_array:
        """(B, D) transpose of the trace operator: sums trace forces into boundary forces; held ones
        load no body.
        """
        loose = np.flatnonzero(self.gather >= 0)
        sums = sp.csr_array((np.ones(len(loose)), (self.gather[loose], loose)),
                            shape=(len(self.global_dof), self.size))
        return narrow(sums)

    def trace(self, boundary: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        """(T, D) traces w = N u of boundary displacements (T, B), eq. 1; held ones at rest, or what
        is ``known`` (T, D) added.
        """
        traces = boundary.take(self.gather,
                               axis=1) if boundary.shape[1] else np.zeros(
                                   (len(boundary), self.size))
        if len(self.held):
            traces[:, self.held] = 0.0
        return traces if known is None else traces + known

    def everywhere(self, boundary: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        """(T, D + G) ``trace`` with the ghosts' behind."""
        return self.extended(self.trace(boundary, known))[0]

    def side_by_side(self, fields: Mapping[int, np.ndarray], count: int) -> np.ndarray:
        """(count, B) fields of boundary dofs, from (boundary dofs, at most ``count``) of subdomains
        by their place; else zero.
        """
        result = np.zeros((count, len(self.global_dof)))
        for e, own in fields.items():
            result[: own.shape[1], self.boundary[e]] = own.T
        return result

    def known(self, subdomains: Sequence[Subdomain]) -> np.ndarray | None:
        """(T, D) what ``trace`` lacks: the prescribed displacement of held trace dofs; None where
        none is held.

        subdomains : of the scene
        """
        if not len(self.held):
            return None
        steps = len(subdomains[0].prescribed)
        traces = np.zeros((steps, self.size))
        for e in np.unique(self.held_at[:, 0]):
            mine = self.held_at[:, 0] == e
            traces[:,
                   self.held[mine]] = subdomains[e].prescribed.reshape(steps, -1)[
                       :, self.held_at[mine, 1]]
        return traces

    def loads(self, forces: np.ndarray) -> np.ndarray:
        """(T, B) boundary forces Nᵀ f of trace forces (T, D)."""
        return times(self.scatter, forces)


def per_node(diagonal: np.ndarray, space: TraceSpace) -> np.ndarray:
    """(B,) the mean of a diagonal (B,) over the components of each subdomain's node."""
    begins = np.diff(space.global_dof // 3, prepend=-1) != 0
    begins[[part.start for part in space.boundary if part.stop > part.start]] = True
    node = np.cumsum(begins) - 1
    return (np.bincount(node, diagonal) / np.maximum(np.bincount(node), 1))[node]


def _slices(ends: np.ndarray) -> list[slice]:
    return [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]


def _far(scene: Scene, listed: list[tuple[int, int, int]],
         rank_of: np.ndarray) -> list[tuple[int, int, int]]:
    """The sides (subdomain, interface, 0 or 1) that a rank's own ones meet on others, by subdomain,
    then by interface.
    """
    if not listed:
        return []
    this, pairs = rank_of[listed[0][0]], ((scene.interfaces[index].subdomains[1 - side], index,
                                           1 - side) for _, index, side in listed)
    return sorted(side for side in pairs if rank_of[side[0]] != this)


def _on_sides(scene: Scene,
              listed: list[tuple[int, int, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dofs (D + G,) int of subdomains, 3 * node + component, that are traced on some sides, and (D
    + G,) whose; and where each side's
    begin (sides + 1,)."""
    sides = [(scene.interfaces[index], side) for _, index, side in listed]
    free, nodes = joined([i.traced(side) for i, side in sides],
                         (0, 3)).astype(bool), joined([i.nodes[side] for i, side in sides])
    counts = [len(i.nodes[side]) for i, side in sides]
    at = np.repeat([e for e, _, _ in listed], counts).astype(int)
    stops = bounds_of(free.sum(axis=1))[bounds_of(counts)]
    return (3 * nodes[:, None] + np.arange(3))[free], np.broadcast_to(at[:, None], free.shape)[
        free], stops


def _labels(transfer: Transfer, gather: np.ndarray, rank: np.ndarray, link: Link) -> np.ndarray:
    """(B,) int, what the class of each boundary dof is called on all ranks: the lowest number of
    one of its dofs.

    rank : (D + G,) int, whose trace dofs are
    """
    bonded = np.repeat(transfer.perfect, np.diff(transfer.bounds)) & transfer.at_pairs
    one, two = (side[bonded] for side in (transfer.one, transfer.two))
    places = np.concatenate([gather, np.full(len(rank) - len(gather), -1)])
    both = (places[one] >= 0) & (places[two] >= 0)  # held dofs are prescribed on either side
    here = one < len(gather)
    # in the order of the points, which is that of other ranks
    own, far = np.where(here, one, two), np.where(here, two, one)
    across = {r: places[own[(far >= len(gather)) & (rank[far] == r)]] for r in link.sends}
    return classes(link.boundary_number, places[one[both]], places[two[both]], across, link.team)
