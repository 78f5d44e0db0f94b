"""Soles: a layer of matter on an interface, its outer face clamped (paper, section 3.2).

Added to a subdomain's mesh, a sole turns a standard elasticity solve into a Robin solve: its
stiffness, condensed on the interface, is the search direction k⁻. With one layer of linear
elements the outer nodes are all clamped, so that the condensation is a mere restriction.

With ten-node tets the nodes in the middle of the layer are clamped as well. Left free they would have
to be condensed, and k⁻ would be dense; clamped, the sole is still nothing but matter held at some of
its nodes, and k⁻ is still a restriction: what the black box factorises and what the method multiplies
by agree to rounding. Through the thickness t a displacement then fades as (1 − z/t)(1 − 2z/t) instead of
1 − z/t. Across the layer that is 7/3 times as stiff and along it 2/5 times; a layer √(35/6) times as thick
(``STRETCH``) with 3/7 · √(35/6) times the modulus is what the linear one is in both.

Four kinds:

- ``layer`` (the paper's): each side carries a layer along its own outward normal;
- ``symmetric``: each side carries a layer along +n and one along −n, half the modulus each.
  Both sides then see the very same stiffness, which makes the two search directions conjugate.
- ``overlap``: a copy of the first row of elements of both sides, see ``overlap``.
- ``springs``: a layer so thin that the nodes hardly feel each other, as contact laws, which are
  pointwise, like it. Modulus and thickness shrink together: E/thickness is what counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from orchestrator.scene.congruence import equal, first_alike, same_shape
from orchestrator.scene.mesh.faces import cross
from orchestrator.scene.soles.difficulty import Hardness, hardness
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.partition.numbering import place_rank
from orchestrator.scene.soles.overlap import overlap
from orchestrator.scene.mesh.quadratic import with_middles

# Thickness is halved this often where prisms would invert; facets that stay bad get outer
# nodes of their own, along their own normal, where inversion is impossible.
HALVINGS = 3
# A tet thinner than this fraction of its prism's regular share (area × thickness / 3) is bad.
FLATNESS = 0.1
# Thickness of a sole of springs over the local mesh size: neighbours couple by about this fraction.
THIN = 0.01
# Thickness and modulus of a layer of ten-node tets over those of the linear layer that it stands for.
STRETCH = np.sqrt(35 / 6)
STIFFEN = 3 / 7 * STRETCH


@dataclass
class Sole:
    """The matter added to one side of one interface.

    Parameters
    ----------
    points : (p, 3) float, the nodes that are not on the interface, all clamped
    cells : (q, 4 or 10) int, positively oriented; values below n are nodes of the interface, the
        others are n + index of one of ``points``
    young, poisson : (q,) float
    """

    points: np.ndarray
    cells: np.ndarray
    young: np.ndarray
    poisson: np.ndarray


@dataclass
class Facets:
    """Geometry and matter of an interface's facets, seen from its first side.

    Parameters
    ----------
    points : (n, 3) float, nodes of the interface, ascending global id
    triangles : (k, 3 or 6) int, outward of the first side
    young, poisson : (k,) float, moduli wanted for the sole behind each facet
    thickness : (n,) float, thickness wanted at each node
    """

    points: np.ndarray
    triangles: np.ndarray
    young: np.ndarray
    poisson: np.ndarray
    thickness: np.ndarray

    @cached_property
    def normals(self) -> np.ndarray:
        """(n, 3) unit normals at the corners of the facets, zero at nodes in the middle of edges."""
        return node_normals(self.points, self.triangles[:, :3])

    def same_matter(self, other: Facets) -> bool:
        """Whether the matter is that of other facets, whose triangles are the same."""
        return all(equal(getattr(self, name), getattr(other, name)) for name in ("young", "poisson", "thickness"))

    @cached_property
    def area_vectors(self) -> np.ndarray:
        """(k, 3) float, area × unit normal."""
        a, b, c = np.moveaxis(self.points[self.triangles[:, :3]], 1, 0)
        return 0.5 * cross(b - a, c - a)


def local_size(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) local mesh size at the nodes of a patch: √(2 × mean area of the adjacent facets).

    On a structured patch of right triangles this is the length of their legs.
    """
    a, b, c = np.moveaxis(points[triangles[:, :3]], 1, 0)
    area = 0.5 * np.linalg.norm(cross(b - a, c - a), axis=1)
    count = np.bincount(triangles.ravel(), minlength=len(points))
    total = np.bincount(triangles.ravel(), weights=np.repeat(area, triangles.shape[1]), minlength=len(points))
    return np.sqrt(2 * total / count)


