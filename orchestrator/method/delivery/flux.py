"""Probes as linear maps of nodes' displacements; forces and moments that matter carries, across a
plane or through faces, as such maps.

With χ a rigid motion of some nodes, K those tets' stiffness that are asked, f₀ their thermal forces
and p loads,

    F = Σ χ · (K u − f₀)        across a plane,        R = Σ χ · (K u − p) + ∫ χ · t        through
    faces

A *section* goes between tets, along the plane; with loads elsewhere its shape changes neither force
nor moment. At its nodes the tets in front need forces f₁, those behind f₂, and f₁ + f₂ are what
acts there: loads, supports, other parts. It acts on the side of the plane that the node is on: on
the matter behind acts f₂ where that is in front, −f₁ where it is behind, and ½ (f₂ − f₁) at nodes
on the plane. So χ is a rigid motion of the tets behind at the first, less one of those in front at
the second, and half of both at the last.

A *resultant* is all that acts on the body through the nodes of a surface, with K u of the tets
around, p all their loads, t the tractions on the faces themselves: supports, loads and what
interfaces carry there. What holds a node of the rim, and what an interface carries there, counts
where that entry of ``boundary``, or that interface, has faces of the surface too; where several
such entries hold a node, for the last, as among the reactions. Where a node has both, what the
other interface carries is taken off again (``ProbeRim``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from orchestrator.blackbox.models import Matter
from orchestrator.scene.conditions.probe_faces import ProbeSection, ProbeSurface
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.part import Copies
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.model import Scene

ON = 1e-6  # of an element's height: a node is on the plane
# subdomain → local nodes (n,), and components of what is asked of each (c, n, 3)
Weights = Mapping[int, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Measured:
    """A probe as a linear map of displacements: c components.

    weights : of the displacements of nodes; a node may be there several times
    given : (T, c) what it tells where nothing moves, of matter that is heated or loaded
    """

    weights: Weights
    given: np.ndarray

    @staticmethod
    def at(copies: Copies, chosen: np.ndarray, weight: np.ndarray) -> Weights:
        """Weights (c, n, 3) of copies of nodes (n,) int, by the subdomains that these are of."""
        whose = np.searchsorted(copies.ends, chosen, side="right") - 1
        return {int(e): (chosen[whose == e] - copies.ends[e], weight[:, whose == e])
                for e in np.unique(whose)}

    def of(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(T, c) of displacements, per subdomain (T, n_E, 3)."""
        return self.given + sum(np.einsum("cni,tni->tc", weight, parts[e][:, nodes])
                                for e, (nodes, weight) in self.weights.items())


@dataclass(frozen=True)
class ProbeRim:
    """Effect of an interface without faces on a surface at nodes of its rim that count for
    something else, on one side.

    interface, side : which; nodes : (k,) int, of that side; motions : (6, k, 3) what force and
        moment make of forces there
    """

    interface: int
    side: int
    nodes: np.ndarray
    motions: np.ndarray


@dataclass(frozen=True)
class ProbedTets:
    """Tets (k,) that are asked, what counts (N, 3) of their nodes' copies, and χ (c, N, 3) of every
    component.
    """

    tets: np.ndarray
    factor: np.ndarray
    moved: np.ndarray


