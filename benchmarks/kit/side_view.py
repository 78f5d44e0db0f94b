"""Bodies of an extruded scene as they end, seen from the side."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.kit.drawing import PALETTE
from orchestrator import Solution
from orchestrator.scene.mesh.faces import faces_of

LARGE = 0.05  # of the scene's size: how far bodies are drawn from where they were


def side_view(axes: Any, solved: Solution, plane: tuple[int, int], step: int = -1, most: float = LARGE) -> None:
    """Outer faces (k, 3) of every body in a plane of two axes, displaced visibly: by so much of the scene's size, or as it is if that is
    more."""
    from matplotlib.collections import PolyCollection

    scene = solved.scene
    x, size = scene.mesh.nodes, float(np.ptp(scene.mesh.nodes[:, plane], axis=0).max())
    far = max(float(np.abs(u[step]).max()) for u in solved.sides)
    scale = max(1.0, most * size / far) if far else 1.0
    for number, (s, u) in enumerate(zip(scene.subdomains, solved.sides)):
        faces = faces_of(s.connectivity[:, :4], len(s.nodes))
        corners = (x[s.nodes] + scale * u[step])[faces.triangles[faces.outer][:, :3]][:, :, plane]
        axes.add_collection(PolyCollection(corners, facecolor=PALETTE[number % len(PALETTE)], edgecolor="white", linewidth=0.15, alpha=0.9))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_title(f"displacements × {scale:.3g}", fontsize=9)
    axes.axis("off")
