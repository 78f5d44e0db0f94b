"""Mortar operators of an interface whose sides are meshed each on its own: its points and two
transfer operators.

Side 1 is the slave: it carries the points, with their law, normal, gap and history. Side 2 is the
master. With the traces w₁, w₂ of either side and the forces q of the points (on side 1; −q on side
2),

    d = G₂ w₂ − G₁ w₁,      f₁ = G₁ᵀ q,      f₂ = −G₂ᵀ q,      pressure = −n·q / area

All rows of both operators sum to 1 per component, and G₁ x₁ = G₂ x₂ on plane faces that touch.
Where the faces are apart or curved a rigid link carries each point from the master.

On planes of symmetry a component is prescribed on both sides. The whole body's point has nothing
there: its force, its offset from the master, its normal lie in the plane. So its rows of that
component are empty, and the others are those of the whole.

A node carries no point where it is prescribed altogether, or along its normal on both sides, or
where it follows the point of a rigid surface or stands on a ground that holds it (a multiplier
there would meet nothing, or pin the master), where several interfaces that do not match meet (their
constraints would be redundant), and where the master covers little of the facets around (the point
would carry a large pressure on a small area). Its multiplier goes to the points next to it, in
parts as the edges have facets: no area and no force is lost, and the normal is that of the area
vectors together, so that constant pressure passes. On a plane of symmetry the missing half takes
back what it adds to components that are held there, and to rotations about the others. Under laws
that join the sides a slave's node that is held alone carries none either: it could not follow the
master.

The master carries each point like an arm, so that rigid motions open nothing. Where the master's
image P x₂ of a point is r away from the point, a rotation of both bodies would open it, and
opposite forces would be a couple. With ω the rotation of the master's facets, their least squares
fit, averaged with the same weights as P,

    (P̃ w₂)ᵢ = (P w₂)ᵢ + ωᵢ × rᵢ,    ω = H Σᵥ Yᵥ × wᵥ,
    H = (Σᵥ |Yᵥ|² I − Yᵥ Yᵥᵀ)⁻¹,    Y = X − mean X,

and forces P̃ᵀ q have the resultant and the moment of q at the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.kept import kept
from orchestrator.linalg import SAME, WRITTEN
from orchestrator.scene.interfaces.mortar.duals import Weights, cleaned
from orchestrator.scene.interfaces.mortar.segments import Segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.mesh.geometry import rounding, skew, unit
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES


@dataclass(frozen=True)
class Mortar:
    """Points and transfer operators of an interface whose nodes do not match; p points, n₁ slave
    and n₂ master nodes.

    Slave and master nodes are those of ``Interface.nodes``, which then are no pairs: (n₁,) local
    nodes of side 1 and (n₂,) of side 2, all of those that carry something and no others. Columns
    are numbered 3 × node + component, rows 3 × point + component.

    points : (p,) int, ascending, which of the slave nodes carry a point. The others are prescribed,
        lie on several such interfaces or are hardly covered; their share of the force goes to
        neighbours
    first, second : G₁ (3p, 3n₁) and G₂ (3p, 3n₂), sparse. Columns of prescribed components are
        there: times what is prescribed, they give the known part of the jump
    area : (p,) that each point stands for, seen along its normal unless ``spread``; on plane
        faces they sum to what the sides have in common
    normal : (p, 3) unit, from side 1 to side 2
    gap : (p,) distance of the sides along it, of the surfaces that facets stand for, negative
        inside each other; whether it counts is the law's business
    triangles : (k₂, 3 or 6) int, the master's facets, indices into its nodes, the corners first;
        turned to look from side 1 to side 2, as those of the slave in ``Interface.triangles`` do
    cells : (k₂, 2) int, global cells behind each of these: the one opposite in side 1, and its own
        in side 2
    free : (n₂, 3) bool, components of the master's nodes that nothing prescribes;
        ``Interface.free`` has the slave's
    hats : (3n₁, 3p) sparse, displacements of the slave's nodes when one component of one point
        moves by 1: of its own node alone, or, on faces of six nodes, along its linear function, by
        half in the middle of edges
    live : (p, 3) bool, components that laws act in: not those that are prescribed on both sides
    overlaps : of the facets of both sides, the slave's first, where bonded faces of six nodes leave
        leaps; else None
    """

    points: np.ndarray
    first: sp.csr_array
    second: sp.csr_array
    area: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    triangles: np.ndarray
    cells: np.ndarray
    free: np.ndarray
    hats: sp.csr_array
    live: np.ndarray
    overlaps: Segments | None = None

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def own(self) -> sp.csr_array:
        """(3p, 3p) G₁ times ``hats``: forces f₁ = G₁ᵀ q come from q = own⁻ᵀ hatsᵀ f₁.

        Diagonal, and the identity where no neighbour has been merged; on faces of six nodes a mass
        matrix of P1 functions, which conditions well.
        """
        return (self.first @ self.hats).tocsr()

    @cached_property
    def dofs(self) -> np.ndarray:
        """(3p,) columns of G₁ that belong to the points' own nodes."""
        return (3 * self.points[:, None] + np.arange(3)).ravel()

    def places(self, operator: sp.csr_array, nodes: np.ndarray) -> np.ndarray:
        """(p, 3) where forces of points act that ``first``, or ``second`` without a link, spreads
        over the nodes (n, 3) of its side."""
        shares = scalar(operator)
        return shares @ nodes / np.maximum(shares.sum(axis=1), SAME)[:, None]

    @property
    def paired(self) -> bool:
        """Whether both sides have the same faces, node by node."""
        return self.second is self.first

    @property
    def carrying(self) -> np.ndarray:
        """(p,) bool, points that carry something: not those of sides that slide on whose nodes the
        master does not reach now.
        """
        return self.area > 0

    @property
    def diagonal(self) -> bool:
        """Whether each point meets its own node alone, so that it can be eliminated by a
        division.
        """
        own = self.own.tocoo()
        return bool((own.row == own.col).all())


