"""The thin layer of tets behind the joints of a part whose mesh is not ours.

It stands for the part wherever geometry is asked for: faces that look at other parts, their
normals, areas and sizes, the thickness of soles. Nothing of it is ever assembled: the part's own
stiffness acts on its joint nodes, and the layer's inner nodes have none. Where supports inside hold
the part, the inner nodes are held instead, so that rigid motions are counted as they are. Whether
its joints meet anything is told once the interfaces are known.

Joints are cut in triangles as what they meet is, so that nodes that coincide are paired: a
quadrilateral has two diagonals, a flat set of nodes many triangulations, and none of them is the
part's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.errors import KeyPath, Problems, wrong
from orchestrator.scene.foreign.joints import Joints, components_held
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import area_vectors, format_point, local_size
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering, StandIn
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.names import INSIDE
from orchestrator.scene.soles.facets import Facets
from orchestrator.scene.soles.make import prisms

PASSES = 50  # in each of them a triangle takes part in one exchange of diagonals


def outer_surfaces(mesh: Mesh) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points (n, 3) and outer triangles (k, 3) of each volume."""
    faces = faces_of(mesh.cells, len(mesh.nodes))
    beside = np.where(faces.neighbour < 0, -1, mesh.volume[faces.neighbour])
    outer = np.flatnonzero(mesh.volume[faces.owner] != beside)
    volume = mesh.volume[faces.owner[outer]]
    return [(mesh.nodes, faces.triangles[outer[volume == v]]) for v in range(len(mesh.volumes))]


def fitted(joints: Joints, others: list[tuple[np.ndarray, np.ndarray]]) -> Joints:
    """Flip diagonals to edges of other bodies wherever they can be.

    others : points (n, 3) and triangles (k, 3) of the surface of each other body
    """
    triangles = joints.triangles.copy()
    if (joints.face >= 0).any():
        near = COINCIDE * local_size(joints.points, triangles)
        for points, surface in others:
            _fit(triangles, joints, _counterparts(joints.points, near, points, surface), surface,
                 len(points))
    return replace(joints, triangles=triangles)


def _counterparts(own: np.ndarray, near: np.ndarray, points: np.ndarray,
                  surface: np.ndarray) -> np.ndarray:
    """(n,) int, the points of another body's surface that joint nodes coincide with; -1: none."""
    from scipy.spatial import cKDTree  # only such parts need it

    used = np.unique(surface)
    low, high = points[used].min(axis=0) - near.max(), points[used].max(axis=0) + near.max()
    if (own.min(axis=0) > high).any() or (own.max(axis=0) < low).any():
        return np.full(len(own), -1)
    distance, place = cKDTree(points[used]).query(own)
    return np.where(distance <= near, used[place], -1)


