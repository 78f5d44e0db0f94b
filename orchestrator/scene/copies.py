"""Nodes with a copy for each subdomain that has them, one subdomain after another, and which of them bonds make one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.mesh.faces import components
from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Copies:
    """N copies in all.

    scene : whose
    ends : (subdomains + 1,) int, where each subdomain's begin
    node : (N,) int, nodes of the mesh
    """

    scene: Scene
    ends: np.ndarray
    node: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> Copies:
        return cls(scene, np.cumsum([0] + [len(s.nodes) for s in scene.subdomains]), np.concatenate([s.nodes for s in scene.subdomains]))

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, 4 or 10) int, copies that each tet is on."""
        cells = np.empty_like(self.scene.mesh.cells)
        for s, start in zip(self.scene.subdomains, self.ends):
            cells[s.cells] = s.connectivity + start
        return cells

    @cached_property
    def label(self) -> np.ndarray:
        """(N,) int, equal where perfect interfaces make copies one."""
        bonds = [i for i in self.scene.interfaces if i.law.perfect and i.mortar is None]
        one, two = (np.concatenate([np.empty(0, int), *(i.nodes[side] + self.ends[i.subdomains[side]] for i in bonds)])
                    for side in (0, 1))
        return components(one, two, int(self.ends[-1]))[1]
