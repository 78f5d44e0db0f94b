"""Two surfaces that face each other, each with its own facets, how these overlap, and which of the
two is the slave.

The slave is, in this order: the side that the user names; the one that has free nodes at all; under
a law by which the sides deform as one, the softer where moduli differ much (a stiff slave with
coarse facets leaves a soft master's waves free); the one that is covered, where the other is not
(no point then has its pressure on half its area); else the coarser, which has fewer points and
smoother pressures; of equal sides the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from orchestrator.scene.interfaces.mortar.duals import FULL, Multiplier, Weights, multipliers
from orchestrator.scene.interfaces.mortar.segments import Segments, find_segments
from orchestrator.scene.interfaces.opposite import BodyFaces, Triangles
from orchestrator.scene.interfaces.skins import Surface
from orchestrator.scene.mesh.geometry import area_vectors, local_size, mirrored, node_vectors, unit
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.quadratic import CORNER_SHARES, TRIANGLE_SHARES


@dataclass(frozen=True)
class Surfaces:
    """The facets of either side that overlap the other, and their nodes; the slave first.

    points : (n₁, 3), (n₂, 3) where the nodes are
    nodes : (n₁,), (n₂,) int, their global ids, ascending
    triangles : (k₁, 3 or 6), (k₂, 3 or 6) int, indices into them, outward of the own body
    cells : (k₁,), (k₂,) int, global cells behind the facets
    segments : the overlaps, in these numbers of facets
    resting : (k₁,) area of the slave's facets before they have been moved to where they are; None:
        it is what it is here
    under : what the facets of either side stand for, curved surfaces; None: themselves
    amid : whether the slave's multipliers are those of the middles of its edges
    """

    points: tuple[np.ndarray, np.ndarray]
    nodes: tuple[np.ndarray, np.ndarray]
    triangles: tuple[np.ndarray, np.ndarray]
    cells: tuple[np.ndarray, np.ndarray]
    segments: Segments
    resting: np.ndarray | None = None
    under: tuple[Surface, Surface] | None = None
    amid: bool = False

    @classmethod
    def of(cls, points: np.ndarray, triangles: tuple[np.ndarray, np.ndarray],
           cells: tuple[np.ndarray, np.ndarray],
           segments: Segments, more: tuple[np.ndarray, np.ndarray] | None = None) -> Surfaces:
        """The surface of the facets that overlap some other, and of those that are asked for.

        points : (n, 3) all nodes; triangles : global ids of the nodes of the facets of either side;
            cells : behind them
        segments : in the numbers of these facets
        more : facets of either side that are wanted whether they overlap some other or not
        """
        met = [np.unique(side) for side in (segments.slave, segments.master)]
        if more is not None:
            met = [np.union1d(*both) for both in zip(met, more)]
        place = [np.zeros(len(t), dtype=int) for t in triangles]
        for number, own in zip(place, met):
            number[own] = np.arange(len(own))
        nodes, local = zip(*(renumbered(t[own]) for t, own in zip(triangles, met)))
        return cls(tuple(points[n] for n in nodes), nodes, local,
                   tuple(c[own] for c, own in zip(cells, met)), segments.numbered(*place))

    def moved(self, points: np.ndarray) -> Surfaces:
        """The facets where their nodes (n, 3) are now; the overlaps stay what they were."""
        return replace(self, points=tuple(points[n] for n in self.nodes))

    @cached_property
    def facets(self) -> tuple[Triangles, Triangles]:
        """Either side as it is in space."""
        return tuple(Triangles.of(x[t[:, :3]]) for x, t in zip(self.points, self.triangles))

    @cached_property
    def size(self) -> np.ndarray:
        """(n₁,) local element size at the slave's nodes."""
        return local_size(self.points[0], self.triangles[0])

    @property
    def carriers(self) -> np.ndarray:
        """(k₁, 3) int, the nodes of the slave's facets that have multipliers: corners, or middles
        of edges."""
        return self.triangles[0][:, 3:] if self.amid else self.triangles[0][:, :3]

    @property
    def vectors(self) -> np.ndarray:
        """(n₁, 3) ∫ N n dA of the functions of these: along the surfaces' normals where they are
        known, else the facets'."""
        shares = (TRIANGLE_SHARES if self.amid else CORNER_SHARES)[self.triangles[0].shape[1]]
        known = None if self.under is None else self.under[0].normals
        return node_vectors(self.points[0], self.triangles[0], shares, known)

    @property
    def weights(self) -> Weights:
        """Integrals of the multipliers; beside a slave of three-node faces, with the master's
        corners alone."""
        six = self.triangles[0].shape[1] == 6
        sides = (t if six else t[:, :3] for t in self.triangles)
        counts = tuple(map(len, self.points))
        return multipliers(self.segments, *sides, self.area, counts, self._kind)

    @property
    def _kind(self) -> Multiplier:
        corners = Multiplier.LINEAR if self.triangles[0].shape[1] == 6 else Multiplier.DUAL
        return Multiplier.AMID if self.amid else corners

    def held(self, weights: Weights, fixed: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(n₁, 3) bool, components that are prescribed at a slave's node and where it is on the
        master, as on planes of symmetry.

        fixed : (n₁, 3), (n₂, 3) bool, what is prescribed
        """
        return fixed[0] & (abs(weights.other) @ fixed[1].astype(float) > 0)

    def upright(self, held: np.ndarray, vectors: np.ndarray | None = None) -> np.ndarray:
        """(n₁, 3) unit normals along ``vectors`` (n₁, 3) or its own, see ``upright.mirrored``."""
        normals = unit(self.vectors if vectors is None else vectors)
        triangles = self.triangles[0]
        return mirrored(normals, area_vectors(self.points[0], triangles), triangles, held)

    @property
    def overlapping(self) -> tuple[np.ndarray, np.ndarray]:
        """Global ids of the nodes of either side whose facets overlap the other side's."""
        return tuple(np.unique(nodes[t[own]]) for nodes, t, own in zip(
            self.nodes, self.triangles, (self.segments.slave, self.segments.master)))

    @property
    def area(self) -> np.ndarray:
        """(k₁,) of the slave's facets."""
        return self.facets[0].area if self.resting is None else self.resting

    @property
    def filled(self) -> np.ndarray:
        """(n₁,) what the curved surfaces of both sides fill of the gap between facets, averaged
        with the multipliers of the slave's nodes;
        negative where they are farther apart than the facets."""
        count = len(self.points[0])
        if self.under is None or not any(side.bulge.any() for side in self.under):
            return np.zeros(count)
        # the bulges are quadratic functions: of nodes of its own amid each facet's edges, but where
        # multipliers are there
        nodes, ends, values = [], [], []
        for points, triangles, side in zip(self.points, self.triangles, self.under):
            if self.amid and not nodes:
                nodes.append(triangles)
                ends.append(len(points))
                at = triangles[:, 3:].ravel()
                shared = np.maximum(np.bincount(at, minlength=len(points)), 1)
                values.append(np.bincount(at, side.bulge.ravel(), len(points)) / shared)
                continue
            middles = len(points) + np.arange(side.bulge.size).reshape(side.bulge.shape)
            nodes.append(np.hstack([triangles[:, :3], middles]))
            ends.append(len(points) + side.bulge.size)
            values.append(np.concatenate([np.zeros(len(points)), side.bulge.ravel()]))
        weights = multipliers(self.segments, *nodes, self.area, tuple(ends), self._kind)
        return ((weights.own @ values[0] + weights.other @ values[1])
                / np.where(weights.area > 0, weights.area, 1.0))[:count]

    @property
    def behind(self) -> tuple[np.ndarray, np.ndarray]:
        """(k₁, 2), (k₂, 2) global cells behind each facet of either side: the slave's and the
        master's, of those opposite
        the one that overlaps it most."""
        found = []
        for side, other in ((0, 1), (1, 0)):
            own, opposite = (getattr(self.segments, name)
                             for name in ("slave", "master")[:: 1 - 2 * side])
            order = np.lexsort((opposite, -self.segments.area, own))
            first = order[np.unique(own[order], return_index=True)[1]]
            some = opposite[first[0]] if len(first) else 0  # where nothing is opposite
            across = np.full(len(self.cells[side]), self.cells[other][some])
            across[own[first]] = self.cells[other][opposite[first]]
            found.append(np.stack((self.cells[side], across)[:: 1 - 2 * side], axis=1))
        return tuple(found)


# Moduli that differ by more than this count as soft and stiff.
CONTRAST = 10.0
# Sides whose facets' mean areas differ by less than this are equally fine: rounding, or the same
# size asked for twice.
ALIKE = 0.05
# Seen from the other side, along its own normals, the same facets are a little farther apart, and
# more so on an incline.
MORE, SLANTED = 1.5, 0.05


def turned(points: np.ndarray, bodies: tuple[BodyFaces, BodyFaces], segments: Segments,
           cosine: float, more: tuple[np.ndarray, np.ndarray] | None = None) -> Surfaces:
    """The same facets with the second body's as the slave's: seen from there, as far apart as they
    are; parameters as of ``surfaces_of``.

    cosine : between the normals of facets that face each other, it is below this
    """
    facets = [np.union1d(own, wanted)
              for own, wanted in zip((segments.slave, segments.master),
                                     more or 2 * (np.empty(0, int),))][::-1]
    own = [body.some(chosen) for body, chosen in zip(bodies[::-1], facets)]
    far = MORE * np.abs(segments.distance).max() + SLANTED * own[0].size
    back = find_segments(*own, far, cosine).nearest(own[0].area).numbered(*facets)
    return surfaces_of(points, bodies[::-1], back, None if more is None else more[::-1])


def surfaces_of(points: np.ndarray, bodies: tuple[BodyFaces, BodyFaces], segments: Segments,
                more: tuple[np.ndarray, np.ndarray] | None = None) -> Surfaces:
    """The facets that overlap, the first body's as the slave's.

    points : (n, 3) nodes of the mesh
    segments : what they have in common, in the numbers of the bodies' facets
    more : facets of either body that belong to the surfaces although they need not overlap
    """
    return Surfaces.of(points, tuple(b.triangles for b in bodies), tuple(b.cells for b in bodies),
                       segments, more)


def slave_of(patches: Sequence[Surfaces], young: np.ndarray, held: np.ndarray,
             as_one: bool) -> int:
    """0: the side that the overlaps have been found from; 1: the other.

    patches : one, or all of two bodies that are cut further: the choice does not depend on the cuts
    young : (m,) modulus of each cell of the mesh; held : (n, 3) bool, components of its nodes that
        are prescribed
    as_one : whether the law makes the sides deform as one
    """
    stay = [all(held[p.nodes[side]].all() for p in patches) for side in (0, 1)]
    if stay[0] != stay[1]:
        return int(stay[0])
    facets = [np.unique(np.concatenate([np.column_stack([p.cells[side], p.facets[side].area,
                                                         np.sort(
                                                             p.nodes[side][
                                                                 p.triangles[side][:, :3]],
                                                             axis=1)])
                                        for p in patches]), axis=0) for side in (0, 1)]
    if as_one:
        moduli = [float(np.mean(young[own[:, 0].astype(int)])) for own in facets]
        if max(moduli) > CONTRAST * min(moduli):
            return int(moduli[1] < moduli[0])
    area = [own[:, 1] for own in facets]
    common = sum(p.segments.area.sum() for p in patches)
    covered = [common >= FULL * a.sum() for a in area]
    if covered[0] != covered[1]:
        return int(covered[1])
    mean = [float(a.mean()) for a in area]
    return int(mean[1] > (1 + ALIKE) * mean[0])
