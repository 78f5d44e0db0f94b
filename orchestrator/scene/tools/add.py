"""Rigid tools in the scene: behind the faces that each may touch, a thin layer of tets is the tool,
a body among the others.

Its nodes are copies of the faces' own, so that contact pairs them, with the tool's own normals and
gaps: the layer lies on the part, wherever the tool is. Where the whole motion is prescribed all of
its nodes are, and it is a subdomain of its own behind each one that it touches; else its back
follows a point that is loaded, and the layer, of the part's own matter, is so thin that it passes
on what its back does. Then it resists nothing but that: what resists along it, as a thick layer of
stiff matter does, keeps its nodes from finding the point's motion each by itself, for many
iterations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.config.tools import PLACE, Tool
from orchestrator.errors import KeyPath, Problems
from orchestrator.linalg import WRITTEN
from orchestrator.scene.body import Divided
from orchestrator.scene.conditions.ground import add_layers, Layer
from orchestrator.scene.conditions.selection import volumes_named
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.opposite import COINCIDE, cosine_of, REACH, TOUCHING
from orchestrator.scene.mesh.faces import Faces, renumbered
from orchestrator.scene.mesh.geometry import barycentric, facet_normals, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry
from orchestrator.scene.partition import Partition
from orchestrator.scene.tools.motion import Driven, PlaneSurface, Rigid, Round, ToolSurface

KIND = "tool"
# thickness of a layer over the size of its faces, the share of an element's yielding by which it
# gives way
THIN = 1e-4


@dataclass(frozen=True)
class Pressed:
    """A tool, the entry of ``interfaces`` that it is in, by its place, and the faces (k,) that it
    may touch.
    """

    tool: Rigid
    index: int
    entry: Entry
    faces: np.ndarray


def pressed_tools(mesh: Mesh, faces: Faces, entries: Sequence[Entry], tools: Mapping[str, Tool],
                  factors: Sequence[Sequence[float]], problems: Problems) -> list[Pressed]:
    """The tools in their places, each with its faces; adds problems.

    entries : of ``interfaces``; tools : by name, in their order; factors : (steps,) of the history
        of each
    """
    found = []
    there = [(i, entry) for i, entry in enumerate(entries) if entry.tool is not None]
    for (i, entry), (name, tool), times in zip(there, tools.items(), factors):
        path = ("interfaces", i)
        if name in mesh.volumes:
            problems.add((*path, *PLACE[2:], "name"), f"a rigid tool called {name!r}, as a part is",
                         "a name of its own", "give it a name")
        surface = surface_of_tool(tool)
        rigid = Rigid(name, surface, Driven.of(tool, surface.middle, times))
        volumes = volumes_named(mesh, entry.pair[0], (*path, "between", 0), problems)
        foreign = [mesh.volumes[stand.volume] for stand in mesh.foreign if stand.volume in volumes]
        if foreign:
            problems.add((*path, "between", 0),
                         f"a rigid tool on {foreign[0]!r}, whose mesh is not this program's",
                         "parts with a mesh of this program's",
                         "name these alone, or mesh the tool as a part")
        elif volumes:
            own = touched_faces(mesh, faces, np.isin(mesh.volume, volumes), rigid, entry, path,
                                problems)
            found.append(Pressed(rigid, i, entry, own))
            rubs = entry.kind.slips and bool(entry.friction)
            if len(own) and pulled_away(mesh.nodes[np.unique(faces.triangles[own])], rigid, rubs):
                problems.add((*path, "between", 1, "force"),
                             f"a force that draws {name} away from the part, along which nothing "
                             "holds it",
                             "a force that presses it on the part",
                             "change the sign of the force, or prescribe the displacement there")
    return found


def surface_of_tool(tool: Tool) -> ToolSurface:
    """Return the surface of the YAML's entry."""
    if tool.plane is not None:
        return PlaneSurface(np.array(tool.plane.at), np.array(tool.plane.direction))
    if tool.sphere is not None:
        return Round(np.array(tool.sphere.centre), tool.sphere.radius, tool.sphere.hollow)
    c = tool.cylinder
    return Round(np.array(c.at), c.radius, c.hollow, np.array(c.direction))


def add_tools(cut: Divided, pressed: Sequence[Pressed],
              first: int) -> tuple[Divided, list[Interface], list[BoundaryEntry]]:
    """Return the scene with the tools as bodies.

    first : how many entries ``boundary`` has already
    Returns also the interfaces with the tools, with their laws, and what moves or loads each
    """
    layers = {one.tool.name: list(_behind(one, cut.body.faces, cut.partition)) for one in pressed}
    added, nodes, between = add_layers(cut, layers)
    entries = []
    for one, own, there, found in zip(pressed, layers.values(), nodes, between):
        for interface in found:
            points = added.body.mesh.nodes[interface.global_nodes]
            gaps, interface.normals = one.tool.gaps(points)
            laws = [one.entry.kind.of(one.entry, len(points), 1.0, gap) for gap in gaps]
            interface.govern(laws, (gaps != gaps[:1]).any())
            interface.entry, interface.tool = one.index, one.tool
        entries.append(_driven(added.body.faces, one, own, there, first + len(entries)))
    return added, [interface for own in between for interface in own], entries


