"""Element sizes asked for in space: given on an earlier mesh, followed by gmsh as it meshes a CAD model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.geometry import tet_volumes
from orchestrator.scene.mesh.gmsh_session import gmsh

WHOLE = ""  # key of the map of a mesh that is made in one piece
REGULAR = 6 * np.sqrt(2)  # the cube of a regular tet's edge over its volume
# Tets that gmsh makes, over as many regular ones as the sizes ask for: .65 at 700 elements to .46 at 80,000, even or graded, measured
FOLLOWED = 0.55
# gmsh's octree ends the program where a tet's middle is on one of its planes but for rounding: nodes are moved by this share of the whole
ASTRAY = 1e-9


@dataclass(frozen=True)
class SizeMap:
    """Sizes on tets, linear in each, in the coordinates of the source before it is scaled or moved.

    nodes : (n, 3); cells : (m, 4) int; size : (n,) length of edges
    """

    nodes: np.ndarray
    cells: np.ndarray
    size: np.ndarray

    def apply(self) -> int:
        """A field of gmsh's that gives about as many tets, by its tag."""
        astray = ASTRAY * np.ptp(self.nodes, axis=0).max() * np.random.default_rng(0).uniform(-1.0, 1.0, self.nodes.shape)
        corners, size = (self.nodes + astray)[self.cells].transpose(0, 2, 1).reshape(-1, 12), self.size * np.cbrt(FOLLOWED)
        view = gmsh.view.add("sizes")
        gmsh.view.addListData(view, "SS", len(corners), np.hstack([corners, size[self.cells]]).ravel())
        field = gmsh.model.mesh.field.add("PostView")
        gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
        return field


# name of a volume that is meshed by itself, or WHOLE → the sizes in it
Sizes = Mapping[str, SizeMap]


def edge_lengths(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) edges of regular tets of the same volumes."""
    return np.cbrt(REGULAR * np.abs(tet_volumes(nodes, cells)))
