"""Nodes with a copy for each subdomain that has them, one subdomain after another, and which of
them bonds make one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.mesh.faces import components, pack
from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Copies:
    """N copies in all, of the subdomains of a scene.

    scene : whose
    ends : (subdomains + 1,) int, where each subdomain's begin
    node : (N,) int, nodes of the mesh
    label : (N,) int, equal where perfect interfaces make copies one
    """

    scene: Scene
    ends: np.ndarray
    node: np.ndarray
    label: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> Copies:
        """Copies of all nodes of a scene."""
        ends = np.cumsum([0, *(len(s.nodes) for s in scene.subdomains)])
        pairs = [np.empty((2, 0), dtype=int)]
        for i in scene.interfaces:
            if i.law.perfect and i.mortar is None and len(i.nodes[0]):
                pairs.append(np.stack([ends[e] + nodes for e, nodes in zip(i.subdomains, i.nodes)]))
        label = components(*np.concatenate(pairs, axis=1), int(ends[-1]))[1]
        return cls(scene, ends, np.concatenate([s.nodes for s in scene.subdomains]), label)

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, 4 or 10) int, copies that each tet is on."""
        cells = np.zeros_like(self.scene.mesh.cells)
        for s, start in zip(self.scene.subdomains, self.ends):
            cells[s.cells] = s.connectivity + start
        return cells

    def one_with(self, chosen: np.ndarray) -> np.ndarray:
        """(N,) bool, copies that are one with some, int."""
        return np.isin(self.label, self.label[chosen])

    def faces_of(self, triangles: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """(k,) bool, which triangles (k, 3) of the mesh are among those of a surface."""
        count = len(self.scene.mesh.nodes)
        return np.isin(pack(triangles, count), pack(surface, count))