class Carrier:
    """Matter that carries a probe's forces: of a section tets behind it and tets in front, of a
    surface
    those around its nodes."""

    def __init__(self, probe: ProbeSection | ProbeSurface, copies: Copies):
        self.probe, self.copies = probe, copies
        self.section = isinstance(probe, ProbeSection)
        self.layers = self._across() if self.section else [self._through()]

    @cached_property
    def measured(self) -> Measured:
        """Force and moment, six components; of a section the force along its normal besides."""
        scene, cells, count = self.copies.scene, self.copies.cells, len(self.layers[0].moved)
        given = np.zeros((scene.steps, count))
        if not self.section:
            given = self._loads()
        chosen, weights = [np.empty(0, dtype=int)], [np.empty((count, 0, 3))]
        for layer in self.layers:
            used, corners = np.unique(cells[layer.tets], return_inverse=True)
            moduli = scene.moduli[scene.cell_material[layer.tets]]
            points, motions = scene.mesh.nodes[self.copies.node[used]], layer.moved[
                :, used].reshape(count, -1)
            weight = Matter(points, corners.reshape(len(layer.tets), -1), *moduli.T).forces(motions)
            if self.section and scene.thermal is not None:
                given -= _heated(self.copies, layer.tets)[:,
                                                          used].reshape(scene.steps, -1) @ motions.T
            chosen.append(used)
            weights.append(weight.reshape(count, -1, 3))
        at = Measured.at(self.copies, np.concatenate(chosen), np.concatenate(weights, axis=1))
        return Measured(at, given)

    def rims(self) -> list[ProbeRim]:
        """All of a surface's."""
        (layer,), found = self.layers, []
        for number, side, there, on in self._acting:
            nodes = np.flatnonzero(layer.factor[there].any(axis=1))
            if not on and len(nodes):
                found.append(ProbeRim(number, side, nodes, layer.moved[:, there[nodes]]))
        return found

    def _across(self) -> list[ProbedTets]:
        copies, probe = self.copies, self.probe
        cells, one_with = copies.cells, copies.one_with
        sides = [probe.behind, probe.front]
        on = one_with(cells[sides[0]].ravel()) & one_with(cells[sides[1]].ravel())
        sides = [side[on[cells[side]].any(axis=1)] for side in sides]
        both = one_with(cells[sides[0]].ravel()) & one_with(cells[sides[1]].ravel())
        height = copies.scene.mesh.nodes[copies.node] @ probe.normal - probe.level
        size = np.ptp(height[cells[np.concatenate(sides)]], axis=1).max(initial=0.0)
        share = np.where(both[:, None],
                         0.5 + 0.5
                         * np.sign(np.where(np.abs(height) > ON * size, height, 0.0))[:, None],
                         np.zeros(3))
        return [self._layer(own, factor)
                for own, factor in zip(sides, (share, np.where(both[:, None], share - 1.0, 0.0)))]

    def _through(self) -> ProbedTets:
        copies, within = self.copies, self.probe.within
        around = self._here[copies.cells].any(axis=1) & (np.isin(copies.scene.mesh.volume, within)
                                                         if len(within) else True)
        return self._layer(np.flatnonzero(around), self._counted(around))

    def _layer(self, tets: np.ndarray, factor: np.ndarray) -> ProbedTets:
        copies, more = self.copies, self.probe.normal[None] if self.section else np.zeros((0, 3))
        motions = motions_about(copies.scene.mesh.nodes[copies.node], self.probe.about,
                                1.0).transpose(2, 0, 1) * factor
        return ProbedTets(tets, factor,
                          np.concatenate([motions, np.einsum("ki,inx->knx", more, motions[:3])]))

    @cached_property
    def _here(self) -> np.ndarray:
        """(N,) bool, copies on the surface."""
        return self.copies.one_with(self.copies.cells[self.probe.cells[:, None],
                                                      self.probe.corners].ravel())

    @cached_property
    def _faces(self) -> tuple[list[np.ndarray], list[bool]]:
        """Per entry of ``boundary`` bool for each of its faces, whether it is of the surface; and
        per side of each interface, one after the
        other, whether any is."""
        scene, probe = self.copies.scene, self.probe
        groups = [entry.triangles[:, :3] for entry in scene.boundary]
        groups += [scene.side_nodes(i, side)[i.triangles_on(side)[:, :3]] for i in scene.interfaces
                   for side in (0, 1)]
        ends = np.cumsum([len(group) for group in groups])[:-1]
        found = np.split(self.copies.faces_of(np.concatenate(groups),
                                              probe.triangles(scene.mesh.cells)[:, :3]), ends)
        return found[: len(scene.boundary)], [bool(any_of.any())
                                              for any_of in found[len(scene.boundary):]]

    @cached_property
    def _acting(self) -> list[tuple[int, int, np.ndarray, bool]]:
        """Interfaces that do not make both sides one, both sides of theirs, the copies of nodes
        there, whether they have faces on the surface.
        """
        copies, within, found = self.copies, self.probe.within, []
        scene = copies.scene
        for i in scene.interfaces:
            inside = (not len(within)
                      or np.isin([scene.mesh.volume[scene.subdomains[e].cells[0]]
                                  for e in i.subdomains], within).all())
            if i.law.perfect and i.mortar is None and inside:
                continue  # both sides are counted
            found += [(i.index, side, copies.ends[i.subdomains[side]] + i.nodes[side],
                       self._faces[1][2 * i.index + side]) for side in (0, 1)]
        return found

    def _counted(self, around: np.ndarray) -> np.ndarray:
        """(N, 3) 1 where what acts at a copy is the surface's, among the nodes of the tets around
        (m,) bool.
        """
        copies = self.copies
        held_by = np.concatenate([s.held_by for s in copies.scene.subdomains])
        meant = np.array([faces.any() for faces in self._faces[0]], dtype=bool)
        others = (held_by >= 0) & ~np.append(meant, False)[held_by]
        others |= (held_by < 0) & self._elsewhere()[:, None]
        used = np.zeros(len(held_by), dtype=bool)
        used[copies.cells[around]] = True
        return np.where(others, 0.0, (self._here & used)[:, None].astype(float))

    def _elsewhere(self) -> np.ndarray:
        """(N,) bool, copies of nodes at which interfaces act that have no face on the surface:
        theirs are not its forces. Bonds within a body
        balance each other over all copies of a node."""
        of = {
            on: np.concatenate(
                [np.empty(0, int), *(there for *_, there, has in self._acting if has == on)])
            for on in (True, False)}
        return self.copies.one_with(of[False]) & ~self.copies.one_with(of[True])

    def _loads(self) -> np.ndarray:
        """(T, 6) what the surface's own tractions are, less all loads at its nodes."""
        copies, layer = self.copies, self.layers[0]
        scene, used = copies.scene, np.unique(copies.cells[layer.tets])
        loads = np.concatenate([s.loads for s in scene.subdomains], axis=1)[:, used]
        motions = motions_about(scene.mesh.nodes[copies.node[used]], self.probe.about, 1.0)
        given = -np.einsum("tni,ni,nik->tk", loads, layer.factor[used], motions)
        for entry, faces in zip(scene.boundary, self._faces[0]):
            if entry.forces and faces.any():
                given += entry.forces.of(faces).resultant(scene.mesh.nodes[entry.triangles[faces]],
                                                          self.probe.about)
        return given