def node_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals at the nodes: mean of the facets' normals weighted by their angle there.

    In the middle of an edge all angles are the same.
    """
    corners = points[triangles[:, :3]]
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    result = np.zeros_like(points)
    for i in range(3):
        u = corners[:, (i + 1) % 3] - corners[:, i]
        v = corners[:, (i + 2) % 3] - corners[:, i]
        cosine = np.einsum("ij,ij->i", u, v) / (np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1))
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(result, triangles[:, i], angle[:, None] * normal)
    for middle in triangles[:, 3:].T:
        np.add.at(result, middle, np.pi * normal)
    length = np.linalg.norm(result, axis=1, keepdims=True)
    return result / np.where(length > 0, length, 1.0)


def prisms(facets: Facets, direction: int) -> Sole:
    """One layer of prisms, each split in three tets along diagonals fixed by the node order.

    Parameters
    ----------
    facets : the interface
    direction : +1 outward of the first side, −1 outward of the second

    Notes
    -----
    Neighbouring prisms agree on the diagonal of their common face because both sort its nodes, by
    place rather than by number: renumbering the mesh then changes nothing. Where the thickness must shrink, the modulus shrinks with it: E/thickness is what counts.
    """
    n = len(facets.points)
    corners = facets.triangles[:, :3]
    order = np.argsort(place_rank(facets.points)[corners], axis=1)
    triangles = np.take_along_axis(corners, order, axis=1)
    # sorting may have turned a facet over: an odd permutation has an inversion count of 1 or 3
    odd = ((order[:, 0] > order[:, 1]).astype(int) + (order[:, 0] > order[:, 2]) + (order[:, 1] > order[:, 2])) % 2
    turn = direction * np.where(odd == 1, -1.0, 1.0)

    normals = direction * facets.normals
    vectors = facets.area_vectors
    area = np.linalg.norm(vectors, axis=1)
    thickness = facets.thickness.copy()
    for attempt in range(HALVINGS + 1):
        outer = facets.points + thickness[:, None] * normals
        bad = _thinnest(facets.points, outer, triangles, turn) < FLATNESS * area * thickness[triangles].mean(1) / 3
        if not bad.any() or attempt == HALVINGS:
            break
        thickness[np.unique(triangles[bad])] *= 0.5

    outer_of = triangles + n  # outer vertex behind each corner
    wanted = facets.thickness[triangles].mean(axis=1)
    achieved = thickness[triangles].mean(axis=1)
    points = outer
    if bad.any():  # own outer nodes along the facet's normal
        lone = np.flatnonzero(bad)
        step = direction * wanted[lone, None] * vectors[lone] / area[lone, None]
        own = facets.points[triangles[lone]] + step[:, None, :]
        outer_of[lone] = 2 * n + np.arange(3 * len(lone)).reshape(-1, 3)
        points = np.vstack([outer, own.reshape(-1, 3)])
        achieved[lone] = wanted[lone]

    a, b, c = triangles.T
    a1, b1, c1 = outer_of.T
    tets = np.stack([np.stack([a, b, c, c1], 1), np.stack([a, b, c1, b1], 1), np.stack([a, a1, b1, c1], 1)], 1)
    flipped = turn < 0
    tets[flipped] = tets[flipped][:, :, [1, 0, 2, 3]]
    cells = tets.reshape(-1, 4)

    used, inverse = np.unique(cells[cells >= n], return_inverse=True)
    cells[cells >= n] = n + inverse
    points = points[used - n]
    if facets.triangles.shape[1] == 6:
        points, cells = with_middles(facets.points, facets.triangles, points, cells)
    return Sole(
        points=points,
        cells=cells,
        young=np.repeat(facets.young * achieved / wanted, 3),
        poisson=np.repeat(facets.poisson, 3),
    )


def _thinnest(points: np.ndarray, outer: np.ndarray, triangles: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(k,) smallest signed tet volume of each prism."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    a1, b1, c1 = np.moveaxis(outer[triangles], 1, 0)
    volume = [_volume(a, b, c, c1), _volume(a, b, c1, b1), _volume(a, a1, b1, c1)]
    return turn * np.where(turn > 0, np.min(volume, axis=0), np.max(volume, axis=0))


def _volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", cross(b - a, c - a), d - a) / 6


def merge(first: Sole, second: Sole, n: int) -> Sole:
    """Both soles on the same interface of n nodes, each with its own other nodes."""
    shifted = np.where(second.cells >= n, second.cells + len(first.points), second.cells)
    return Sole(
        np.vstack([first.points, second.points]),
        np.vstack([first.cells, shifted]),
        np.concatenate([first.young, second.young]),
        np.concatenate([first.poisson, second.poisson]),
    )


def facets_of(scene: Scene, interface: Interface, settings, kind: str, side: int = 0) -> Facets:
    """The facets of an interface with the moduli and the thickness their sole should have.

    Parameters
    ----------
    settings : ``method.sole`` of the configuration: modulus_ratio or contact_ratio, thickness, poisson
    kind : of the sole
    side : 0 or 1, where the points are taken from; the triangles are outward of the first side anyway

    Notes
    -----
    E_S = ratio × the larger modulus E of the two sides: with a contrast across the interface it is
    the one simple choice that converges well from both sides. Under other laws than the perfect one
    the coarse problem moves whole bodies only, and the sole has to serve all waves between the mesh
    size h and the body's size L: E_S/thickness = contact_ratio × E/√(hL), the mean that optimised
    Schwarz methods choose (Gander, SIAM J. Numer. Anal. 44, 2006). ν_S is the smaller ratio, at most
    0.3: a nearly incompressible sole is stiff in the wrong direction. With ten-node tets the mesh size is
    half the facets', which is the distance of nodes, unless mid-edge nodes are tied to the corners.
    """
    young = np.array([m.young for m in scene.materials])[scene.cell_material[interface.cells]]
    poisson = np.array([m.poisson for m in scene.materials])[scene.cell_material[interface.cells]]
    points = scene.side_points(interface, side)
    quadratic = interface.triangles.shape[1] == 6
    h = local_size(points, interface.triangles) / (2 if quadratic and interface.law == "perfect" else 1)
    if settings.thickness == "auto":
        thickness = h
    else:
        thickness = np.full(len(points), float(settings.thickness))
    if settings.poisson == "auto":
        nu = np.minimum(poisson.min(axis=1), 0.3)
    else:
        nu = np.full(len(young), float(settings.poisson))
    if interface.law == "perfect":
        ratio = settings.modulus_ratio
    else:
        reach = np.sqrt(h * scene.sizes[list(interface.subdomains)].min())
        ratio = settings.contact_ratio * (thickness / reach)[interface.triangles].mean(axis=1)
    thin = THIN if kind == "springs" else 1.0
    stiffen, stretch = (STIFFEN, STRETCH) if quadratic else (1.0, 1.0)
    return Facets(points, interface.triangles, thin * stiffen * ratio * young.max(axis=1), nu,
                  thin * stretch * thickness)


def soles_of(facets: Facets, kind: str, second: Facets | None = None) -> tuple[Sole, Sole]:
    """The soles of the first and the second side; one and the same object when ``symmetric``.

    Parameters
    ----------
    second : the facets where the second side is, if not on the first
    """
    if second is not None:
        return soles_of(facets, kind)[0], soles_of(second, kind)[1]
    if kind in ("layer", "springs"):
        return prisms(facets, +1), prisms(facets, -1)
    half = Facets(facets.points, facets.triangles, facets.young / 2, facets.poisson, facets.thickness)
    both = merge(prisms(half, +1), prisms(half, -1), len(facets.points))
    return both, both


def make_soles(scene: Scene, settings, share: bool = True,
               wanted: Sequence[bool] | None = None) -> list[tuple[Sole, Sole] | None]:
    """The soles of every interface, first and second side, after ``method.sole`` of the configuration.

    Parameters
    ----------
    share : layers on interfaces that differ by a translation alone are made once, then moved
    wanted : per interface; the others get none
    """
    hard = hardness(scene) if settings.kind == "auto" else None
    soles: list[tuple[Sole, Sole] | None] = [None] * len(scene.interfaces)
    places, kinds, facets = [], [], []  # of the layers; facets of both sides, or of one for both where they lie upon each other
    for place, interface in enumerate(scene.interfaces):
        if wanted is not None and not wanted[place]:
            continue
        kind = settings.contact if interface.law != "perfect" else kind_for(hard, interface) if hard else settings.kind
        together = np.array_equal(*(scene.side_nodes(interface, side) for side in (0, 1)))
        if kind == "overlap" and together:
            soles[place] = (Sole(*overlap(scene, interface, settings.modulus_ratio)),) * 2
            continue
        places.append(place)
        kinds.append("symmetric" if kind == "overlap" else kind)
        upon = np.array_equal(*(scene.side_points(interface, side) for side in (0, 1)))
        facets.append([facets_of(scene, interface, settings, kinds[-1], side) for side in ((0,) if upon else (0, 1))])
    for place, layer in zip(places, _layers(kinds, facets, share)):
        soles[place] = layer
    return soles


def _layers(kinds: list[str], facets: list[list[Facets]], share: bool) -> list[tuple[Sole, Sole]]:
    """The soles of facets, those that differ by a translation alone from others as their copies."""
    keys = [(kind, *(f.triangles.tobytes() for f in own)) if share else number
            for number, (kind, own) in enumerate(zip(kinds, facets))]
    first = first_alike(keys, lambda i, j: all(a.same_matter(b) for a, b in zip(facets[i], facets[j]))
                        and same_shape(*(np.vstack([f.points for f in facets[n]]) for n in (i, j))))
    soles: list[tuple[Sole, Sole]] = []
    for number, (kind, own) in enumerate(zip(kinds, facets)):
        if first[number] == number:
            soles.append(soles_of(own[0], kind, *own[1:]))
            continue
        shift = own[0].points[0] - facets[first[number]][0].points[0]
        one, two = soles[first[number]]
        moved = replace(one, points=one.points + shift)
        soles.append((moved, moved if two is one else replace(two, points=two.points + shift)))
    return soles


def kind_for(hard: Hardness, interface: Interface) -> str:
    """The kind that ``auto`` stands for on a perfect interface."""
    stubborn = hard.stubborn[list(interface.subdomains)].any()
    return "overlap" if stubborn or hard.uneven[interface.index] else "symmetric"