def _fit(triangles: np.ndarray, joints: Joints, other: np.ndarray, surface: np.ndarray,
         count: int) -> None:
    """Exchanges diagonals of triangles (k, 3), in place, that are none of the other's edges for
    those that are.
    """
    if (other >= 0).sum() < 4:
        return
    edges = np.unique(_keys(surface[:, TRIANGLE_EDGES].reshape(-1, 2), count))
    for _ in range(PASSES):
        key = _keys(triangles[:, TRIANGLE_EDGES].reshape(-1, 2), len(joints.points))
        order = np.argsort(key, kind="stable")
        twice = np.flatnonzero(key[order][1:] == key[order][:-1])
        # half-edges 3 triangle + side, shared by two triangles
        one, two = order[twice], order[twice + 1]
        (s, i), (t, j) = (one // 3, one % 3), (two // 3, two % 3)
        a, b, c, d = triangles[s, i], triangles[s,
                                                (i + 1) % 3], triangles[s, (i + 2) % 3], triangles[
                                                    t, (j + 2) % 3]
        mapped = other[np.column_stack([a, b, c, d])]
        wanted = (joints.face[s] >= 0) & (joints.face[s]
                                          == joints.face[t]) & (mapped >= 0).all(axis=1)
        wanted &= ~np.isin(_keys(mapped[:, :2], count),
                           edges) & np.isin(_keys(mapped[:, 2:], count), edges)
        first, second = np.column_stack([c, a, d]), np.column_stack([d, b, c])
        before, after = area_vectors(joints.points,
                                     triangles[s]), [area_vectors(joints.points, x)
                                                     for x in (first, second)]
        wanted &= (np.einsum("ij,ij->i", before, after[0]) > 0) & (
            np.einsum("ij,ij->i", before, after[1]) > 0)
        chosen = np.flatnonzero(wanted)
        _, place = np.unique(np.concatenate([s[chosen], t[chosen]]), return_index=True)
        # both triangles are first asked by this edge
        free = np.bincount(place % max(len(chosen), 1), minlength=len(chosen)) == 2
        chosen = chosen[free]
        if not len(chosen):
            return
        triangles[s[chosen]], triangles[t[chosen]] = first[chosen], second[chosen]


def _keys(pairs: np.ndarray, count: int) -> np.ndarray:
    """One integer for each pair (k, 2), whatever their order."""
    return pairs.min(axis=1) * count + pairs.max(axis=1)


# Thickness over the size of the faces: thin beside the part, thick beside rounding.
THICKNESS = 0.25
# Along this direction, of no symmetry, the layer gets thinner to either side: inner nodes that lay
# on a plane could turn about
# axes in it when held along that plane, as the part cannot.
SLANTED = np.array([0.45, 0.6, 0.66])


def stand_in(joints: Joints, name: str, path: KeyPath) -> Mesh:
    """The mesh of the layer; the joints' nodes come first, in their order.

    name : of the part
    path : of its entry in the YAML
    Raises InputError: joint nodes on no face; supports that hold the part in a way that the layer
    cannot
    """
    used = np.zeros(len(joints.points), dtype=bool)
    used[joints.triangles] = True
    if not used.all():
        lost = joints.ids[~used]
        raise wrong(path,
                    f"{len(lost)} joint nodes of '{name}' are on no face of its joints, the first "
                    f"is {lost[0]}",
                    "nodes between which faces of elements lie: of each face all nodes, those in "
                    "the middle of edges too",
                    "leave these nodes out of the joint, or put the rest of their face in it")
    count = len(joints.triangles)
    thinner = 1 - 0.5 * ((joints.points - joints.centre) @ SLANTED / joints.size) ** 2
    facets = Facets(joints.points, joints.triangles, np.ones((count, 3)), np.zeros(count),
                    THICKNESS * thinner * local_size(joints.points, joints.triangles))
    layer = prisms(facets, -1)
    nodes = np.vstack([joints.points, layer.points])
    components = components_held(joints, layer.points)
    if components is None:
        raise wrong(path,
                    f"supports inside '{name}' that leave some of its rigid motions, along no "
                    "axis of the mesh",
                    "supports that hold all of the part, some of its components x, y, z, or "
                    "nothing",
                    "write held: true if they hold all of it (nodes of *RIGID BODY count as points "
                    "here); else turn the model so that what is free is along an axis, or hold the "
                    "part outside, under boundary")
    held = np.zeros(nodes.shape, dtype=bool)
    held[: len(joints.points)] = joints.held
    held[len(joints.points):] = components
    surfaces = {joint: joints.triangles[joints.joint == i] for i, joint in enumerate(joints.names)}
    return Mesh(nodes, layer.cells, np.zeros(len(layer.cells), dtype=int), [name],
                {f"{name}/{joint}": triangles for joint, triangles in surfaces.items()},
                f"{name} (joints)", joints.remarks,
                foreign=[StandIn(0, 0, len(joints.points), held, joints.triangles, joints.size,
                                 joints.quadratic,
                                 None if joints.young is None else (joints.young, joints.poisson))])


# decades between units of stress (Pa, kPa, MPa, GPa), and how near a ratio of moduli is to such
# steps
STEP, NEAR = 3.0, 0.5


def report_joints(mesh: Mesh, interfaces: list[Interface], numbering: SplitNumbering,
                  problems: Problems) -> None:
    """Adds a problem for each such part that meets no other, and a warning for each single joint
    that does not.
    """
    met = np.zeros(len(mesh.nodes), dtype=bool)
    for i in interfaces:
        for e, nodes in zip(i.subdomains, i.nodes):
            met[numbering.nodes[numbering.offsets[e] + nodes]] = True
    own = np.concatenate([np.arange(s.nodes.start, s.nodes.stop) for s in mesh.foreign])
    others = np.delete(mesh.nodes, own, axis=0)
    for stand in mesh.foreign:
        name = mesh.volumes[stand.volume]
        joints = {s[len(name + INSIDE):]: t for s, t in mesh.surfaces.items()
                  if s.startswith(name + INSIDE)}
        lost = [joint for joint, triangles in joints.items() if not met[np.unique(triangles)].any()]
        if len(lost) < len(joints):
            problems.warnings += [f"joint {joint} of {name!r} meets no other part"
                                  for joint in lost]
            continue
        points = mesh.nodes[stand.first : stand.first + stand.joints]
        problems.add(("interfaces",),
                     f"{name!r} meets no other part: its joints reach from "
                     f"{format_point(points.min(axis=0))} to "
                     f"{format_point(points.max(axis=0))}" + _extent(others),
                     "joints that lie on faces of other parts and look at them, and an entry of "
                     "interfaces between them",
                     "name it under interfaces, move the other parts to it (parts: move), make "
                     "units of length the same; faces are given anticlockwise seen from outside, "
                     "outward: points out of the part")


def report_units(mesh: Mesh, interfaces: list[Interface], subdomain: np.ndarray, young: np.ndarray,
                 problems: Problems) -> None:
    """Adds a warning for each such part whose own modulus seems to be in another unit than the
    scene's.

    subdomain : (m,) int, of every tet; young : (m,) the modulus that the YAML, or the part itself,
        gives it
    """
    for stand in mesh.foreign:
        cells = np.flatnonzero(mesh.volume == stand.volume)
        if stand.matter is None or not len(cells):
            continue
        own, name, beside = stand.matter[0], mesh.volumes[
            stand.volume], "the material: of its entry"
        others = young[cells[:1]]
        if others[0] == own:
            pairs = ends_of(interfaces)
            met = np.setdiff1d(pairs[(pairs == subdomain[cells[0]]).any(axis=1)],
                               subdomain[cells[0]])
            others, beside = young[np.isin(subdomain,
                                           met)], "the nearest of the parts that it meets"
        with np.errstate(divide="ignore", invalid="ignore"):
            decades = np.log10(own / others)
        decades = decades[np.isfinite(decades)]
        if not len(decades):
            continue
        off = decades[np.abs(decades).argmin()]
        if abs(off) >= STEP - NEAR and abs(off - STEP * np.round(off / STEP)) <= NEAR:
            problems.warnings.append(
                f"{name!r} has a modulus of {own:.4g}, {10**off:.3g} times {beside}, as between "
                "units of stress")


def _extent(others: np.ndarray) -> str:
    """Words for the extent of the other parts."""
    if not len(others):
        return ""
    low, high = others.min(axis=0), others.max(axis=0)
    return f", all other parts from {format_point(low)} to {format_point(high)}"
