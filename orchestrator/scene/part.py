"""A part of a scene: some subdomains, their interfaces, and of the neighbours what meets these.
Nothing else of size.

Of other subdomains and interfaces only the places in the lists are left, with names, laws and
codes, so that numbers mean the same everywhere. A neighbour keeps the cells that touch a common
interface, be it in a single node: soles and laws ask for no more of it. What concerns the whole
scene and is a number per body or subdomain is in the ``Overview``.

Nodes with a copy for each subdomain that has them, one subdomain after another, and which of
them bonds make one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from orchestrator.scene.conditions.supports import loose_bodies, supports_of
from orchestrator.scene.interface import Interface, Overview
from orchestrator.scene.mesh.faces import components, pack
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Scene
from orchestrator.scene.soles.overlap import difficulty, islands


def overview(scene: Scene) -> Overview:
    """Overview of the scene that every part has to know."""
    opens = any(not i.law.joins for i in scene.interfaces)
    return Overview(scene.sizes, loose_bodies(scene) if opens
                    else np.zeros(len(scene.subdomains), dtype=bool),
                    difficulty(scene), scene.matched, scene.conforming, supports_of(scene),
                    scene.mesh.box, islands(scene))


def part_of(scene: Scene, mine: Sequence[int], known: Overview) -> Scene:
    """The part that belongs to some of the subdomains, with a mesh and a numbering of nodes and
    cells of its own.

    scene : the whole one
    mine : numbers of the subdomains
    known : its overview
    """
    own = np.zeros(len(scene.subdomains), dtype=bool)
    own[np.asarray(mine, dtype=int)] = True
    touched = [bool(own[list(i.subdomains)].any()) for i in scene.interfaces]
    here = [i for i, one in zip(scene.interfaces, touched) if one]
    rows, kept = _rows(scene, own, here), [np.zeros(len(s.nodes), dtype=bool)
                                           for s in scene.subdomains]
    for s, chosen, marks in zip(scene.subdomains, rows, kept):
        marks[s.connectivity[chosen]] = True
    # where sides share no nodes an interface's nodes may be on no cell that is kept
    for i in here:
        for e, chosen in zip(i.subdomains, i.nodes):
            kept[e][chosen] = True
    kept = [np.flatnonzero(marks) for marks in kept]
    cells = np.sort(np.concatenate([s.cells[own] for s, own in zip(scene.subdomains, rows)]))
    nodes = np.unique(np.concatenate([s.nodes[own] for s, own in zip(scene.subdomains, kept)]))
    mesh = Mesh(scene.mesh.nodes[nodes], np.searchsorted(nodes, scene.mesh.cells[cells]),
                scene.mesh.volume[cells],
                scene.mesh.volumes, {}, scene.mesh.source)
    subdomains = [replace(s, nodes=np.searchsorted(nodes, s.nodes[at]),
                          cells=np.searchsorted(cells, s.cells[chosen]),
                          connectivity=np.searchsorted(at, s.connectivity[chosen]),
                          material=s.material[chosen], fixed=s.fixed[at],
                          prescribed=s.prescribed[:, at], loads=s.loads[:, at],
                          held_by=s.held_by[at], contact_area=s.contact_area[at])
                  for s, chosen, at in zip(scene.subdomains, rows, kept)]
    interfaces = [_interface(i, nodes, cells, kept) if one else without_nodes(i)
                  for i, one in zip(scene.interfaces, touched)]
    return Scene(scene.name, mesh, scene.cell_subdomain[cells], scene.cell_material[cells],
                 scene.materials, subdomains,
                 interfaces, [_entry(b, scene, own, nodes) for b in scene.boundary],
                 scene.fixed[nodes],
                 scene.prescribed[:, nodes], scene.loads[:, nodes], scene.steps, overview=known,
                 number=nodes,
                 bolts=[replace(bolt, interface=interfaces[bolt.interface.index])
                        for bolt in scene.bolts],
                 thermal=None if scene.thermal is None else scene.thermal[:, cells])


def _rows(scene: Scene, own: np.ndarray, here: Sequence[Interface]) -> list[np.ndarray]:
    """Per subdomain which of its cells are kept: all of one's own, of others those with a node on a
    common interface."""
    on = np.zeros(len(scene.mesh.nodes), dtype=bool)
    for i in here:
        for side in (0, 1):
            on[scene.side_nodes(i, side)] = True
    return [np.arange(len(s.cells)) if own[s.index]
            else np.flatnonzero(on[s.nodes[s.connectivity]].any(axis=1)) for s in scene.subdomains]


def _interface(i: Interface, nodes: np.ndarray, cells: np.ndarray,
               kept: Sequence[np.ndarray]) -> Interface:
    sides = tuple(np.searchsorted(kept[e], own) for e, own in zip(i.subdomains, i.nodes))
    mortar = None if i.mortar is None else replace(i.mortar,
                                                   cells=np.searchsorted(cells, i.mortar.cells))
    return replace(i, global_nodes=np.searchsorted(nodes, i.global_nodes), nodes=sides,
                   cells=np.searchsorted(cells, i.cells),
                   mortar=mortar)


def without_nodes(i: Interface) -> Interface:
    """Its place in the list alone."""
    none = np.empty(0, int)
    return replace(i, global_nodes=none, nodes=(none, none), triangles=i.triangles[:0],
                   cells=i.cells[:0], free=i.free[:0],
                   normals=None, given=None, mortar=None, moving=None)


def _entry(b: BoundaryEntry, scene: Scene, mine: np.ndarray, nodes: np.ndarray) -> BoundaryEntry:
    """A boundary entry's part on own subdomains: every face belongs to one."""
    faces = np.flatnonzero(mine[scene.cell_subdomain[b.cells[:, 0]]])
    own = b.of(faces)
    return replace(own, triangles=np.searchsorted(nodes, own.triangles),
                   cells=np.full((len(faces), 2), -1),
                   nodes=np.searchsorted(nodes, own.nodes))


@dataclass(frozen=True)
class Copies:
    """N copies in all, of the subdomains of a scene.

    scene : whose
    ends : (subdomains + 1,) int, where each subdomain's begin
    node : (N,) int, nodes of the mesh
    label : (N,) int, equal where perfect interfaces make copies one
    """

    scene: Scene
    ends: np.ndarray
    node: np.ndarray
    label: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> Copies:
        """Copies of all nodes of a scene."""
        ends = np.cumsum([0, *(len(s.nodes) for s in scene.subdomains)])
        pairs = [np.empty((2, 0), dtype=int)]
        for i in scene.interfaces:
            if i.law.perfect and i.mortar is None and len(i.nodes[0]):
                pairs.append(np.stack([ends[e] + nodes for e, nodes in zip(i.subdomains, i.nodes)]))
        label = components(*np.concatenate(pairs, axis=1), int(ends[-1]))[1]
        return cls(scene, ends, np.concatenate([s.nodes for s in scene.subdomains]), label)

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, 4 or 10) int, copies that each tet is on."""
        cells = np.zeros_like(self.scene.mesh.cells)
        for s, start in zip(self.scene.subdomains, self.ends):
            cells[s.cells] = s.connectivity + start
        return cells

    def one_with(self, chosen: np.ndarray) -> np.ndarray:
        """(N,) bool, copies that are one with some, int."""
        return np.isin(self.label, self.label[chosen])

    def faces_of(self, triangles: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """(k,) bool, which triangles (k, 3) of the mesh are among those of a surface."""
        count = len(self.scene.mesh.nodes)
        return np.isin(pack(triangles, count), pack(surface, count))