@dataclass(frozen=True)
class ForceProbes:
    """Maps that probes of forces ask for, by their names.

    carried : the maps that tell them; within : (k,) int, subdomains that carry them
    rims : of a resultant, what others do at its rim, where they do anything
    """

    carried: dict[str, Measured] = field(default_factory=dict)
    within: dict[str, np.ndarray] = field(default_factory=dict)
    rims: dict[str, list[ProbeRim]] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene) -> ForceProbes:
        """Return what is asked of a scene."""
        forced = [p for p in scene.probes if p.of == "force"]
        copies = Copies.of(scene) if forced else None
        carriers = {p.name: Carrier(p, copies) for p in forced}
        carried = {name: carrier.measured for name, carrier in carriers.items()}
        within = {name: np.array(sorted(probe.weights)) for name, probe in carried.items()}
        rims = {p.name: carriers[p.name].rims() for p in forced if not carriers[p.name].section}
        return cls(carried, within, {name: own for name, own in rims.items() if own})

    def of_rank(self, own: Sequence[int]) -> ForceProbes:
        """Return the same with weights of some subdomains alone."""
        return replace(self, carried={
            name: Measured({e: probe.weights[e] for e in own if e in probe.weights}, probe.given)
            for name, probe in self.carried.items()})


def _heated(copies: Copies, chosen: np.ndarray) -> np.ndarray:
    """(T, N, 3) thermal forces f₀ of some of the tets at the copies of nodes."""
    scene: Scene = copies.scene
    strain, heated = np.zeros_like(scene.thermal), np.zeros((scene.steps, len(copies.node), 3))
    strain[:, chosen] = scene.thermal[:, chosen]
    thermal_loads(scene.mesh, strain, scene.materials, scene.cell_material, copies.cells, heated)
    return heated