TURNED = [0, 2, 1, 5, 4, 3]  # a facet's nodes, looked at from behind


@kept
def make_mortar(surfaces: Surfaces, free: tuple[np.ndarray, np.ndarray], crossed: np.ndarray,
                as_one: bool = False, vectors: np.ndarray | None = None,
                held: np.ndarray | None = None, spread: bool = False) -> Mortar:
    """Points and transfer operators.

    surfaces : slave and master
    free : (n₁, 3), (n₂, 3) bool, components that nothing prescribes
    crossed : (n₁,) bool, slave nodes that other interfaces without matching nodes share and that
        have no point here
    as_one, spread : as the law is
    vectors : (n₁, 3) along the normals, where more facets than these shape them
    held : (n₁, 3) bool, components that are prescribed on both sides; None: as ``Surfaces.held``
        has it
    """
    weights, triangles, (x1, x2) = surfaces.weights, surfaces.triangles, surfaces.points
    held = surfaces.held(weights, tuple(~side for side in free)) if held is None else held
    normal = surfaces.upright(held, vectors)
    candidates = weights.share > 0
    wanted = candidates & may_carry(free[0], held, normal, as_one) & (weights.area > 0)
    stands_for = weights.area if surfaces.amid else weights.share * weights.around
    for better in (~crossed, stands_for >= COVERED * weights.around):
        # where there are none of these, one is better than none; more would say twice what other
        # interfaces say
        most = np.arange(len(wanted)) == np.argmax(wanted * weights.area)
        wanted = wanted & better if (wanted & better).any() else wanted & most
    points, sums = merged(candidates, wanted, surfaces.carriers)
    stands = sums @ weights.area
    seen = sums @ (weights.area[:, None] * _shortened(surfaces, normal) * normal)
    scaled = sp.kron(sp.diags_array(1 / stands) @ sums, np.eye(3))
    upright = np.abs(np.where(held, normal, 0.0)).max(axis=1, keepdims=True) <= WRITTEN
    gone = held & upright  # nodes on planes of symmetry, not under supports of the faces
    gone[points] = False
    own, other, facets = (
        cleaned(sp.csr_array(scaled @ sp.diags_array(1.0 - lost.ravel()) @ sp.kron(m, np.eye(3))),
                np.ones(3 * len(points)))
        for m, lost in ((weights.own, gone), (weights.other, gone),
                        (weights.facets, gone[:, [1, 2, 0]] | gone[:, [2, 0, 1]])))
    offset = (own @ x1.ravel() - other @ x2.ravel()).reshape(-1, 3)
    offset[np.linalg.norm(offset, axis=1) <= _nothing(surfaces)[points]] = 0.0
    at, held = unit(seen), held[points]
    offset[held & (at == 0)] = 0.0
    # what G₂ and G₁ make of the distance: a point that stands for its neighbours as well has
    # theirs, too
    gap = -np.einsum("pi,pi->p", at, offset) - (sums @ (weights.area * surfaces.filled)) / stands
    turned, live = triangles[1][:, TURNED[: triangles[1].shape[1]]], ~held
    second = linked(other, facets, offset, x2, triangles[1][:, :3])
    return Mortar(points, only(own, live), only(second, live),
                  stands if spread else np.linalg.norm(seen, axis=1), at,
                  gap, turned,
                  surfaces.behind[1], free[1], hats(points, triangles[0]), live)


