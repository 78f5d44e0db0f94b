"""Volumes, surfaces and pairs of a mesh, as rows and as text, with what one wants to know before
naming them in a configuration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.fits import exact_distance, fits, round_faces
from orchestrator.scene.shapes import Shape, shape_of
from orchestrator.scene.interfaces.distances import paired_distance
from orchestrator.scene.interfaces.overlap import hidden
from orchestrator.scene.interfaces.facing import facing
from orchestrator.scene.interfaces.matching import match
from orchestrator.scene.interfaces.opposite import close_bodies, outer_bodies
from orchestrator.scene.interfaces.shared import patches
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import areas, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Scene

SHARED, COINCIDENT, APART, ROOM = "shared", "matching", "not matching", "with room"
UNKNOWN = Shape("curved")


@dataclass(frozen=True)
class PairRow:
    """One patch on which two parts lie on each other.

    one, two : names of the parts
    area : that they have in common
    nearest, farthest : distance of the sides along the normal; negative inside each other
    meshes : whether faces are shared, nodes coincide or project onto each other, neither, or a
        shaft has room in a hole
    slave : name of the part whose nodes carry the points; empty where nodes are paired
    size : element size of either side
    law : that governs; empty where that is not known
    """

    one: str
    two: str
    area: float
    nearest: float
    farthest: float
    meshes: str
    slave: str
    size: tuple[float, float]
    law: str = ""


def pairs_of_scene(scene: Scene) -> Iterator[PairRow]:
    """The interfaces between different bodies, in their order."""
    for interface in scene.interfaces:
        one, two = (scene.subdomains[e] for e in interface.subdomains)
        if one.body == two.body or not len(interface.triangles):
            continue
        sizes, each = zip(*(
            _measures(scene.side_points(interface, side), interface.triangles_on(side))
            for side in (0, 1)))
        if not interface.paired:
            points, area, slave = interface.mortar.points, float(
                interface.mortar.area.sum()), one.name
            read = interface.law.distance
            distance, meshes = read[points] if np.ndim(read) else interface.mortar.gap, APART
        else:
            distance = paired_distance(scene.side_points(interface, 0),
                                       scene.side_points(interface, 1), interface.triangles)
            area, slave = each[0], ""
            meshes = SHARED if np.array_equal(*(scene.side_nodes(interface, side)
                                                for side in (0, 1))) else COINCIDENT
        yield PairRow(one.name, two.name, area, float(distance.min()), float(distance.max()),
                      meshes, slave, sizes, interface.law.name)


def _measures(points: np.ndarray, triangles: np.ndarray) -> tuple[float, float]:
    """Mean element size and area of facets."""
    each = areas(points, triangles)
    return float(np.sqrt(2 * each).mean()), float(each.sum())


def pairs_of_mesh(mesh: Mesh, faces: Faces) -> Iterator[PairRow]:
    """Pairs that touch, whatever laws may say: shared faces, then faces that lie on each other;
    then shafts in holes with room.
    """
    shared, sides, bounds = patches(faces, mesh.volume)
    for first, last in zip(bounds[:-1], bounds[1:]):
        size, area = _measures(mesh.nodes, faces.triangles[shared[first:last]])
        yield PairRow(*(mesh.volumes[v] for v in sides[first]), area, 0.0, 0.0, SHARED,
                      "", (size, size))
    if len(mesh.volumes) < 2:
        return
    skins, round_ones, told = Skins(mesh, faces), fits(round_faces(mesh, faces)), set()
    # chords of two polygons about one circle are in each other, circles are not
    exact = exact_distance(mesh, round_ones)
    bodies = outer_bodies(mesh, faces, mesh.volume)
    for one, two in close_bodies(bodies, None):
        matching = np.concatenate([np.empty(0, int),
                                   *(patch.facets[:, 0] for patch in match(one, two))])
        for found in facing(skins(one), skins(two), hidden=hidden(bodies, skins, one, two)):
            alike = np.isin(found.segments.slave, matching).all()
            known = exact[skins(one).face[found.segments.slave],
                          skins(two).face[found.segments.master]]
            distance = np.where(np.isnan(known), found.distance, known)
            told |= {(one.volume, two.volume)} if (~np.isnan(known)).any() else set()
            yield PairRow(mesh.volumes[one.volume], mesh.volumes[two.volume], found.area,
                          float(distance.min()), float(distance.max()),
                          COINCIDENT if alike else APART, "", found.size)
    for fit in round_ones:
        if not fit.same and fit.clearance > 0 and not {fit.volumes, fit.volumes[::-1]} & told:
            yield PairRow(*(mesh.volumes[v] for v in fit.volumes), fit.area,
                          fit.clearance - fit.eccentric, fit.clearance + fit.eccentric,
                          ROOM, "", (fit.shaft.size, fit.hole.size))


# Largest extents of what is built and made, in metres: beyond, one unit is meant for another.
LARGEST, SMALLEST = 100.0, 1e-3
# Units of length in metres; with N, the moduli of matter from rubber to diamond.
METRES = {"m": 1.0, "mm": 1e-3}
MATTER = {"m": (1e7, 1.3e12), "mm": (1e1, 1.3e6)}


@dataclass(frozen=True)
class SurfaceRow:
    """One named surface: number of triangles, area, centre, shape."""

    name: str
    triangles: int
    area: float
    centre: np.ndarray
    shape: Shape


def surfaces_of(mesh: Mesh) -> Iterator[SurfaceRow]:
    """Rows of the surfaces, in the order of the mesh."""
    for name, triangles in mesh.surfaces.items():
        each = areas(mesh.nodes, triangles)
        area = float(each.sum())
        if not area:
            yield SurfaceRow(name, len(triangles), 0.0, np.full(3, np.nan), Shape("empty"))
            continue
        centre = each @ mesh.nodes[triangles[:, :3]].mean(axis=1) / area
        shape = mesh.smooth.get(name, UNKNOWN)  # what the CAD model says, else what the nodes tell
        yield SurfaceRow(name, len(triangles), area, centre,
                         shape_of(mesh.nodes, triangles[each > 0]) if shape.kind == UNKNOWN.kind
                         else shape)


def units_remark(mesh: Mesh, young: Sequence[float] = ()) -> str:
    """Remark on the extent of a mesh in usual units, and whether moduli fit them."""
    extent = np.ptp(mesh.nodes, axis=0)
    size = float(extent.max())
    text = "extent " + " × ".join(f"{x:.6g}" for x in extent)
    fits = [unit for unit, metres in METRES.items() if SMALLEST <= size * metres <= LARGEST]
    if not young:
        return text + (f": of a plausible size in {' and in '.join(fits)}" if fits else
                       ": implausible in m and in mm; scale: under mesh: takes a factor")
    stiff = max(young)
    unit = next((unit for unit, (low, high) in MATTER.items() if low <= stiff <= high), "")
    if not unit:
        return text
    text += (f"; a modulus of {stiff:g} looks like N/{unit}², so that lengths are in {unit}, and "
             f"then is {stiff / METRES[unit]**2 / 1e9:.3g} GPa")
    if unit in fits:
        return text
    return (
        text + f": {size * METRES[unit]:g} m is implausible; scale: under mesh: takes a factor, or "
               "change the moduli")


def volume_table(mesh: Mesh, matter: Mapping[str, str] | None = None) -> list[str]:
    """Lines on volumes, in the order of the mesh: number of tets, volume, mean element size (cube
    root of six tets' volume), centre, lowest and highest corner.

    matter : what each is made of, where that is known
    """
    heads, rows = ("volume", "tets", "volume", "element", "centre", "from", "to"), []
    each = tet_volumes(mesh.nodes, mesh.cells)
    for index, name in enumerate(mesh.volumes):
        own = mesh.volume == index
        volumes, corners = each[own], mesh.nodes[mesh.cells[own, :4]]
        whole = volumes.sum()
        rows.append((name, str(len(volumes)), _number(whole), _number(np.cbrt(6 * volumes.mean())),
                     _point(volumes @ corners.mean(axis=1) / whole),
                     _point(corners.min(axis=(0, 1))), _point(corners.max(axis=(0, 1))),
                     *((matter.get(name, "-"),) if matter else ())))
    return columns(heads + (("material",) if matter else ()), rows)


def surface_table(rows: Iterable[SurfaceRow]) -> list[str]:
    """Lines on surfaces; of a plane the normal, of a cylinder the axis."""
    return columns(("surface", "triangles", "area", "centre", "kind", "normal, axis"),
                    [(r.name, str(r.triangles), _number(r.area), _point(r.centre), _kind(r.shape),
                      "-" if r.shape.direction is None else _point(r.shape.direction))
                     for r in rows])


def _kind(shape: Shape) -> str:
    return shape.kind if shape.radius is None else f"{shape.kind}, radius {_number(shape.radius)}"


def pair_table(rows: Iterable[PairRow], most: int | None = None) -> list[str]:
    """Lines on pairs.

    most : how many are shown; None: all
    """
    rows = list(rows)
    shown = rows[:most]
    lines = columns(("pair", "area", "distance", "meshes", "slave", "elements", "law"),
                     [(f"{r.one} | {r.two}", _number(r.area), _range(r.nearest, r.farthest),
                       r.meshes, r.slave or "-",
                       _range(*r.size), r.law or "-") for r in shown])
    return lines + ([f"… and {len(rows) - len(shown)} more"] if len(shown) < len(rows) else [])


def bolt_table(scene: Scene) -> list[str]:
    """Lines on bolts: where each is cut, and across which axis."""
    return columns(("bolt", "cut at", "across"),
                   [(bolt.name, _point(bolt.point), _point(bolt.axis)) for bolt in scene.bolts
                                                  ]) if scene.bolts else []


def columns(heads: Sequence[str], rows: list[tuple[str, ...]]) -> list[str]:
    """A table as lines, below its heads."""
    widths = [max(map(len, column)) for column in zip(heads, *rows)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip()
            for row in (heads, *rows)]


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}"


def _range(low: float, high: float) -> str:
    low, high = (f"{value + 0.0:.2g}" for value in (low, high))
    return low if low == high else f"{low} … {high}"


def _point(point: np.ndarray) -> str:
    return "(" + ", ".join(_number(float(np.round(x, 9))) for x in point) + ")"
