"""Nodes that bonds make one, and the subdomains that have them.

Subdomains that share a node of the mesh need not be bonded there: the other side of a contact has
the same nodes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interface import Interface
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.model import Scene


class BondedNodes:
    """Copies of nodes that several subdomains have, c of them.

    subdomain : (c,) int, whose each is
    label : (c,) int, the same where bonds join copies, one by way of another
    """

    def __init__(self, scene: Scene):
        self.scene, shared = scene, scene.shared.tocoo()
        node, self.subdomain = (x.astype(int) for x in shared.coords)
        self._number = sp.csr_array((np.arange(1, len(node) + 1), (node, self.subdomain)),
                                    shape=shared.shape)
        pairs = [np.zeros((2, 0), int)]
        for i in scene.interfaces:
            one, two = (scene.side_nodes(i, side) for side in (0, 1))
            if i.law.perfect and np.array_equal(one, two):
                pairs.append(np.stack([self._copies(one, e) for e in i.subdomains]))
        count, self.label = components(*np.hstack(pairs), len(node))
        each = np.arange(len(node))
        self._members = sp.csr_array((np.ones(len(each)), (self.label, each)),
                                     shape=(count, len(each)))

    def _copies(self, nodes: np.ndarray, subdomain: int) -> np.ndarray:
        """(n,) int, the copies that a subdomain has of nodes (n,)."""
        return np.asarray(self._number[nodes, np.full(len(nodes), subdomain)]).ravel() - 1

    def others(self, interface: Interface) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Subdomains beside the two of an interface that are bonded to them at some of its nodes:
        which, its own local nodes (m,), and which of the interface's these are (m,)."""
        nodes = self.scene.side_nodes(interface, 0)
        alike = self._members[self.label[self._copies(nodes, interface.subdomains[0])]]
        at, copy = alike.tocoo().coords
        of = self.subdomain[copy]
        for e in np.setdiff1d(of, interface.subdomains):
            mine = at[of == e]
            yield int(e), np.searchsorted(self.scene.subdomains[e].nodes, nodes[mine]), mine
