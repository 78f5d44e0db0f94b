"""Areas, volumes, gradients, shapes of tets; local size, area and normals at the nodes of a patch;
order.

Nodes amid edges play no part unless told.

Normals at nodes that supports hold in some components, on both sides of an interface.

What both sides have prescribed neither opens nor slips: the law lives on the other components.
"""

from __future__ import annotations

import numpy as np

from orchestrator.linalg import PLACED, SAME, WRITTEN
from orchestrator.scene.mesh.faces import LOCAL_FACES


# Two corners, or the two faces, of each of the six edges.
PAIRS = [(i, j) for i in range(4) for j in range(i)]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k, 3) vector products; four times as fast as numpy's, which is made for any axis and
    dimension.
    """
    (a1, a2, a3), (b1, b2, b3) = a.T, b.T
    result = np.empty((3, len(a)))
    result[0], result[1], result[2] = a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1
    return result.T


def area_vectors(nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(k, 3) normals of triangles (k, 3 or 6), each as long as the triangle's area."""
    p, q, r = (nodes[triangles[:, i]] for i in range(3))
    return cross(q - p, r - p) / 2


def areas(nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(k,) areas of triangles (k, 3 or 6)."""
    return np.linalg.norm(area_vectors(nodes, triangles), axis=1)


def facet_normals(nodes: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k, 3) unit normals of triangles (k, 3 or 6), and their areas (k,)."""
    vectors = area_vectors(nodes, triangles)
    area = np.linalg.norm(vectors, axis=1)
    return vectors / area[:, None], area


def tet_volumes(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) volumes of tets (m, 4 or 10), positive where the fourth corner is on the side that the
    first three turn to.
    """
    p, q, r, s = (nodes.take(corner, axis=0) for corner in cells[:, :4].T)
    for corner in (q, r, s):  # copies, and large ones
        corner -= p
    return np.einsum("ij,ij->i", cross(q, r), s) / 6


def barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(k, 4) barycentric coordinates of points (k, 3), or of one (3,), in tets of corners (k, 4,
    3).
    """
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    rest = np.linalg.solve(edges, (points - corners[:, 0])[:, :, None])[:, :, 0]
    return np.column_stack([1 - rest.sum(axis=1), rest])


def skew(vectors: np.ndarray) -> np.ndarray:
    """(…, 3, 3) matrices of v ×."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape, 3)


def shape_gradients(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 4, 3) gradients of the four linear shape functions, 1/length, and (m,) volumes, positive
    for positively oriented tets.

    nodes : (n, 3) float; cells : (m, 4 or 10) int, edges straight
    """
    corners = nodes.T.take(cells[:, :4].T, axis=1)
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    gradients = np.empty((4, 3, len(cells)))
    for one, (p, q) in zip(gradients[1:], ((b, c), (c, a), (a, b))):
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            np.subtract(p[y] * q[z], p[z] * q[y], out=one[x])
    six_volumes = (a * gradients[1]).sum(axis=0)
    gradients[1:] /= six_volumes
    np.negative(gradients[1:].sum(axis=0), out=gradients[0])
    return gradients.transpose(2, 0, 1), six_volumes / 6.0


PLACES = 64 * np.finfo(float).eps


def local_size(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) local mesh size at points (n, 3) of triangles (k, 3 or 6): √(2 × mean area of the
    adjacent ones); 0 where there is none.

    On a structured patch of right triangles this is the length of their legs.
    """
    area = areas(points, triangles)
    count = np.bincount(triangles.ravel(), minlength=len(points))
    total = np.bincount(triangles.ravel(), weights=np.repeat(area, triangles.shape[1]),
                        minlength=len(points))
    return np.sqrt(2 * total / np.maximum(count, 1))


def rounding(points: np.ndarray, h: np.ndarray | float) -> np.ndarray:
    """(n,) distances that are rounding where elements measure some h (n,): a share of h, or units
    in the last place of the
    coordinates that may add up on the way."""
    return np.maximum(h, PLACES * np.abs(points).max(initial=0.0))


def node_areas(points: np.ndarray, triangles: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(n,) the area of triangles (k, 3 or 6) around each of points (n, 3), by shares (3 or 6,) of
    each triangle."""
    each = areas(points, triangles)[:, None] * shares
    return np.bincount(triangles.ravel(), weights=each.ravel(), minlength=len(points))


def summed(at: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """(count, c) sums of values (…, c) at places (…) int."""
    return np.stack([np.bincount(at.ravel(), one.ravel(), count)
                     for one in np.moveaxis(values, -1, 0)], axis=1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """(…, 3) of length 1, or 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def node_vectors(points: np.ndarray, triangles: np.ndarray, shares: np.ndarray,
                 normals: np.ndarray | None = None) -> np.ndarray:
    """Return ∫ Nᵢ n dA at points (n, 3), (n, 3): a pressure p along them is p on the triangles, in
    equilibrium.

    triangles : (k, 3 or 6) int
    shares : (3 or 6,) ∫ Nᵢ over a triangle, a share of its area
    normals : (k, 3 or 6, 3) at its nodes, of a surface that it stands for; nan, or none: its own
    """
    vectors, result = area_vectors(points, triangles), np.zeros_like(points)
    for place in np.flatnonzero(shares):
        own = vectors
        if normals is not None:
            known = normals[:, place]
            size = np.linalg.norm(vectors, axis=1, keepdims=True)
            own = np.where(np.isnan(known), vectors, size * known)
        for axis in range(3):
            result[:, axis] += np.bincount(triangles[:, place], shares[place] * own[:, axis],
                                           len(points))
    return result


def node_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals at points (n, 3): mean of the normals of triangles (k, 3 or 6) weighted
    by their angle there.

    In the middle of an edge all angles are the same.
    """
    corners = points[triangles[:, :3]]
    normal, result = facet_normals(points, triangles)[0], np.zeros_like(points)
    for i in range(3):
        u = corners[:, (i + 1) % 3] - corners[:, i]
        v = corners[:, (i + 2) % 3] - corners[:, i]
        cosine = np.einsum("ij,ij->i", u, v) / (np.linalg.norm(u, axis=1)
                                                * np.linalg.norm(v, axis=1))
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(result, triangles[:, i], angle[:, None] * normal)
    for middle in triangles[:, 3:].T:
        np.add.at(result, middle, np.pi * normal)
    return unit(result)


def position_rank(points: np.ndarray) -> np.ndarray:
    """(n,) int, rank of each point in the order of x, then y, then z, blind to rounding and to
    units.
    """
    low, extent = points.min(axis=0), max(np.ptp(points, axis=0).max(), np.finfo(float).tiny)
    rank = np.empty(len(points), dtype=int)
    rank[np.lexsort(np.rint((points - low).T[::-1] / extent / PLACED))] = np.arange(
        len(points))
    return rank


def roundness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) gmsh's gamma: three radii of the inscribed ball over that of the circumscribed one; 1 is
    regular, < 0 inverted.
    """
    area = sum(areas(nodes, cells[:, face]) for face in LOCAL_FACES)
    volume = tet_volumes(nodes, cells)
    a, b, c = (nodes[cells[:, i]] - nodes[cells[:, 0]] for i in (1, 2, 3))
    # From the first corner to the ball's centre, times twelve volumes.
    centre = sum(np.einsum("ij,ij->i", p, p)[:, None] * cross(q, r)
                 for p, q, r in ((a, b, c), (b, c, a), (c, a, b)))
    return 108 * volume * np.abs(volume) / (area * np.linalg.norm(centre, axis=1))


def dihedral_angles(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m,) smallest and (m,) largest angle in degrees between two faces of each tet; nan where a
    face has no area.
    """
    normals = [area_vectors(nodes, cells[:, face]) for face in LOCAL_FACES]
    with np.errstate(invalid="ignore"):
        normals = [normal / np.linalg.norm(normal, axis=1)[:, None] for normal in normals]
    cosines = np.array([np.einsum("ij,ij->i", normals[i], normals[j]) for i, j in PAIRS])
    # Outward normals make the angle's supplement.
    sharp, blunt = np.degrees(
        np.arccos(np.clip([-cosines.min(axis=0), -cosines.max(axis=0)], -1, 1)))
    return sharp, blunt


def dihedral_range(nodes: np.ndarray, cells: np.ndarray) -> tuple[float, float]:
    """Smallest and largest angle in degrees between two faces of a tet."""
    sharp, blunt = dihedral_angles(nodes, cells)
    return float(sharp.min()), float(blunt.max())


def format_point(point: np.ndarray) -> str:
    """Coordinates for a message: (1, 2.5, 0); what rounding leaves of a zero beside others is
    zero.
    """
    least = SAME * max((abs(float(x)) for x in point), default=0.0)
    return "(" + ", ".join(f"{float(x) if abs(x) > least else 0.0:.6g}" for x in point) + ")"


def within(normal: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (n, 3) within the components that are free, (n, 3) bool, and the length
    (n,) left of each.

    Only that part of the pressure is felt, so that a gap and a friction coefficient grow by
    1/length. Where the normal itself is prescribed it stays what it is: nothing presses.
    """
    inside = np.where(free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1)
    length = np.where((length > WRITTEN) & ~free.all(axis=1), length, 1.0)
    return np.where((length < 1.0)[:, None], inside / length[:, None], normal), length


def mirrored(normals: np.ndarray, vectors: np.ndarray, triangles: np.ndarray,
             held: np.ndarray) -> np.ndarray:
    """Return unit normals (n, 3), at planes of symmetry without what the missing half would take
    back.

    At the rim of a symmetric half facets' mean normals lean off the plane by what a curved face
    turns within a facet; the true normal does not. So a component that is held on both sides is
    left out where facets nearby differ in it by as much. On plane faces they do not, nor do they
    where a face runs into a support at an angle.

    vectors : (k, 3) along the facets' normals; held : (n, 3) bool
    """
    if not held.any():
        return normals
    turns = spread(unit(vectors), triangles, len(normals))
    inside = np.where(held & (np.abs(normals) <= turns), 0.0, normals)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    return np.where(length > 0, inside / np.where(length > 0, length, 1.0), normals)


def spread(normals: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """Return (n, 3) by how much the normals (k, 3) of facets near each node differ."""
    return _around(normals, triangles, count) + _around(-normals, triangles, count)


def _around(values: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """(n, c) the largest of values (k, c) of facets that meet a node, or a facet that does."""
    for _ in range(2):
        at = np.full((count, values.shape[1]), -np.inf)
        np.maximum.at(at, triangles.ravel(), np.repeat(values, triangles.shape[1], axis=0))
        values = at[triangles].max(axis=1)
    return at
