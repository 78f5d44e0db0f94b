"""A mesh: nodes, tetrahedra, named volumes and surfaces. Indices are zero-based, lengths in the user's units."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class StandIn:
    """What a volume is that stands for a part whose mesh is not ours, see ``foreign.standin``.

    volume : index of the volume
    first : its first node; its nodes follow each other, those of its joints first; joints : how many of them are the joints'
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
class Mesh:
    """A conforming mesh of four- or ten-node tetrahedra with named volumes and surfaces.

    nodes : (n, 3) float, coordinates
    cells : (m, 4 or 10) int, node indices, positively oriented; the corners first, see ``quadratic``
    volume : (m,) int, index into ``volumes``
    volumes : names of the volumes (parts, solids, physical volumes); at least one
    surfaces : name → (k, 3) int, corners of the boundary triangles of each named surface
    source : what it was made from, for messages
    remarks : sentences on how it differs from what was asked for
    smooth : names of the surfaces that are each a single face of a CAD model, without a crease
    foreign : the volumes that stand for parts whose mesh is not ours
    """

    nodes: np.ndarray
    cells: np.ndarray
    volume: np.ndarray
    volumes: list[str]
    surfaces: dict[str, np.ndarray] = field(default_factory=dict)
    source: str = ""
    remarks: list[str] = field(default_factory=list)
    smooth: list[str] = field(default_factory=list)
    foreign: list[StandIn] = field(default_factory=list)

    def is_foreign(self, cells: np.ndarray) -> np.ndarray:
        """Bool, of the same shape as cells (int), which of them stand for parts whose mesh is not ours."""
        known = np.zeros(len(self.volumes), dtype=bool)
        known[[stand.volume for stand in self.foreign]] = True
        return known[self.volume[cells]]

    @property
    def diagonal(self) -> float:
        """Of the box around all nodes, a length."""
        return float(np.linalg.norm(np.ptp(self.nodes, axis=0)))

    @property
    def one_body(self) -> list[np.ndarray]:
        """(k, 2) int each, cells that belong together though they share no face: of a part whose mesh is not ours."""
        return [np.column_stack([np.full_like(own, own[0]), own]) for stand in self.foreign for own in [np.flatnonzero(self.volume == stand.volume)]]

    def __repr__(self) -> str:
        return (f"Mesh({self.source}: {len(self.nodes)} nodes, {len(self.cells)} tets, "
                f"{len(self.volumes)} volumes, {len(self.surfaces)} surfaces)")
