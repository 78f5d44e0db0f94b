"""Where the usual soles and macro functions do not do, as seen from the scene before anything is solved.

Affine macro functions and soles that follow the facets serve compact subdomains of one matter. They fail
where a subdomain has soft ways to move that are not affine on its interfaces: where stiff and soft
cells are mixed, where the matter is nearly incompressible, where the subdomain is slender or flat.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.scene.model import Difficulty, Scene
from orchestrator.scene.soles.overlap import INCOMPRESSIBLE, first_row

CONTRAST = 10.0  # of moduli in one side's first row of cells
SLENDER = 10.0  # largest over smallest extent
SLACK = 1e-6
# Copies of nearly incompressible ten-node tets resist by √(λ μ), so that √(μ/λ) of it is what the softest of the subdomain's own
# ways to move resist. With ν = .499, .045 of it, soft modes save 12 of 64 stages for 416 back-substitutions per subdomain at
# set-up; with ν = .4999, .014, they save 46 of 110 for 220. The limit lies between.
YIELDING = 0.03


def difficulty(scene: Scene) -> Difficulty:
    """Judge every interface and every subdomain."""
    if scene.overview is not None:
        return scene.overview.difficulty
    young, poisson = np.array([[m.young, m.poisson] for m in scene.materials]).T
    mixed = np.zeros(len(scene.interfaces), dtype=bool)
    if young.max() > CONTRAST * young.min():
        for i in scene.interfaces:
            rows = [young[scene.subdomains[e].material[first_row(scene, i, side)]] for side, e in enumerate(i.subdomains)]
            mixed[i.index] = any(row.max() > CONTRAST * row.min() for row in rows)
    largest = np.array([poisson[s.material].max() for s in scene.subdomains])
    incompressible = largest > INCOMPRESSIBLE
    # four-node tets cannot flow without changing their volumes, and their copies resist by all of their bulk modulus
    yielding = largest > (0.5 / (1 + YIELDING**2) if scene.mesh.cells.shape[1] == 10 else INCOMPRESSIBLE)
    slender = slenderness([s.nodes for s in scene.subdomains], scene.mesh.nodes) >= SLENDER * (1 - SLACK)
    foreign = np.array([s.foreign for s in scene.subdomains], dtype=bool)  # of which only the joints are known
    return Difficulty(mixed, (incompressible | slender) & ~foreign, (yielding | slender) & ~foreign)


def slenderness(clouds: Sequence[np.ndarray], nodes: np.ndarray) -> np.ndarray:
    """(clouds,) largest over smallest extent of sets of nodes along their principal axes.

    clouds : each (n,) int, n > 0, which of the nodes
    nodes : (all, 3) coordinates
    """
    counts = np.array([len(cloud) for cloud in clouds])
    starts, member = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
    points = nodes[np.concatenate(clouds)]
    centred = points - (np.add.reduceat(points, starts) / counts[:, None])[member]
    axes = np.linalg.eigh(np.add.reduceat(centred[:, :, None] * centred[:, None], starts))[1]
    along = np.einsum("ni,nij->nj", centred, axes[member])
    extents = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
    return extents.max(axis=1) / np.maximum(extents.min(axis=1), np.finfo(float).tiny)
