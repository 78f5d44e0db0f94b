"""What matter carries across a plane: force and moment of the tets in front of it on those behind.

The section goes between tets, along the plane; with loads elsewhere its shape changes neither force nor moment. At its nodes S the tets
in front need forces f₁ = Σ (K u − f₀), those behind f₂, and f₁ + f₂ = p, the loads there, half of which each side is taken to carry:

    F = ½ Σ_S (f₂ − f₁),      M = ½ Σ_S (x − x₀) × (f₂ − f₁)

is what acts on the matter behind: along the normal it is positive where the section is pulled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.blackbox.models.matter import Matter
from orchestrator.results.fields.fields import Fields
from orchestrator.scene.conditions.probes import Section
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.model import Scene


def copies(scene: Scene, fields: Fields) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nodes with a copy for each subdomain that has them, as in ``Fields.numbering``, N in all.

    Returns ends : (subdomains + 1,) int, where each subdomain's begin
    cells : (m, 4 or 10) int, copies that each tet is on
    node : (N,) int, nodes of the mesh
    label : (N,) int, equal where perfect interfaces make copies one
    """
    ends = np.cumsum([0] + [len(s.nodes) for s in scene.subdomains])
    cells = np.empty_like(scene.mesh.cells)
    for s, start in zip(scene.subdomains, ends):
        cells[s.cells] = s.connectivity + start
    node = np.concatenate([s.nodes for s in scene.subdomains])
    return ends, cells, node, node if fields.joined is None else fields.joined


def section_forces(probe: Section, scene: Scene, fields: Fields, parts: Sequence[np.ndarray]) -> np.ndarray:
    """(T, 6) force and moment, nan where matter there is a code's own.

    parts : per subdomain (T, n_E, 3), in equilibrium with its interface forces
    """
    _, cells, node, label = copies(scene, fields)
    on = np.zeros(int(label.max()) + 1, dtype=bool)
    on[np.intersect1d(label[cells[probe.front]], label[cells[probe.behind]])] = True
    u, sides = np.concatenate(parts, axis=1), []
    for side in (probe.behind, probe.front):
        chosen = side[on[label[cells[side]]].any(axis=1)]
        if fields.believed is not None and not fields.believed[chosen].all():
            return np.full((scene.steps, 6), np.nan)
        sides.append(_needed(scene, cells, node, u, chosen))
    forces = 0.5 * np.where(on[label][:, None], sides[0] - sides[1], 0.0)
    arm = scene.mesh.nodes[node] - probe.about
    return np.concatenate([forces.sum(axis=1), np.cross(arm, forces).sum(axis=1)], axis=1)


def _needed(scene: Scene, cells: np.ndarray, node: np.ndarray, u: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(T, N, 3) forces K u − f₀ of some of the tets at the copies of nodes."""
    used, own = np.unique(cells[chosen], return_inverse=True)
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])[scene.cell_material[chosen]]
    matter = Matter(scene.mesh.nodes[node[used]], own.reshape(len(chosen), -1), *moduli.T)
    found = np.zeros_like(u)
    found[:, used] = matter.forces(u[:, used].reshape(len(u), -1)).reshape(len(u), len(used), 3)
    if scene.thermal is not None:
        strain, heated = np.zeros_like(scene.thermal), np.zeros_like(u)
        strain[:, chosen] = scene.thermal[:, chosen]
        thermal_loads(scene.mesh, strain, scene.materials, scene.cell_material, cells, heated)
        found -= heated
    return found
