"""Forces and moments that matter carries, across a plane or through faces, as what they are of displacements.

With χ a rigid motion of some nodes, K those tets' stiffness that are asked, f₀ their thermal forces and p loads,

    F = Σ χ · (K u − f₀)        across a plane,        R = Σ χ · (K u − p) + ∫ χ · t        through faces

A *section* goes between tets, along the plane; with loads elsewhere its shape changes neither force nor moment. At its nodes the tets
in front need forces f₁, those behind f₂, and f₁ + f₂ are what acts there: loads, supports, other parts. It acts on the side of the plane
that the node is on: on the matter behind acts f₂ where that is in front, −f₁ where it is behind, and ½ (f₂ − f₁) at nodes on the plane. So χ
is a rigid motion of the tets behind at the first, less one of those in front at the second, and half of both at the last.

A *resultant* is all that acts on the body through the nodes of a surface, with K u of the tets around, p all their loads, t the
tractions on the faces themselves: supports, loads and what interfaces carry there. What holds a node of the rim, and what an interface
carries there, counts where that entry of ``boundary``, or that interface, has faces of the surface too; where several such entries hold a
node, for the last, as among the reactions. Where a node has both, what the other interface carries is taken off again (``Rim``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.models.matter import Matter
from orchestrator.method.delivery.measured import Measured
from orchestrator.scene.conditions.probes import Section, Surface
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.copies import Copies
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.model import Interface, Scene

FORCES = ("section", "resultant")  # quantities of probes
ON = 1e-6  # of an element's height: a node is on the plane


def cells_of(probe: Section | Surface, copies: Copies) -> list[np.ndarray]:
    """The tets that are asked, int: of a section those behind and those in front, of a surface those around its nodes."""
    label, cells = copies.label, copies.cells
    if isinstance(probe, Section):
        on = np.isin(label, np.intersect1d(label[cells[probe.front]], label[cells[probe.behind]]))
        return [side[on[cells[side]].any(axis=1)] for side in (probe.behind, probe.front)]
    mesh = copies.scene.mesh
    around = _on(probe, copies)[cells].any(axis=1) & (np.isin(mesh.volume, probe.within) if len(probe.within) else True)
    return [np.flatnonzero(around)]


def flux(probe: Section | Surface, copies: Copies) -> Measured:
    """Force and moment, six components; of a section the force along its normal besides."""
    scene, cells = copies.scene, copies.cells
    layers = list(_layers(probe, copies))
    count = len(layers[0][2])
    given = np.zeros((scene.steps, count)) if isinstance(probe, Section) else _loads(probe, copies, *layers[0][:2])
    chosen, weights, energy = [], [], np.zeros(count)
    for own, _, moved in layers:
        used, corners = np.unique(cells[own], return_inverse=True)
        moduli = np.array([[m.young, m.poisson] for m in scene.materials])[scene.cell_material[own]]
        points, motions = scene.mesh.nodes[copies.node[used]], moved[:, used].reshape(count, -1)
        weight = Matter(points, corners.reshape(len(own), -1), *moduli.T).forces(motions)
        energy += np.einsum("kn,kn->k", motions, weight)
        if isinstance(probe, Section) and scene.thermal is not None:
            given -= _heated(scene, cells, own)[:, used].reshape(scene.steps, -1) @ motions.T
        chosen.append(used)
        weights.append(weight.reshape(count, -1, 3))
    return Measured(Measured.at(copies, np.concatenate(chosen), np.concatenate(weights, axis=1)), given, True, energy)


def lifted(probe: Section | Surface, copies: Copies) -> tuple[np.ndarray, np.ndarray]:
    """Tets (k,) int that carry the three components of the force, and χ (3, k, 4 or 10, 3) at their nodes."""
    layers = list(_layers(probe, copies))
    return (np.concatenate([own for own, *_ in layers]),
            np.concatenate([moved[:3, copies.cells[own]] for own, _, moved in layers], axis=1))


def _layers(probe: Section | Surface, copies: Copies) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Tets (k,) that are asked, what counts (N, 3) of their nodes, and χ (c, N, 3) of every component."""
    label, cells, asked = copies.label, copies.cells, cells_of(probe, copies)
    if isinstance(probe, Section):
        behind, front = (np.isin(label, label[cells[side]]) for side in asked)
        height = copies.scene.mesh.nodes[copies.node] @ probe.normal - probe.level
        size = np.ptp(height[cells[np.concatenate(asked)]], axis=1).max()
        share = np.where((behind & front)[:, None], 0.5 + 0.5 * np.sign(np.where(np.abs(height) > ON * size, height, 0.0))[:, None], np.zeros(3))
        factors, more = [share, np.where((behind & front)[:, None], share - 1.0, 0.0)], probe.normal[None]
    else:
        factors, more = [_counted(probe, copies, asked[0])], np.zeros((0, 3))
    for own, factor in zip(asked, factors):
        motions = motions_about(copies.scene.mesh.nodes[copies.node], probe.about, 1.0).transpose(2, 0, 1) * factor
        yield own, factor, np.concatenate([motions, np.einsum("ki,inx->knx", more, motions[:3])])


