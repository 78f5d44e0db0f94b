"""The facets of an interface, with the moduli and the thickness that their sole should have (paper,
eq. 15).

With ten-node tets the nodes in the middle of the layer are clamped as well. Left free they would
have to be condensed, and k⁻ would be dense; clamped, the sole is still nothing but matter held at
some of its nodes, and k⁻ is still a restriction: what the black box factorises and what the method
multiplies by agree to rounding. Through the thickness t a displacement then fades as (1 − z/t)(1 −
2z/t) instead of 1 − z/t. Across the layer that is 7/3 times as stiff and along it 2/5 times; a
layer √(35/6) times as thick (``STRETCH``) with 3/7 · √(35/6) times the modulus is what the linear
one is in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import scalar
from orchestrator.scene.interfaces.mortar.surfaces import CONTRAST
from orchestrator.scene.mesh.geometry import (
    area_vectors, local_size, node_areas, node_normals, shape_gradients)
from orchestrator.scene.mesh.quadratic import CORNER_SHARES
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.overlap import first_row

# Thickness of a sole of springs over the local mesh size: neighbours couple by about this fraction.
THIN = 0.01
# Thickness and modulus of a layer of ten-node tets over those of the linear layer that it stands
# for.
STRETCH = np.sqrt(35 / 6)
STIFFEN = 3 / 7 * STRETCH
WALL = 2.0  # beside a prescribed node


@dataclass
class Facets:
    """Geometry and matter of an interface's facets, seen from its first side.

    points : (n, 3) float, nodes of the interface, ascending global id
    triangles : (k, 3 or 6) int, outward of the first side
    young : (k, 3) float, modulus wanted for the sole behind each corner of a facet
    poisson : (k,) float
    thickness : (n,) float, thickness wanted at each node
    """

    points: np.ndarray
    triangles: np.ndarray
    young: np.ndarray
    poisson: np.ndarray
    thickness: np.ndarray

    @cached_property
    def normals(self) -> np.ndarray:
        """(n, 3) unit normals at the corners of the facets, zero at nodes in the middle of
        edges.
        """
        return node_normals(self.points, self.triangles[:, :3])

    @cached_property
    def area_vectors(self) -> np.ndarray:
        """(k, 3) float, area × unit normal."""
        return area_vectors(self.points, self.triangles)


def facets_of(scene: Scene, interface: Interface, settings, kind: str, side: int = 0) -> Facets:
    """The facets of an interface with the moduli and the thickness their sole should have.

    settings : ``method.sole`` of the configuration: modulus_ratio or contact_ratio, thickness,
        poisson
    kind : of the sole
    side : 0 or 1, where the points are taken from; the triangles are outward of the first side
        anyway

    E_S = ratio × E. Where the law makes the sides deform as one, E is the larger modulus of the
    two: with a contrast across the interface it is the one simple choice that converges well from
    both sides. Elsewhere it is ``between`` them, near the softer. Under other laws than the perfect
    one the coarse contact problem moves whole bodies only, and the sole has to serve all waves
    between the mesh size h and the body's size L: E_S/thickness = contact_ratio × E/√(hL), the mean
    that optimised Schwarz methods choose (Gander, SIAM J. Numer. Anal. 44, 2006); springs have the
    moduli that nodes meet (``moduli_at``), and are ``stiffer`` at some. ν_S is the smaller ratio,
    at most 0.3: a nearly incompressible sole is stiff in the wrong direction. With ten-node tets
    the mesh size is half the facets', which is the distance of nodes, but where points are at the
    corners and see the mean around. Where nodes do not match, bonded sides whose facets differ get
    soles of one thickness, see ``thickness_between``. Beside the slave's nodes that are free and
    carry no point its own modulus counts: nothing is opposite them, and against a stiffer sole each
    of them takes an iteration. Iterations to 1e-6, a pad between stiffer blocks, on a plane of
    symmetry: with the larger modulus and with its own, of moduli 1:30 38 and 19, 1:1000 57 and 49,
    cut in five 142 and 60, over 200 and 118; six-node faces, 1:5 27 and 14, 1:1000 91 and 13.
    """
    cells, triangles = interface.cells_on(side), interface.triangles_on(side)
    young, poisson = np.moveaxis(scene.moduli[scene.cell_material[cells]], 2, 0)
    points = scene.side_points(interface, side)
    quadratic = triangles.shape[1] == 6
    h = size_at(scene, interface, side)
    if settings.thickness == "auto":
        thickness = h
        if interface.mortar is not None and interface.law.as_one:
            thickness = thickness_between(h,
                                          seen_from(interface, size_at(scene, interface, 1 - side),
                                                    side), young)
    else:
        thickness = np.full(len(points), float(settings.thickness))
    if settings.poisson == "auto":
        nu = np.minimum(poisson.min(axis=1), 0.3)
    else:
        nu = np.full(len(young), float(settings.poisson))
    if interface.law.perfect:
        ratio = settings.modulus_ratio
    else:
        reach = np.sqrt(h * scene.sizes[list(interface.subdomains)].min())
        ratio = settings.contact_ratio * (thickness / reach)[triangles].mean(axis=1)
    thin = THIN if kind == "springs" else 1.0
    if kind == "springs" and not interface.law.perfect:
        thickness = thickness / stiffer(scene, interface, side)
    E = young.max(axis=1) if interface.law.as_one else between(*young.T)
    if side == 0 and interface.mortar is not None and interface.law.as_one:
        E = np.where(pointless(interface), young[:, 0], E)
    corners = np.repeat(E[:, None], 3, axis=1)
    if kind == "springs" and not (interface.law.perfect or interface.law.as_one):
        corners = between(*moduli_at(scene, interface, side))[triangles[:, :3]]
    stiffen, stretch = (STIFFEN, STRETCH) if quadratic else (1.0, 1.0)
    return Facets(points, triangles, np.reshape(thin * stiffen * ratio, (-1, 1)) * corners, nu,
                  thin * stretch * thickness)


def moduli_at(scene: Scene, interface: Interface, side: int) -> list[np.ndarray]:
    """Return the moduli (n,) of both bodies at the nodes of a side, 0 or 1.

    A node meets all elements around it, each by its share of ∫ |∇φ|². Where stiff and soft cells
    are mixed a facet may lie between a soft cell and a stiff one, though both bodies are stiff at
    its nodes: two blocks of bricks 1:1000 take 178 iterations with springs of facets, 32 so.
    """
    found = []
    for e, nodes in zip(interface.subdomains, interface.nodes):
        s = scene.subdomains[e]
        young = scene.moduli[s.material, 0]
        share = np.ones(len(nodes))  # of the largest, to the letter where all are alike
        if young.min() < young.max():
            row = first_row(s, nodes)
            cells = s.connectivity[row, :4]
            gradients, volumes = shape_gradients(scene.mesh.nodes[s.nodes], cells)
            weight = np.einsum("eai,eai->ea", gradients, gradients) * volumes[:, None]
            own, whole = (np.bincount(cells.ravel(), (weight * part).ravel(), len(s.nodes))[nodes]
                          for part in (young[row, None] / young.max(), 1.0))
            share = np.divide(own, whole, out=share, where=whole > 0)
        found.append(young.max() * share)
    if not interface.paired:
        across = found[1 - side]
        found[1 - side] = (seen_from(interface, across, side) if np.ptp(across)
                           else np.full(len(found[side]), across.max(initial=0.0)))
    return found


def pointless(interface: Interface) -> np.ndarray:
    """(k,) bool, facets of the slave of an interface whose nodes do not match that have a free node
    without a point: with six nodes
    each, all of them."""
    alone = interface.free.any(axis=1)
    alone[interface.mortar.points] = False
    return alone[interface.triangles].any(axis=1)


def size_at(scene: Scene, interface: Interface, side: int) -> np.ndarray:
    """(n,) distance of the nodes that count on a side: half the facets' size with ten-node tets
    whose nodes are points.
    """
    triangles = interface.triangles_on(side)
    half = triangles.shape[1] == 6 and interface.law.as_one
    return local_size(scene.side_points(interface, side), triangles) / (2 if half else 1)


def stiffer(scene: Scene, interface: Interface, side: int) -> np.ndarray:
    """(n,) factor on the stiffness of a sole of springs at the nodes of side 0 (the first) or 1,
    where nodes do not couple.

    Such a spring serves all waves that move its node. The longest, of the body's size L, meet E
    A/L, A being the node's area on the interface. The shortest, the node alone, meet E A'/h, A'
    being its area on all interfaces of the body together: at an edge between grains each of them
    has but a part of what moves as one. The geometric mean is √(A'/A) times E A/√(h L). A node of
    one interface is left as it is, and with it uniform pressure between two blocks, which springs
    in proportion to their areas pass on without an error. Beside a prescribed node all the yielding
    is the other side's: twice the spring. 1 where a node has no area, and where nodes do not match:
    there a point has many nodes behind it.
    """
    if not interface.matching:
        return np.ones(len(interface.nodes[side]))
    corners = interface.triangles[:, :3]
    area = node_areas(scene.side_points(interface, side), corners, CORNER_SHARES[3])
    ends = [(scene.subdomains[e], nodes) for e, nodes in zip(interface.subdomains, interface.nodes)]
    total = 0.5 * sum(s.contact_area[nodes] for s, nodes in ends)
    factor = np.sqrt(np.divide(total, area, out=np.ones(len(area)), where=area > 0))
    one, two = (s.fixed[nodes] for s, nodes in ends)
    factor[(one != two).any(axis=1)] *= WALL
    return factor


def thickness_between(h: np.ndarray, opposite: np.ndarray, young: np.ndarray) -> np.ndarray:
    """(n,) thickness of the sole of a bonded side whose facets are of size h (n,), those opposite
    of another (n,).

    That of the finer side where both are alike, of the coarser where moduli (k, 2) differ much.
    Measured with sizes 1:3, iterations to 1e-6: 13 with the finer, 14 each with its own, 16 with
    the coarser, 13 on matching meshes of the finer size; with moduli 1:1000 as well 20 to 27, 17 to
    23, 16 to 19, and 23.
    """
    low, high = np.sort(young.mean(axis=0))
    return np.maximum(h, opposite) if high > CONTRAST * low else np.minimum(h, opposite)


def seen_from(interface: Interface, values: np.ndarray, side: int) -> np.ndarray:
    """(n,) at the nodes of a side, 0 or 1, what the other one has opposite, averaged with the size
    of the transfer's weights; the
    mean of all where there is none."""
    mortar = interface.mortar
    weights = scalar(abs(mortar.second))
    if side == 0:
        at, weights = mortar.points, sp.csr_array(weights)
    else:
        at, weights, values = np.arange(weights.shape[1]), sp.csr_array(weights.T), values[
            mortar.points]
    total = weights.sum(axis=1)
    result = np.full(len(interface.nodes[side]), values.mean())
    result[at[total > 0]] = (weights @ values)[total > 0] / total[total > 0]
    return result


def between(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """The modulus that counts where sides of moduli (k,) press on each other: the harmonic mean of
    √E, squared.

    The softer side does nearly all the yielding, so that the stiffer one's modulus must drop out:
    beside a rigid body this is four times the softer modulus. Two springs in series, the mean
    behind Hertz's contact modulus, would give twice, which took 1.3 times the iterations of equal
    moduli; beside a nearly rigid body four to ten times takes as many as those.
    """
    low, high = np.minimum(one, two), np.maximum(one, two)
    return low * (2 / (1 + np.sqrt(low / high))) ** 2