def scalar(operator: sp.csr_array) -> sp.csr_array:
    """(p, n) what an operator (3p, 3n) has between the same components, summed over those that
    there are."""
    return sp.csr_array(sum(operator[c::3, c::3] for c in range(3)))


def may_carry(free: np.ndarray, held: np.ndarray, normal: np.ndarray, as_one: bool) -> np.ndarray:
    """(n,) bool, nodes with components (n, 3) that are free, or held on both sides, which leave
    something to a law.

    Parameters as of ``make_mortar``; normal : (n, 3)
    """
    left = np.linalg.norm(np.where(held, 0.0, normal), axis=1) > WRITTEN
    return free.any(axis=1) & left & ((free | held).all(axis=1) | (not as_one))


def _shortened(surfaces: Surfaces, normal: np.ndarray) -> np.ndarray:
    """(n₁, 1) share of the facets' area around nodes that is seen along normals (n₁, 3)."""
    third, seen = surfaces.facets[0].area / 3, np.einsum("ni,ni->n", surfaces.vectors, normal)
    whole = np.bincount(surfaces.carriers.ravel(), np.repeat(third, 3), len(normal))
    return (seen / np.where(whole > 0, whole, 1.0))[:, None]


def only(operator: sp.csr_array, live: np.ndarray) -> sp.csr_array:
    """An operator (3p, 3n) with empty rows but for the components live (p, 3) bool."""
    if live.all():
        return operator
    result = sp.csr_array(sp.diags_array(live.ravel().astype(float)) @ operator)
    result.eliminate_zeros()
    return result


def hats(points: np.ndarray, triangles: np.ndarray) -> sp.csr_array:
    """(3n, 3p) linear functions of the points at the nodes of the facets: picks where these have
    three.
    """
    count = int(triangles.max(initial=-1)) + 1
    nodes = sp.eye_array(count, format="csr")
    if triangles.shape[1] == 6:
        pairs = np.unique(
            np.concatenate([np.c_[triangles[:, 3:].ravel(), triangles[:, ends].ravel()]
                                          for ends in TRIANGLE_EDGES.T]), axis=0)
        nodes = sp.csr_array(nodes + sp.csr_array((np.full(len(pairs), 0.5), pairs.T),
                                                  shape=nodes.shape))
    return sp.csr_array(sp.kron(nodes[:, points], sp.eye_array(3), format="csr"))


def node_gaps(surfaces: Surfaces, weights: Weights, normal: np.ndarray) -> np.ndarray:
    """(n₁,) distance of the facets along the normals (n₁, 3) at the slave's nodes, averaged with
    their multipliers; zero where
    there is none. What their surfaces fill of it has ``Surfaces.filled``."""
    x1, x2 = surfaces.points
    apart = (weights.other @ x2 - weights.own @ x1) / np.where(weights.area > 0, weights.area, 1.0)[
        :, None]
    apart[np.linalg.norm(apart, axis=1) <= _nothing(surfaces)] = 0.0
    return np.einsum("ni,ni->n", normal, apart)


