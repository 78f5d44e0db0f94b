"""The energy that a structure stores: of its stresses, without what its matter expands by itself."""

from __future__ import annotations

import numpy as np

from orchestrator.method.delivery.deliver import Delivered
from orchestrator.scene.loads.temperature import strained_energy, thermal_loads
from orchestrator.scene.model import Scene
from orchestrator.scene.partition.numbering import split_numbering


def stored_energy(scene: Scene, delivered: Delivered) -> np.ndarray:
    """(T,) ½ ∫ (ε − ε₀) : C (ε − ε₀) = ½ ‖u‖²_K − u · ∫ Bᵀ C ε₀ + ½ ∫ ε₀ : C ε₀, on rank 0; ε₀ is thermal strain."""
    energy = 0.5 * delivered.iterated.bound.energy
    if scene.thermal is None:
        return energy
    numbering = split_numbering(scene.mesh.cells, scene.cell_subdomain, len(scene.mesh.nodes))
    forces = np.zeros((scene.steps, len(numbering.nodes), 3))
    thermal_loads(scene.mesh, scene.thermal, scene.materials, scene.cell_material, numbering.corners, forces)
    u = np.concatenate(delivered.continuous, axis=1)
    return energy - np.einsum("tni,tni->t", forces, u) + strained_energy(scene.mesh, scene.thermal, scene.lame)
