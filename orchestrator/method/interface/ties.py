"""Contact on ten-node tets: the nodes in the middle of edges are tied to the corners.

Node-wise laws do not suit quadratic faces: a constant pressure gives no nodal force at all to the corners of a six-node
triangle, and a linear one would pull at them. Therefore, on interfaces that press (``Interface.tied``), both sides' traces are
kept linear on every face,

    u_m = ½ (u_a + u_b)      for the node m in the middle of the edge ab,

by reaction forces that the interface exerts on each body alone. What is left are the corners, whose
forces g = g_corner + ½ Σ g_middle do the traces' whole work, as on four-node tets: pressure is a P1
field, with a third of the facets' area per corner, and constant and linear pressures pass unchanged.
The solution of a contact problem is no smoother than H^(5/2−ε) (Moussaoui & Khodja 1992), so that
linear traces cost no order of convergence where the contact's border is (Hild & Laborde, Appl. Numer. Math. 41, 2002).

The tie is pointwise in a hierarchical basis of the traces: w_m − ½(w_a + w_b) takes the place of w_m,

    w → Q w,    f → Q⁻ᵀ f,    k → Q⁻ᵀ k Q⁻¹,    Q⁻¹ = 2 − Q

in which the local stage prescribes these dofs, and contact laws see the corners alone. What is
prescribed needs no search direction that fits the soles: with σ the body's stiffness at such a dof, the
error shrinks by (σ − k⁺)/(σ + k⁻), so that k⁺ is taken from the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import joined
from orchestrator.method.interface.transfer import Transfer
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.model import Interface, Scene

# k⁺ of a tied dof over the body's stiffness with all else held, of which this is about what remains when nothing is.
# Measured: 1/4 and 1/2 take the same iterations, 1 up to half as many again.
SHARE = 0.25


class Prescribed(NamedTuple):
    """Trace dofs that the local stage prescribes, each side by itself: f̂ = f − k⁺ (w − target)."""

    dofs: np.ndarray  # (q,) int
    targets: np.ndarray  # (T, q) displacements
    stiffness: np.ndarray  # (q,) k⁺

    @classmethod
    def nothing(cls, steps: int) -> Prescribed:
        return cls(np.empty(0, int), np.empty((steps, 0)), np.empty(0))

    @property
    def none(self) -> Prescribed:
        """None of these."""
        return self.nothing(len(self.targets))

    def batch(self, steps) -> Prescribed:
        """At some of the load steps, a slice or indices."""
        return self._replace(targets=self.targets[steps])


@dataclass
class Ties:
    """The tied dofs of a scene."""

    prescribed: Prescribed  # trace dofs of the mid-edge nodes; hierarchical displacements are not zero beside prescribed corners
    change: sp.csr_array  # (D, D) sparse Q
    whole: sp.csr_array  # (D + G, D + G) sparse Q, ghosts included
    # (p, 4) int rows (tied dof's position in these, subdomain, local node, component): prescribed corners, which take half of the tied
    # dof's force
    supports: np.ndarray

    @property
    def dofs(self) -> np.ndarray:
        """(q,) int, trace dofs of the mid-edge nodes."""
        return self.prescribed.dofs

    @property
    def inverse(self) -> sp.csr_array:
        """(D + G, D + G) sparse Q⁻¹."""
        return sp.csr_array(2 * sp.eye_array(self.whole.shape[0]) - self.whole)

    def stiffen(self, diagonal: np.ndarray) -> None:
        """Take k⁺ from the diagonal (D,) of the bodies' stiffness on the trace dofs; zero where they are held."""
        own = diagonal[self.dofs]
        self.prescribed = self.prescribed._replace(stiffness=SHARE * np.where(own > 0, own, own.max(initial=0.0) or 1.0))


def traced(interface: Interface, side: int) -> np.ndarray:
    """(n, 3) bool, the components of the nodes on side 0 or 1 that have trace dofs: where nodes do not match, all of them,
    so that the other side meets what is prescribed."""
    return interface.free if interface.mortar is None else np.ones((len(interface.nodes[side]), 3), dtype=bool)


def make_ties(scene: Scene, transfer: Transfer) -> Ties | None:
    """Ties of all interfaces with six-node faces whose law does not give the jump, of a scene or a rank's part; None where a scene
    has none."""
    if not any(i.tied for i in scene.interfaces):
        return None
    dofs, targets, rows, columns, supports, count = [], [np.zeros((scene.steps, 0))], [], [], [], 0
    for interface, both in zip(scene.interfaces, transfer.sides):
        for side, slot in enumerate(both if interface.tied else ()):
            if not len(slot):
                continue
            triangles, free = interface.triangles_on(side), traced(interface, side)
            ends, edge = edges_of(triangles, TRIANGLE_EDGES)
            middle = np.empty(len(ends), dtype=int)
            middle[edge] = triangles[:, 3:]
            at, component = np.nonzero(free[middle])
            number = np.full(free.shape, -1)
            number[free] = slot
            tied, target = number[middle[at], component], np.zeros((scene.steps, len(at)))
            subdomain, ours = scene.subdomains[interface.subdomains[side]], slot[0] < transfer.size
            for end in ends[at].T:
                loose = free[end, component]
                rows.append(tied[loose])
                columns.append(number[end[loose], component[loose]])
                held = np.flatnonzero(~loose) if ours else np.empty(0, int)
                node, along = interface.nodes[side][end[held]], component[held]
                target[:, held] += 0.5 * subdomain.prescribed[:, node, along]
                supports.append(np.stack([count + held, np.full(len(held), subdomain.index), node, along], axis=1))
            if ours:
                dofs.append(tied)
                targets.append(target)
                count += len(tied)
    row, tied = joined(rows), joined(dofs)
    half = sp.csr_array((np.full(len(row), 0.5), (row, joined(columns))), shape=(transfer.total,) * 2)
    whole = sp.csr_array(sp.eye_array(transfer.total) - half)
    return Ties(Prescribed(tied, np.hstack(targets), np.ones(len(tied))), sp.csr_array(whole[: transfer.size, : transfer.size]), whole,
                joined(supports, (0, 4)))
