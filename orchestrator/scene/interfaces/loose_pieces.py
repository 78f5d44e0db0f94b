"""Pieces of one volume that share no faces: laws between volumes do not reach them, and nothing else would tell how they meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.overlap import Solid, overlap
from orchestrator.scene.interfaces.pairing import close_bodies, match, outer_bodies
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh


def report_loose_pieces(mesh: Mesh, faces: Faces, piece: np.ndarray, problems: Problems) -> None:
    """Adds a problem where pieces of a volume are inside each other, and a warning where they touch.

    Parameters
    ----------
    piece : (m,) int, of each tet
    """
    own = [set(np.unique(mesh.volume[piece == p]).tolist()) for p in range(int(piece.max()) + 1)]
    foreign = {stand.volume for stand in mesh.foreign}
    apart = replace(mesh, volume=piece, volumes=[str(p) for p in range(len(own))], foreign=[])
    for one, two in close_bodies(outer_bodies(apart, faces, piece), None):
        common = own[one.volume] & own[two.volume] - foreign
        if not common:
            continue
        name = mesh.volumes[min(common)]
        inside = overlap(*(Solid.of(name, mesh.nodes, mesh.cells[piece == b.volume], b.triangles) for b in (one, two)))
        if inside is not None:
            problems.add(("mesh",), f"two pieces of {name!r}, which share no faces, are inside each other by about {inside.depth:.3g}, at "
                         f"{format_point(inside.where)}", "pieces that are apart", "leave out what is there twice")
        elif touching := match(one, two, False)[0]:
            problems.warnings.append(f"two pieces of {name!r} touch, at {format_point(mesh.nodes[touching[0].triangles[0, :3]].mean(axis=0))}, "
                                     "with nodes of their own: nothing joins them there; merge the nodes that coincide, or give each "
                                     "piece a volume of its own")