def _on(probe: Surface, copies: Copies) -> np.ndarray:
    """(N,) bool, copies on the surface."""
    local = (copies.scene.mesh.cells[probe.cells][:, None, :] == probe.triangles[:, :, None]).argmax(axis=2)
    return np.isin(copies.label, copies.label[copies.cells[probe.cells[:, None], local]])


def _faces(probe: Surface, scene: Scene) -> list[np.ndarray]:
    """Per entry of ``boundary`` bool for each of its faces, whether it is of the surface."""
    count = len(scene.mesh.nodes)
    return [np.isin(pack(entry.triangles[:, :3], count), pack(probe.triangles[:, :3], count)) for entry in scene.boundary]


def _counted(probe: Surface, copies: Copies, around: np.ndarray) -> np.ndarray:
    """(N, 3) 1 where what acts at a copy is the surface's, among the nodes of the tets around (k,)."""
    scene, here = copies.scene, _on(probe, copies)
    held_by = np.concatenate([s.held_by for s in scene.subdomains])
    others = (held_by >= 0) & ~np.array([*(faces.any() for faces in _faces(probe, scene)), False])[held_by]
    others |= (held_by < 0) & _elsewhere(probe, copies)[:, None]
    used = np.zeros(len(here), dtype=bool)
    used[copies.cells[around]] = True
    return np.where(others, 0.0, (here & used)[:, None].astype(float))


def _loads(probe: Surface, copies: Copies, around: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """(T, 6) what the surface's own tractions are, less all loads at its nodes."""
    scene, used = copies.scene, np.unique(copies.cells[around])
    loads = np.concatenate([s.loads for s in scene.subdomains], axis=1)[:, used]
    motions = motions_about(scene.mesh.nodes[copies.node[used]], probe.about, 1.0)
    given = -np.einsum("tni,ni,nik->tk", loads, factor[used], motions)
    for entry, faces in zip(scene.boundary, _faces(probe, scene)):
        if entry.forces and faces.any():
            given += entry.forces.of(faces).resultant(scene.mesh.nodes[entry.triangles[faces]], probe.about)
    return given


def _heated(scene: Scene, cells: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(T, N, 3) thermal forces f₀ of some of the tets at the copies of nodes."""
    strain, heated = np.zeros_like(scene.thermal), np.zeros((scene.steps, int(cells.max()) + 1, 3))
    strain[:, chosen] = scene.thermal[:, chosen]
    thermal_loads(scene.mesh, strain, scene.materials, scene.cell_material, cells, heated)
    return heated


@dataclass(frozen=True)
class Rim:
    """What an interface without faces on a surface does at nodes of its rim that count for something else, on one side.

    interface, side : which; nodes : (k,) int, of that side; motions : (6, k, 3) what force and moment make of forces there
    """

    interface: int
    side: int
    nodes: np.ndarray
    motions: np.ndarray


def rims(probe: Surface, copies: Copies) -> list[Rim]:
    """All of a surface's."""
    (own, factor, moved), = _layers(probe, copies)
    found = []
    for i, side, there, on in _acting(probe, copies):
        nodes = np.flatnonzero(factor[there].any(axis=1))
        if not on and len(nodes):
            found.append(Rim(i.index, side, nodes, moved[:, there[nodes]]))
    return found


def _acting(probe: Surface, copies: Copies) -> Iterator[tuple[Interface, int, np.ndarray, bool]]:
    """Interfaces that do not make both sides one, their sides, the copies of nodes there, and whether they have faces on the surface."""
    scene, ends, count = copies.scene, copies.ends, len(copies.scene.mesh.nodes)
    mine, volumes = pack(probe.triangles[:, :3], count), [scene.mesh.volume[s.cells[0]] for s in scene.subdomains]
    for i in scene.interfaces:
        within = not len(probe.within) or np.isin([volumes[e] for e in i.subdomains], probe.within).all()
        if i.law.perfect and i.mortar is None and within:
            continue  # both sides are counted
        for side, e in enumerate(i.subdomains):
            faces = scene.side_nodes(i, side)[i.triangles_on(side)[:, :3]]
            yield i, side, ends[e] + i.nodes[side], bool(np.isin(pack(faces, count), mine).any())


def _elsewhere(probe: Surface, copies: Copies) -> np.ndarray:
    """(N,) bool, copies of nodes at which interfaces act that have no face on the surface: theirs are not its forces."""
    label = copies.label  # bonds within a body balance each other over all copies of a node
    on, beside = np.zeros((2, int(label.max()) + 1), dtype=bool)
    for _, _, there, has_faces in _acting(probe, copies):
        (on if has_faces else beside)[label[there]] = True
    return (beside & ~on)[label]