def _behind(one: Pressed, faces: Faces, partition: Partition) -> Iterator[Layer]:
    """One layer behind each subdomain that a tool may touch; behind all of them, where it has to
    find its way.
    """
    owner, name = partition.subdomain[faces.owner[one.faces]], one.tool.name
    for e in np.unique(owner) if one.tool.driven.held else [None][: len(owner)]:
        own = one.faces[slice(None) if e is None else owner == e]
        yield Layer(name if e is None else f"{name} on {partition.names[e]}", faces.triangles[own],
                    faces.owner[own], thickness=THIN)


def _driven(faces: Faces, one: Pressed, layers: Sequence[Layer], nodes: slice,
            index: int) -> BoundaryEntry:
    """Motion of a tool's layers: on all their faces, or on those of the back of one that is loaded;
    ``nodes``: of the layers."""
    outer, begin = faces.outer, nodes.start
    if layers and not one.tool.driven.held:
        begin += len(np.unique(layers[0].triangles))
    triangles = faces.triangles[outer]
    own = outer[(triangles >= begin).all(axis=1) & (triangles < nodes.stop).all(axis=1)]
    triangles = faces.triangles[own]
    return BoundaryEntry(index, KIND, triangles, np.c_[faces.owner[own], faces.neighbour[own]],
                         np.unique(triangles), one.tool.driven.told, one.tool)


def touched_faces(mesh: Mesh, faces: Faces, cells: np.ndarray, tool: Rigid, entry: Entry,
                  path: KeyPath,
                  problems: Problems) -> np.ndarray:
    """(k,) int, the outer faces of some cells (m,) bool that a tool may touch; adds a problem where
    there are none, or where the tool begins
    inside.

    entry : of ``interfaces``, which says how far off faces may be, and how far turned away
    """
    outer = faces.outer[cells[faces.owner[faces.outer]]]
    triangles = faces.triangles[outer]
    nodes, local = renumbered(triangles)
    points = mesh.nodes[nodes]
    facet, area = facet_normals(mesh.nodes, triangles)
    size = np.sqrt(2 * area)
    if _inside(points, local, size, tool, path, problems):
        return outer[:0]
    cosine, room = cosine_of(entry.angle), entry.reach or REACH * size
    chosen, near = np.zeros(len(local), bool), np.inf
    for move in np.unique(tool.driven.moves, axis=0):  # within reach at some load step
        distance, normal = tool.at(move, points)
        looks = np.einsum("kc,kc->k", facet, normal[local[:, :3]].mean(axis=1)) < cosine
        apart = distance[local].min(axis=1)
        chosen |= looks & (apart <= room)
        near = min(near, float(apart[looks].min(initial=np.inf)))
    if not chosen.any():
        _nothing(mesh, cells, tool, near, path, problems)
    return outer[chosen]


def _inside(points: np.ndarray, local: np.ndarray, size: np.ndarray, tool: Rigid, path: KeyPath,
            problems: Problems) -> bool:
    """Adds a problem where the tool begins inside: at nodes (n, 3) that surfaces go through, or
    amid facets (k, 3 or 6), whose chords
    may lie aside of these."""
    at_nodes, amid = (tool.at(np.zeros(6), x)[0]
                      for x in (points, points[local[:, :3]].mean(axis=1)))
    apart = np.concatenate([at_nodes[local].min(axis=1) + COINCIDE * size, amid + TOUCHING * size])
    worst = int(apart.argmin())
    if apart[worst] >= 0:
        return False
    k = worst % len(local)
    depth, corner = (-at_nodes[local[k]].min(),
                     local[k][at_nodes[local[k]].argmin()]) if worst < len(local) else (
                         -amid[k], local[k][0])
    problems.add((*path, "between", 1),
                 f"{tool.name} begins {depth:.3g} inside the part, at "
                 f"{format_point(points[corner])}",
                 "a tool that touches the part at most before it moves",
                 "move it back, and press it by its displacement or force")
    return True


def _nothing(mesh: Mesh, cells: np.ndarray, tool: Rigid, near: float, path: KeyPath,
             problems: Problems) -> None:
    """No face: the tool is elsewhere, turned the other way, or inside altogether."""
    corners = mesh.nodes[mesh.cells[cells, :4]]
    if (barycentric(corners, tool.surface.middle) > 0).all(axis=1).any():
        found = "begins inside the part altogether"
        cure = "move it out, and press it by its displacement or force"
    elif np.isfinite(near):
        found = f"comes no nearer than {near:.3g} to any face that looks at it"
        cure = f"move it nearer, or write within: {1.5 * near:.2g}"
    else:
        found = "is looked at by no face"
        cure = "turn its normal round; hollow: true where the part is inside it"
    problems.add((*path, "between", 1), f"{tool.name} {found}",
                 "faces of the part that look at the tool, two elements from it at most",
                 cure)


def pulled_away(points: np.ndarray, tool: Rigid, rubs: bool) -> bool:
    """Whether at some load step a force, with no moment, leads away from all nodes (n, 3), or along
    them where nothing ``rubs``.
    """
    force, turning = tool.driven.loads[:, :3], np.delete(tool.driven.prescribed, range(3))
    if not force.any() or not turning.all():
        return False
    along, least = tool.gaps(points)[1] @ force.T, WRITTEN * np.linalg.norm(force, axis=1)
    away = (along >= -least).all(axis=0) & ~(rubs & (along <= least).all(axis=0))
    return bool(away[force.any(axis=1)].any())
