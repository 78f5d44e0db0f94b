"""Outer faces of bodies with the surfaces they stand for, made once, for those bodies that are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.scene.interfaces.curvature import bulges, sagittas, smooth_faces
from orchestrator.scene.interfaces.pairing import Body
from orchestrator.scene.mesh.faces import Faces, pack
from orchestrator.scene.mesh.mesh import Mesh


@dataclass(frozen=True)
class Skin:
    """A body's outer faces, the CAD face (k,) that each is on, and how far surfaces are off them: (k, 3) and at most (k,)."""

    body: Body
    face: np.ndarray
    bulge: np.ndarray
    sagitta: np.ndarray

    @classmethod
    def of(cls, body: Body, nodes: np.ndarray, face: np.ndarray) -> Skin:
        """Of a body's faces (k,) on the nodes (n, 3) of the mesh, each on the CAD face (k,) int, −1 for none known."""
        bulge = bulges(nodes, body.triangles, face)
        return cls(body, face, bulge, sagittas(bulge))

    def bulge_of(self, triangles: np.ndarray) -> np.ndarray:
        """(m, 3) bulges of some of its facets (m, 3 or 6), given by their nodes."""
        return self.bulge[self._order[np.searchsorted(self._keys, pack(triangles[:, :3], self._size), sorter=self._order)]]

    @property
    def _size(self) -> int:
        return int(self.body.triangles[:, :3].max()) + 1

    @cached_property
    def _keys(self) -> np.ndarray:
        return pack(self.body.triangles[:, :3], self._size)

    @cached_property
    def _order(self) -> np.ndarray:
        return np.argsort(self._keys)


class Skins:
    """The skins of bodies.

    Parameters
    ----------
    bodies : all of the mesh, pieces of bodies that are cut further among them

    Attributes
    ----------
    slaves : of pairs of bodies that are cut further, the names of those whose pieces are the slaves, once chosen
    """

    def __init__(self, mesh: Mesh, faces: Faces, bodies: Sequence[Body] = ()):
        self.mesh, self.faces, self.bodies = mesh, faces, bodies
        self.slaves: dict[tuple[str, str], str] = {}
        self._made: dict[int, Skin] = {}

    def __call__(self, body: Body) -> Skin:
        if id(body) not in self._made:
            at = self._smooth[self.faces.find(body.triangles[:, :3])]
            self._made[id(body)] = Skin.of(body, self.mesh.nodes, at)
        return self._made[id(body)]

    @cached_property
    def _smooth(self) -> np.ndarray:
        return smooth_faces(self.mesh, self.faces)
