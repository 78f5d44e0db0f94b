"""Where the usual soles and macro functions do not do, as seen from the scene before anything is solved.

Affine macro functions and soles that follow the facets serve compact subdomains of one matter. They fail
where a subdomain has soft ways to move that are not affine on its interfaces: where stiff and soft
cells are mixed, where the matter is nearly incompressible, where the subdomain is slender or flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.model import Scene
from orchestrator.scene.soles.overlap import first_row

CONTRAST = 10.0  # of moduli in one side's first row of cells
INCOMPRESSIBLE = 0.49
SLENDER = 10.0  # largest over smallest extent
SLACK = 1e-6


@dataclass(frozen=True)
class Difficulty:
    """What is difficult about a scene.

    Parameters
    ----------
    mixed_moduli : (interfaces,) bool, stiff and soft cells side by side
    incompressible_or_slender : (subdomains,) bool, nearly incompressible, or slender or flat
    """

    mixed_moduli: np.ndarray
    incompressible_or_slender: np.ndarray


def difficulty(scene: Scene) -> Difficulty:
    """Judge every interface and every subdomain."""
    young, poisson = np.array([[m.young, m.poisson] for m in scene.materials]).T
    mixed = np.zeros(len(scene.interfaces), dtype=bool)
    if young.max() > CONTRAST * young.min():
        for i in scene.interfaces:
            rows = [young[scene.subdomains[e].material[first_row(scene, i, side)]] for side, e in enumerate(i.subdomains)]
            mixed[i.index] = any(row.max() > CONTRAST * row.min() for row in rows)
    soft = np.array([poisson[s.material].max() > INCOMPRESSIBLE
                     or slenderness(scene.mesh.nodes[s.nodes]) >= SLENDER * (1 - SLACK)
                     for s in scene.subdomains], dtype=bool)
    return Difficulty(mixed, soft)


def slenderness(points: np.ndarray) -> float:
    """Largest over smallest extent of points (n, 3) along their principal axes."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    extents = np.ptp(centred @ axes, axis=0)
    return float(extents.max() / max(extents.min(), np.finfo(float).tiny))