def _nothing(surfaces: Surfaces) -> np.ndarray:
    return rounding(surfaces.points[0], SAME * surfaces.size)


def covered_around(surfaces: Surfaces) -> np.ndarray:
    """(n₁,) area around the slave's nodes with multipliers that the master covers."""
    area = np.bincount(surfaces.segments.slave, surfaces.segments.area,
                       minlength=len(surfaces.triangles[0]))
    return np.bincount(surfaces.carriers.ravel(), np.repeat(area, 3), len(surfaces.points[0]))


# Share of the facets around a node that the master has to cover. Measured with a punch on a wider
# slab: from .2 the largest
# pressure is that of the punch as slave, below it grows.
COVERED = 0.2


def merged(candidates: np.ndarray, wanted: np.ndarray,
           triangles: np.ndarray) -> tuple[np.ndarray, sp.csr_array]:
    """The points, and how the multipliers of all nodes are added up to theirs.

    candidates : (n,) bool, nodes that have a multiplier
    wanted : (n,) bool, those that may carry a point
    triangles : (k, 3) int, the nodes of the facets that may have one
    Returns points : (p,) int, ascending; none where no node may carry one
    sums : (p, n) each column sums to 1 where there is a multiplier; the identity where nothing is
        merged
    """
    count = len(candidates)
    wanted = wanted & candidates
    points = np.flatnonzero(wanted)
    place = np.cumsum(wanted) - 1
    sums = sp.csr_array((np.ones(len(points)), (place[points], points)), shape=(len(points), count))
    left = candidates & ~wanted
    if not left.any() or not len(points):
        return points, sums
    ends = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    ends = np.concatenate([ends, ends[:, ::-1]])
    # an edge on a plane of symmetry has one facet of its two here, and one of two such shares
    beside = sp.csr_array((np.ones(len(ends)), ends.T), shape=(count, count))
    known = wanted
    while left.any():
        near = sp.csr_array(beside[np.flatnonzero(left)] * known[None, :])
        near.eliminate_zeros()
        weight = near.sum(axis=1)
        if not weight.any():  # a piece without any point: to the first of all, rather than lost
            break
        found = np.flatnonzero(left)[weight > 0]
        shares = sp.csr_array(sp.diags_array(1 / weight[weight > 0]) @ near[weight > 0])
        given = sp.csr_array(shares @ sums.T).tocoo()  # (found, p)
        sums = sums + sp.csr_array((given.data, (given.col, found[given.row])), shape=sums.shape)
        known = known.copy()
        known[found], left[found] = True, False
    return points, sp.csr_array(sums)


def rotations(points: np.ndarray, triangles: np.ndarray) -> sp.csr_array:
    """(3k, 3n) the rotation ω of each facet, of displacements of its corners.

    points : (n, 3); triangles : (k, 3) int
    """
    arm = points[triangles] - points[triangles].mean(axis=1, keepdims=True)
    inertia = np.einsum("kvi,kvi->k", arm, arm)[:, None,
                                                None] * np.eye(3) - np.einsum(
                                                    "kvi,kvj->kij", arm, arm)
    blocks = np.linalg.inv(inertia)[:, None] @ skew(arm)  # (k, corner, 3, 3)
    return sp.bsr_array((blocks.reshape(-1, 3, 3), triangles.ravel(),
                         3 * np.arange(len(blocks) + 1)),
                        shape=(3 * len(blocks), points.size)).tocsr()


def linked(plain: sp.csr_array, facets: sp.csr_array, offset: np.ndarray,
           points: np.ndarray, triangles: np.ndarray) -> sp.csr_array:
    """(3p, 3n) P ⊗ I with the rigid link.

    plain : (3p, 3n) P ⊗ I; facets : (3p, 3k) the weights with which facets give rotations
    offset : (p, 3) r; zero where there is no link
    points, triangles : the master's, (n, 3) and (k, 3)
    """
    if not offset.any():
        return plain
    each = np.arange(len(offset) + 1)
    # ω × r = −r × ω
    arms = sp.bsr_array((-skew(offset), each[:-1], each), shape=2 * facets.shape[:1])
    return sp.csr_array(plain + arms.tocsr() @ (facets @ rotations(points, triangles)))
