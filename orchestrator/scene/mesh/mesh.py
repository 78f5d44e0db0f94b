"""A mesh: nodes, tetrahedra, named volumes and surfaces; whether it is sound; the nodes of its
subdomains, one after another.

Indices are zero-based, lengths in the user's units.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.kept import Unchanging
from orchestrator.scene.mesh.faces import MAX_NODES, Faces, faces_of
from orchestrator.scene.mesh.geometry import PAIRS, format_point, tet_volumes
from orchestrator.scene.shapes import Shape


@dataclass(frozen=True)
class StandIn:
    """A volume that stands for a part whose mesh is not ours, see ``foreign.standin``.

    volume : index of the volume
    first : its first node; its nodes follow each other, those of its joints first; joints : how
        many of them are the joints'
    held : (m, 3) bool, of its nodes, components that the part's own supports hold
    triangles : (k, 3) int, nodes of the joints' faces, outward
    size : a length, the extent of its joints
    quadratic : whether the part's own faces have nodes in the middle of edges
    matter : representative modulus and ratio, where the part tells them
    """

    volume: int
    first: int
    joints: int
    held: np.ndarray
    triangles: np.ndarray
    size: float
    quadratic: bool
    matter: tuple[float, float] | None = None

    @property
    def nodes(self) -> slice:
        """All its nodes."""
        return slice(self.first, self.first + len(self.held))


@dataclass
class Mesh(Unchanging):
    """A conforming mesh of four- or ten-node tetrahedra with named volumes and surfaces.

    nodes : (n, 3) float, coordinates
    cells : (m, 4 or 10) int, node indices, positively oriented; the corners first, see
        ``quadratic``
    volume : (m,) int, index into ``volumes``
    volumes : names of the volumes (parts, solids, physical volumes); at least one
    surfaces : name → (k, 3) int, corners of the boundary triangles of each named surface
    source : what it was made from, for messages
    remarks : sentences on how it differs from what was asked for
    smooth : shapes of the surfaces that are each a single face of a CAD model, without a crease, by
        their names, with its normals
    foreign : the volumes that stand for parts whose mesh is not ours
    """

    nodes: np.ndarray
    cells: np.ndarray
    volume: np.ndarray
    volumes: list[str]
    surfaces: dict[str, np.ndarray] = field(default_factory=dict)
    source: str = ""
    remarks: list[str] = field(default_factory=list)
    smooth: dict[str, Shape] = field(default_factory=dict)
    foreign: list[StandIn] = field(default_factory=list)

    @property
    def box(self) -> np.ndarray:
        """(2, 3) the box around all nodes."""
        return np.stack([self.nodes.min(axis=0), self.nodes.max(axis=0)])

    def is_foreign(self, cells: np.ndarray) -> np.ndarray:
        """Bool, of the same shape as cells (int), which of them stand for parts whose mesh is not
        ours.
        """
        known = np.zeros(len(self.volumes), dtype=bool)
        known[[stand.volume for stand in self.foreign]] = True
        return known[self.volume[cells]]

    @property
    def diagonal(self) -> float:
        """Diagonal of the box around all nodes, a length."""
        return float(np.linalg.norm(np.ptp(self.box, axis=0)))

    @property
    def one_body(self) -> list[np.ndarray]:
        """(k, 2) int each, cells that belong together though they share no face: of a part whose
        mesh is not ours.
        """
        return [np.column_stack([np.full_like(own, own[0]), own]) for stand in self.foreign
                for own in [np.flatnonzero(self.volume == stand.volume)]]

    def __repr__(self) -> str:
        return (f"Mesh({self.source}: {len(self.nodes)} nodes, {len(self.cells)} tets, "
                f"{len(self.volumes)} volumes, {len(self.surfaces)} surfaces)")


# A tet is flat when its volume is below this share of its longest edge cubed.
FLAT = 1e-10


def checked(mesh: Mesh) -> tuple[Mesh, Faces]:
    """The mesh with positive tets, and its faces; one whose tets are all inverted follows another
    convention and is turned round.

    Raises InputError: no tets, too many nodes, coordinates that are no numbers, inverted or flat
        tets, faces of three tets, overlapping tets
    """
    problems = Problems()

    def complain(found: str, expected: str, cure: str) -> None:
        problems.add(("mesh",), f"{mesh.source}: {found}", expected, cure)

    bad = np.flatnonzero(~np.isfinite(mesh.nodes).all(axis=1))
    if len(mesh.cells) == 0:
        complain("no tetrahedra", "a mesh of four-node tetrahedra",
                 "mesh the volume, not only its surface, and save the volume elements")
    elif len(mesh.nodes) > MAX_NODES:
        complain(f"{len(mesh.nodes)} nodes", f"at most {MAX_NODES} nodes", "use a coarser mesh")
    elif len(bad):
        complain(f"node {bad[0]} at {mesh.nodes[bad[0]]}", "finite coordinates",
                 "write the mesh file again")
    problems.raise_if_any()
    inverted, flat = _inverted(mesh)
    if inverted.any() and (inverted | flat).all():
        mesh, inverted = replace(mesh, cells=mesh.cells[:, [0, 2, 1, 3]]), np.zeros_like(inverted)
    for what, bad, cure in (
            ("inverted", inverted,
             "swap two nodes of these tets, or mesh again: elements overlap here"),
            ("zero-volume", flat,
             "remove these tets, or optimise the mesh (gmsh: -optimize_netgen)")):
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            complain(f"{bad.sum()} {what} of {len(bad)} tets; the first is cell {first} at "
                     f"{format_point(mesh.nodes[mesh.cells[first]].mean(axis=0))}",
                     "tets of positive volume, all oriented the same way",
                     cure)
    problems.raise_if_any()  # bad tets have bad faces: a second complaint would only distract
    faces = faces_of(mesh.cells, len(mesh.nodes))
    for what, index, cure in (
            ("faces shared by three or more tets", faces.crowded, "remove duplicated tets"),
            ("faces with both tets on the same side", np.setdiff1d(faces.folded, faces.crowded),
             "remove duplicated or overlapping tets")):
        if len(index):
            complain(
                f"{len(index)} {what}, the first at "
                f"{format_point(mesh.nodes[faces.triangles[index[0]]].mean(axis=0))}",
                     "each face between at most two tets, one on either side", cure)
    problems.raise_if_any()
    return mesh, faces


def _inverted(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool each, which tets are inverted, and which are flat."""
    volumes = tet_volumes(mesh.nodes, mesh.cells)
    flat = np.abs(volumes) <= FLAT * mesh.diagonal ** 3  # no edge is longer than that
    thin = np.flatnonzero(flat)
    corners = mesh.nodes[mesh.cells[thin]]
    longest = np.max([np.sum((corners[:, i] - corners[:, j]) ** 2, axis=1) for i, j in PAIRS],
                     axis=0) ** 1.5
    flat[thin] = np.abs(volumes[thin]) <= FLAT * longest
    return (volumes < 0) & ~flat, flat


