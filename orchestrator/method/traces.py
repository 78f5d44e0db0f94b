"""Numbering of interface unknowns: where every trace, on both sides of every interface, lives.

Two numberings are used throughout the method:

- *boundary dofs* (B of them): the unprescribed interface dofs of each subdomain, once per
  subdomain, subdomains one after the other. What travels to and from the black box.
- *trace dofs* (D of them): one per interface, side and free component. A dof of a subdomain
  that lies on several interfaces (cross point) has one trace dof for each of them.

The trace operator of eq. (1) is then a gather, ``w = u[gather]``; its transpose adds up. Where ten-node
tets are in contact, a change of basis follows (see ``ties``).
The operators of eq. (5) need the other side's index only: ``A f = f + f[partner]`` and
``B w = w[partner] − w``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.ties import Ties, make_ties
from orchestrator.scene.model import Scene


@dataclass
class TraceSpace:
    """Numbering of the interface unknowns of a scene.

    Parameters
    ----------
    boundary : per subdomain, slice of its boundary dofs
    global_dof : (B,) int, 3 * global node + component
    gather : (D,) int, boundary dof of each trace dof
    partner : (D,) int, trace dof at the same place on the other side
    slots : per interface, the trace dofs of side 1 and of side 2, paired
    owner : (D,) int, subdomain of each trace dof
    perfect : per interface, whether it is perfect
    ties : mid-edge nodes tied to their corners, if there are any
    """

    boundary: list[slice]
    global_dof: np.ndarray
    gather: np.ndarray
    partner: np.ndarray
    slots: list[tuple[np.ndarray, np.ndarray]]
    owner: np.ndarray
    perfect: list[bool]
    ties: Ties | None = None

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
        slots: list[list] = [[None, None] for _ in scene.interfaces]
        gather, owner, count = [], [], 0
        for subdomain, pairs in enumerate(sides):
            for index, side in pairs:
                interface = scene.interfaces[index]
                dofs = (3 * interface.nodes[side][:, None] + np.arange(3))[interface.free]
                gather.append(boundary[subdomain].start + np.searchsorted(traces[subdomain], dofs))
                owner.append(np.full(len(dofs), subdomain))
                slots[index][side] = np.arange(count, count + len(dofs))
                count += len(dofs)
        partner = np.empty(count, dtype=int)
        for one, two in slots:
            partner[one], partner[two] = two, one
        return cls(boundary, _joined(global_dof), _joined(gather), partner, [tuple(s) for s in slots], _joined(owner),
                   [i.law == "perfect" for i in scene.interfaces], make_ties(scene, slots, count))

    @property
    def size(self) -> int:
        """Number of trace dofs, both sides counted."""
        return len(self.gather)

    @cached_property
    def scatter(self) -> sp.csr_array:
        """(B, D) transpose of the trace operator: sums trace forces into boundary forces."""
        d = self.size
        sums = sp.csr_array((np.ones(d), (self.gather, np.arange(d))), shape=(len(self.global_dof), d))
        return sums if self.ties is None else sp.csr_array(sums @ self.ties.change.T)

    def trace(self, boundary: np.ndarray) -> np.ndarray:
        """(D, columns) traces of boundary displacements (B, columns)."""
        traces = boundary[self.gather]
        return traces if self.ties is None else self.ties.change @ traces

    @cached_property
    def class_mean(self) -> sp.csr_array:
        """(classes, B) 0/1 matrix: boundary dofs that perfect interfaces make one and the same."""
        bonded = [slot for slot, perfect in zip(self.slots, self.perfect) if perfect]
        one = _joined([self.gather[a] for a, _ in bonded])
        two = _joined([self.gather[b] for _, b in bonded])
        b = len(self.global_dof)
        graph = sp.csr_array((np.ones(len(one)), (one, two)), shape=(b, b))
        count, label = sp.csgraph.connected_components(graph, directed=False) if b else (0, np.empty(0, int))
        return sp.csr_array((np.ones(b), (label, np.arange(b))), shape=(count, b))

    def split(self, boundary: np.ndarray) -> dict[int, np.ndarray]:
        """(B, columns) → per subdomain with interfaces (columns, t), as the black box wants it."""
        return {e: np.ascontiguousarray(boundary[s].T) for e, s in enumerate(self.boundary) if s.stop > s.start}

    def join(self, parts: dict[int, np.ndarray], columns: int) -> np.ndarray:
        """Inverse of ``split``: (B, columns)."""
        result = np.zeros((len(self.global_dof), columns))
        for e, part in parts.items():
            result[self.boundary[e]] = part.T
        return result


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.empty(0, int)
