"""Rigid tools in the scene: behind the faces that each may touch, a thin layer of tets is the tool, a body among the others.

Its nodes are copies of the faces' own, so that contact pairs them, with the tool's own normals and gaps: the layer lies on the part,
wherever the tool is. Where the whole motion is prescribed all of its nodes are, and it is a subdomain of its own behind each one that it
touches; else its back follows a point that is loaded, and the layer, of the part's own matter, is so thin that it passes on what its back
does. Then it resists nothing but that: what resists along it, as a thick layer of stiff matter does, keeps its nodes from finding the
point's motion each by itself, for many iterations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.config.tools import PLACE, Tool
from orchestrator.errors import InputError, KeyPath, Problems
from orchestrator.registry import LAWS
from orchestrator.scene.conditions.ground import Added, Layer, add_layers
from orchestrator.scene.conditions.selection import volumes_named
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import BoundaryEntry
from orchestrator.scene.partition import Partition
from orchestrator.scene.tools.motion import Driven, Rigid
from orchestrator.scene.tools.surfaces import Plane, Round, Surface
from orchestrator.scene.tools.touching import pulled_away, touched_faces

KIND = "tool"
THIN = 1e-4  # thickness of a layer over the size of its faces, the share of an element's yielding by which it gives way


@dataclass(frozen=True)
class Pressed:
    """A tool, the entry of ``interfaces`` that it is in, by its place, and the faces (k,) that it may touch."""

    tool: Rigid
    index: int
    entry: Entry
    faces: np.ndarray


def pressed_tools(mesh: Mesh, faces: Faces, partition: Partition, entries: Sequence[Entry], tools: Mapping[str, Tool],
                  factors: Sequence[Sequence[float]], problems: Problems) -> list[Pressed]:
    """The tools in their places, each with its faces; adds problems. Of a piece of a mesh these are faces of subdomains that are all there,
    and of a tool that has to find its way all faces that it may touch, if some are of these.

    entries : of ``interfaces``; tools : by name, in their order; factors : (steps,) of the history of each
    """
    found, here = [], np.ones(len(mesh.cells), dtype=bool) if partition.here is None else partition.here[partition.subdomain]
    there = [(i, entry) for i, entry in enumerate(entries) if entry.tool is not None]
    for (i, entry), (name, tool), times in zip(there, tools.items(), factors):
        path = ("interfaces", i)
        if name in mesh.volumes:
            problems.add((*path, *PLACE[2:], "name"), f"a rigid tool called {name!r}, as a part is", "a name of its own", "give it a name")
        try:
            rigid = rigid_of(name, tool, times, (*path, *PLACE[2:]))
        except InputError as error:
            problems.found += error.problems
            continue
        volumes = volumes_named(mesh, entry.pair[0], (*path, "between", 0), problems)
        foreign = [mesh.volumes[stand.volume] for stand in mesh.foreign if stand.volume in volumes]
        if foreign:
            problems.add((*path, "between", 0), f"a rigid tool on {foreign[0]!r}, whose mesh is not this program's",
                         "parts with a mesh of this program's", "name these alone, or mesh the tool as a part")
        elif volumes:
            own = touched_faces(mesh, faces, np.isin(mesh.volume, volumes) & (here | (not rigid.driven.held)), rigid, entry, path, problems)
            found.append(Pressed(rigid, i, entry, own := own if here[faces.owner[own]].any() else own[:0]))
            if len(own) and pulled_away(mesh.nodes[np.unique(faces.triangles[own])], rigid):
                problems.add((*path, "between", 1, "force"), f"a force that draws {name} away from the part, along which nothing holds it",
                             "a force that presses it on the part", "change the sign of the force, or prescribe the displacement there")
    return found


def rigid_of(name: str, tool: Tool, factors: Sequence[float], path: KeyPath) -> Rigid:
    """A tool in its place; factors (steps,) of its history.

    Raises InputError: as ``surface_of_tool``
    """
    surface = surface_of_tool(tool, path)
    return Rigid(name, surface, Driven.of(tool, surface.middle, factors))


def surface_of_tool(tool: Tool, path: KeyPath) -> Surface:
    """Surface of the YAML's entry; raises InputError: an STL file that is none, or whose surface is not closed or turned inside out."""
    if tool.plane is not None:
        return Plane(np.array(tool.plane.at), np.array(tool.plane.direction))
    if tool.sphere is not None:
        return Round(np.array(tool.sphere.centre), tool.sphere.radius, tool.sphere.hollow)
    if tool.cylinder is not None:
        c = tool.cylinder
        return Round(np.array(c.at), c.radius, c.hollow, np.array(c.direction))
    from orchestrator.scene.tools.triangles import read_stl  # with it comes SciPy

    return read_stl(tool.stl, (*path, "stl"))


def add_tools(mesh: Mesh, faces: Faces, partition: Partition, cell_material: np.ndarray, pressed: Sequence[Pressed],
              first: int) -> tuple[Added, list[Interface], list[BoundaryEntry]]:
    """The scene with the tools as bodies.

    first : how many entries ``boundary`` has already
    Returns the interfaces with the tools as well, with their laws, and what moves or loads each
    """
    layers, entries = [list(_behind(one, faces, partition)) for one in pressed], []
    mesh = replace(mesh, volumes=[*mesh.volumes, *(one.tool.name for one in pressed)])  # on pieces of a mesh, too
    added = add_layers(mesh, partition, cell_material, [layer for own in layers for layer in own])
    ends = np.cumsum([0, *map(len, layers)])
    for number, one in enumerate(pressed):
        own = slice(ends[number], ends[number + 1])
        for interface in chain.from_iterable(added.interfaces[own]):
            points = added.mesh.nodes[interface.global_nodes]
            gaps, interface.normals = one.tool.gaps(points)
            laws = [LAWS[one.entry.law].of(one.entry, len(points), 1.0, gap) for gap in gaps]
            interface.law = max(laws, key=lambda law: law.imposed)
            interface.law_at_steps = laws if (gaps != gaps[:1]).any() else []
            interface.entry, interface.tool = one.index, one.tool
        entries.append(_driven(added, one, layers[number], added.nodes[own], first + number))
    return added, [interface for own in added.interfaces for interface in own], entries


def _behind(one: Pressed, faces: Faces, partition: Partition) -> Iterator[Layer]:
    """One layer behind each subdomain that a tool may touch; behind all of them, where it has to find its way."""
    owner, name = partition.subdomain[faces.owner[one.faces]], one.tool.name
    for e in np.unique(owner) if one.tool.driven.held else [None][: len(owner)]:
        own = one.faces[slice(None) if e is None else owner == e]
        yield Layer(name if e is None else f"{name} on {partition.names[e]}", name, faces.triangles[own], faces.owner[own], thickness=THIN)


def _driven(added: Added, one: Pressed, layers: Sequence[Layer], nodes: Sequence[slice], index: int) -> BoundaryEntry:
    """Motion of a tool's layers: on all their faces, or on those of the back of one that is loaded; ``nodes``: of each."""
    outer, begin, end = added.faces.outer, *((nodes[0].start, nodes[-1].stop) if nodes else (0, 0))
    if layers and not one.tool.driven.held:
        begin += len(np.unique(layers[0].triangles))
    own = outer[(added.faces.triangles[outer] >= begin).all(axis=1) & (added.faces.triangles[outer] < end).all(axis=1)]
    triangles = added.faces.triangles[own]
    return BoundaryEntry(index, KIND, triangles, np.c_[added.faces.owner[own], added.faces.neighbour[own]], np.unique(triangles),
                         one.tool.driven.told, one.tool)
