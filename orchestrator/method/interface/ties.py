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

from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of

# k⁺ of a tied dof over the body's stiffness with all else held, of which this is about what remains when nothing is.
# Measured: 1/4 and 1/2 take the same iterations, 1 up to half as many again.
SHARE = 0.25


class Prescribed(NamedTuple):
    """Trace dofs that the local stage prescribes, each side by itself: f̂ = f − k⁺ (w − target).

    Parameters
    ----------
    dofs : (q,) int
    targets : (T, q) displacements
    stiffness : (q,) k⁺
    """

    dofs: np.ndarray
    targets: np.ndarray
    stiffness: np.ndarray

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
    """The tied dofs of a scene.

    Parameters
    ----------
    prescribed : trace dofs of the mid-edge nodes; hierarchical displacements are not zero beside prescribed corners
    change : (D, D) sparse Q
    whole : (D + G, D + G) sparse Q, ghosts included
    supports : (p, 4) int rows (tied dof's position in these, subdomain, local node, component): prescribed
        corners, which take half of the tied dof's force
    """

    prescribed: Prescribed
    change: sp.csr_array
    whole: sp.csr_array
    supports: np.ndarray

    @property
    def dofs(self) -> np.ndarray:
        """(q,) int, trace dofs of the mid-edge nodes."""
        return self.prescribed.dofs

    @property
    def inverse(self) -> sp.csr_array:
        """(D + G, D + G) sparse Q⁻¹."""
        return sp.csr_array(2 * sp.eye_array(self.whole.shape[0]) - self.whole)

    def part(self, held: np.ndarray, size: int) -> Ties:
        """The ties of a rank's part.

        Parameters
        ----------
        held : (D + G,) int, its trace dofs and ghosts in the whole numbering
        size : number D of the former
        """
        place = np.full(self.change.shape[0], size)
        place[held[:size]] = np.arange(size)
        kept = np.flatnonzero(place[self.dofs] < size)
        supports = self.supports[np.isin(self.supports[:, 0], kept)]
        supports = np.column_stack([np.searchsorted(kept, supports[:, 0]), supports[:, 1:]])
        whole = sp.csr_array(self.change[held][:, held])
        prescribed = Prescribed(place[self.dofs[kept]], self.prescribed.targets[:, kept], self.prescribed.stiffness[kept])
        return Ties(prescribed, sp.csr_array(whole[:size][:, :size]), whole, supports)

    def stiffen(self, diagonal: np.ndarray) -> None:
        """Take k⁺ from the diagonal (D,) of the bodies' stiffness on the trace dofs; zero where they are held."""
        own = diagonal[self.dofs]
        self.prescribed = self.prescribed._replace(stiffness=SHARE * np.where(own > 0, own, own.max(initial=0.0) or 1.0))


def traced(interface: Interface, side: int) -> np.ndarray:
    """(n, 3) bool, the components of the nodes on side 0 or 1 that have trace dofs: where nodes do not match, all of them,
    so that the other side meets what is prescribed."""
    return interface.free if interface.mortar is None else np.ones((len(interface.nodes[side]), 3), dtype=bool)


def make_ties(scene: Scene, sides: list[tuple[np.ndarray, np.ndarray]], size: int) -> Ties | None:
    """Ties of all interfaces with six-node faces whose law does not give the jump; None where there are none.

    Parameters
    ----------
    sides : per interface, the trace dofs of side 1 and of side 2
    size : number of trace dofs D
    """
    dofs, targets, rows, columns, supports = [], [], [], [], []
    for interface, own in zip(scene.interfaces, sides):
        if not interface.tied:
            continue
        for side, slot in enumerate(own):
            triangles, free = interface.triangles_on(side), traced(interface, side)
            ends, edge = edges_of(triangles, TRIANGLE_EDGES)
            middle = np.empty(len(ends), dtype=int)
            middle[edge] = triangles[:, 3:]
            at, component = np.nonzero(free[middle])
            number = np.full(free.shape, -1)
            number[free] = slot
            tied = number[middle[at], component]
            target = np.zeros((scene.steps, len(tied)))
            subdomain = scene.subdomains[interface.subdomains[side]]
            for end in ends[at].T:
                loose = free[end, component]
                rows.append(tied[loose])
                columns.append(number[end[loose], component[loose]])
                held = np.flatnonzero(~loose)
                node, along = interface.nodes[side][end[held]], component[held]
                target[:, held] += 0.5 * subdomain.prescribed[:, node, along]
                position = sum(map(len, dofs)) + held
                supports.append(np.stack([position, np.full(len(held), subdomain.index), node, along], axis=1))
            dofs.append(tied)
            targets.append(target)
    if not dofs:
        return None
    rows, columns = np.concatenate(rows), np.concatenate(columns)
    half = sp.csr_array((np.full(len(rows), 0.5), (rows, columns)), shape=(size, size))
    tied = np.concatenate(dofs)
    change = sp.csr_array(sp.eye_array(size) - half)
    return Ties(Prescribed(tied, np.hstack(targets), np.ones(len(tied))), change, change, np.concatenate(supports))
