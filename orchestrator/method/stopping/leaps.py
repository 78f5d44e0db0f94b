"""What bonded sides of ten-node tets miss of each other where they do not match, in the estimate of the error.

Multipliers that are linear on the slave's facets close what is linear of a leap [u], and leave what is quadratic: waves as long as facets
are wide, h. Half spaces of moduli E' = E/(1 − ν²) are closed by the tractions of such a wave, of 2π/h, with the energy

    η² = Σ ∫ π/h · E'₁E'₂/(E'₁ + E'₂) [u]²      over the overlaps of facets of both sides

(K. L. Johnson, Contact Mechanics, Cambridge 1985, §13.2). No problem in a tet sees it: of two plates that overlap and are pulled .67 of
the error was told, .94 is (``tests/test_leaps.py``). On four-node tets it is a thousandth of the rest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.quadratic import DEGREE_4, six_functions
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene

TURNED = [0, 2, 1, 5, 4, 3]  # the master's facets, looked at from outside
Traces = Callable[[Interface, int], np.ndarray]


def leaping(scene: Scene) -> list[Interface]:
    """The interfaces whose sides leave leaps."""
    return [i for i in scene.interfaces if i.mortar is not None and i.mortar.overlaps is not None and len(i.triangles)]


def leaps(scene: Scene, i: Interface, traces: Traces) -> tuple[np.ndarray, np.ndarray]:
    """(k,) int, cells of the scene behind the slave's facets, each maybe several times, and (T, k) η² of them.

    traces : interface and side → (T, n, 3) displacements of its nodes there
    """
    overlaps, (weights, places) = i.mortar.overlaps, DEGREE_4
    facets = i.triangles[overlaps.slave], i.mortar.triangles[:, TURNED][overlaps.master]
    size, *corners = overlaps.fans
    area = areas(scene.side_points(i, 0), i.triangles[:, :3])[overlaps.slave]
    one, two = (six_functions(np.einsum("qv,mtvk->mtqk", places, at)) for at in corners)
    shape = np.concatenate([one, -two], axis=3)  # (m, t, q, 12)
    gram = np.einsum("mt,q,mtqa,mtqb->mab", size * area[:, None], weights, shape, shape, optimize=True)
    cells = i.cells[overlaps.slave, 0], i.mortar.cells[overlaps.master, 1]
    yields = sum((lam + 2 * mu) / (4 * mu * (lam + mu)) for lam, mu in (scene.lame[own].T for own in cells))  # 1/E' of both
    gram *= (np.pi / (np.sqrt(4 / np.sqrt(3) * area) * yields))[:, None, None]
    u = np.concatenate([traces(i, side)[:, own] for side, own in enumerate(facets)], axis=2)  # (T, m, 12, 3)
    return cells[0], np.maximum(np.einsum("tmac,mab,tmbc->tm", u, gram, u, optimize=True), 0.0)