@dataclass(frozen=True)
class SplitNumbering:
    """Split node s is node ``nodes[s]`` of the mesh as seen by one subdomain.

    total : number of nodes of the mesh
    nodes : (N,) int, global node ids; within a subdomain ascending
    offsets : (parts + 1,) int, subdomain E has the split nodes offsets[E] … offsets[E + 1]
    keys : (N,) int, ascending, subdomain · total + node
    corners : (m, 4 or 10) int, split nodes of each tet
    """

    total: int
    nodes: np.ndarray
    offsets: np.ndarray
    keys: np.ndarray
    corners: np.ndarray

    def find(self, subdomain: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Split nodes of global nodes that belong to these subdomains."""
        return np.searchsorted(self.keys, subdomain * self.total + nodes)

    def sides(self, interface: Any) -> tuple[np.ndarray, np.ndarray]:
        """Split nodes (n₁,) and (n₂,) of an interface's two sides."""
        return tuple(self.offsets[e] + own for e, own in zip(interface.subdomains, interface.nodes))


def split_numbering(cells: np.ndarray, cell_subdomain: np.ndarray, total: int) -> SplitNumbering:
    """Numbers the nodes of every subdomain.

    cells : (m, 4 or 10) int
    cell_subdomain : (m,) int
    total : number of nodes of the mesh
    """
    keys, corners = np.unique(cell_subdomain[:, None] * np.int64(total) + cells,
                              return_inverse=True)
    offsets = np.searchsorted(keys, np.arange(int(cell_subdomain.max()) + 2) * np.int64(total))
    return SplitNumbering(total, keys % total, offsets, keys, corners.reshape(cells.shape))
