"""Sources of meshes: one function per key under ``mesh:``, in a module that only its users load;
boxes; several put together.

A box of bricks, each split along its diagonals in six tets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from itertools import permutations
from typing import Any, TYPE_CHECKING

import numpy as np

from orchestrator.config.base import Rotate, unit
from orchestrator.errors import InputError, KeyPath, Problem, Problems, visible, wrong
from orchestrator.scene.foreign.joints import check_asked, read_joints
from orchestrator.scene.mesh.checks import check_size, coarser
from orchestrator.scene.mesh.faces import Faces, faces_of, MAX_NODES
from orchestrator.scene.mesh.geometry import cross
from orchestrator.scene.mesh.mesh import checked, Mesh
from orchestrator.scene.mesh.size_map import bisected, Sizes, WHOLE
from orchestrator.scene.names import INSIDE, renamed

if TYPE_CHECKING:
    from orchestrator.config.mesh import Move, OnePart

# key and name of the function → its module in ``orchestrator.scene``
SOURCES = {"beam": "mesh.sources", "box": "mesh.sources", "file": "mesh.readers.read",
           "polycrystal": "mesh.grains.polycrystal", "step": "mesh.solids"}


def make_mesh(mesh: Any, failed: dict[str, Problem] | None = None,
              sizes: Sizes | None = None) -> tuple[Mesh, Faces]:
    """Makes, scales and checks the mesh of the configuration's ``mesh`` entry, its names such as
    can be shown.

    ``scale`` multiplies the finished coordinates, so sizes and h are in unscaled units.

    failed : takes what is wrong with single solids of a CAD file, by name: they are left out then
    sizes : elements are as small as these say: a CAD model is meshed so, the tets of other meshes
        are halved until they are
    Raises InputError: the source is missing or bad, or what it gives is no valid mesh
    """
    key = next(key for key in SOURCES if getattr(mesh, key, None) is not None)
    make = getattr(import_module(f"orchestrator.scene.{SOURCES[key]}"), key)
    if key == "step":
        made = make(mesh, failed, sizes)
    else:
        made = bisected(make(mesh), sizes[WHOLE]) if sizes else make(mesh)
    made = _named(made)
    if key == "file" and getattr(mesh, "rename", None):
        made = replace(made, volumes=renamed(made.volumes, mesh.rename, ("mesh", "rename")))
    factor = float(getattr(mesh, "scale", None) or 1.0)
    return checked(made if factor == 1.0 else _placed(made, lambda points: factor * points))


def _placed(mesh: Mesh, place: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """The mesh where a similarity, points (n, 3) → (n, 3), puts it; in place of its nodes alone the
    shapes of its surfaces, too.
    """
    return replace(mesh, nodes=place(mesh.nodes),
                   smooth={name: shape.placed(place) for name, shape in mesh.smooth.items()})


def _named(mesh: Mesh) -> Mesh:
    """The mesh with names that can be shown: in terminals, where signs of a file's would move the
    cursor, and in results.
    """
    names = {name: visible(name) for name in [*mesh.volumes, *mesh.surfaces]}
    volumes, surfaces = [names[name] for name in mesh.volumes], {
        names[name]: t for name, t in mesh.surfaces.items()}
    if len(set(volumes)) < len(set(mesh.volumes)) or len(surfaces) < len(mesh.surfaces):
        raise wrong(("mesh",),
                    f"{mesh.source}: names that cannot be told apart but by signs that nobody sees",
                    "names of letters",
                    "rename the groups")
    return replace(mesh, volumes=volumes, surfaces=surfaces,
                   smooth={names[name]: shape for name, shape in mesh.smooth.items()},
                   remarks=[*map(visible, mesh.remarks)])


def make_parts(parts: list[OnePart], run_programs: bool | None = False,
               sizes: Mapping[int, Sizes] | None = None) -> tuple[Mesh, Faces]:
    """Makes the mesh of each part, as ``make_mesh`` does, moves it, and puts all together.

    A part's one volume is called as the part is, several ``part/volume``; surfaces are
    ``part/surface``.
    run_programs : whether programs are started that are parts; None: these are left out
    sizes : part → as for ``make_mesh``
    Raises InputError: as ``make_mesh``; all parts' problems, each with its place in the YAML;
    programs that may not be started
    """
    foreign = [(i, p) for i, p in enumerate(parts) if p.foreign is not None]
    if run_programs is None and any(part.program is None for part in parts):
        foreign = [(i, part) for i, part in foreign if part.program is None]
    elif not run_programs:
        check_asked(parts)
    meshes = [_together(parts, sizes or {})] if any(part.mesh is not None
                                                           for part in parts) else []
    mesh = joined([*meshes, *_standing_in(foreign, meshes)]) if foreign else meshes[0]
    return mesh, faces_of(mesh.cells, len(mesh.nodes))


def _together(parts: list[OnePart], sizes: Mapping[int, Sizes]) -> Mesh:
    """The parts that have meshes of ours."""
    made, problems = [], Problems()
    for i, part in enumerate(parts):
        if part.mesh is None:
            continue
        try:
            made.append(placed(make_mesh(part.source, sizes=sizes.get(i))[0],
                               part.name, part.move))
        except InputError as error:
            problems.found += [replace(p, path=_in_part(i, part, p.path)) for p in error.problems]
    problems.raise_if_any()
    if (count := sum(len(mesh.nodes) for mesh in made)) > MAX_NODES:
        raise wrong(("parts",), f"{count} nodes in all", f"at most {MAX_NODES} nodes",
                    "use coarser meshes")
    return joined(made)


def _in_part(index: int, part: OnePart, path: KeyPath) -> KeyPath:
    """Locate a problem with the mesh of a part."""
    return ("parts", index, *(path[1:] if part.h is not None and path == ("mesh", "h") else path))


def _standing_in(parts: list[tuple[int, OnePart]], meshes: list[Mesh]) -> list[Mesh]:
    """Stand-ins for parts whose mesh is not ours, with the place of each in the YAML; ``meshes``
    are ours.
    """
    # with it comes SciPy
    from orchestrator.scene.foreign.standin import fitted, outer_surfaces, stand_in

    made, problems, others = [], Problems(), [surface for mesh in meshes
                                              for surface in outer_surfaces(mesh)]
    for i, part in parts:
        path = ("parts", i, part.foreign.kind)
        try:
            joints = fitted(read_joints(part.foreign, path, part.name), others)
            made.append(stand_in(joints, part.name, path))
        except InputError as error:
            problems.found += error.problems
        else:
            others.append((joints.points, joints.triangles))
    problems.raise_if_any()
    return made


def placed(mesh: Mesh, name: str, move: Move | None) -> Mesh:
    """A part's mesh where it belongs, with the part's names."""
    inside = name + INSIDE
    mesh = mesh if move is None else _placed(mesh, lambda points: moved(points, move))
    volumes = [name] if len(mesh.volumes) == 1 else [inside + volume for volume in mesh.volumes]
    return replace(mesh, volumes=volumes,
                   surfaces={inside + s: t for s, t in mesh.surfaces.items()},
                   source=f"{name} ({mesh.source})",
                   remarks=[f"{name}: {text}" for text in mesh.remarks],
                   smooth={inside + s: shape for s, shape in mesh.smooth.items()})


def moved(nodes: np.ndarray, move: Move) -> np.ndarray:
    """Points (n, 3) turned, one turn after another, then shifted."""
    for turn in move.rotate or []:
        nodes = turned(nodes, turn)
    return nodes if move.translate is None else nodes + np.array(move.translate)


def turned(nodes: np.ndarray, turn: Rotate) -> np.ndarray:
    """Points (n, 3) turned about an axis, by Rodrigues' formula; by right angles exactly, so that
    faces turned onto a plane lie in it.
    """
    quarters, rest = divmod(turn.degrees, 90.0)
    angle = np.deg2rad(turn.degrees)
    sine, cosine = (np.sin(angle),
                    np.cos(angle)) if rest else ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0),
                                                 (-1.0, 0.0))[int(quarters) % 4]
    axis = np.array(unit(turn.axis))
    arm = nodes - np.array(turn.about)
    along = np.outer(arm @ axis, axis)
    return np.array(turn.about) + along + cosine * (arm
                                                    - along) + sine * cross(
                                                        np.broadcast_to(axis, arm.shape), arm)


def joined(meshes: list[Mesh]) -> Mesh:
    """One mesh of several that share no nodes; names of volumes and of surfaces must differ."""
    nodes = np.cumsum([0, *(len(m.nodes) for m in meshes)])
    volumes = np.cumsum([0, *(len(m.volumes) for m in meshes)])
    return Mesh(np.concatenate([m.nodes for m in meshes]),
                np.concatenate([m.cells + start for m, start in zip(meshes, nodes)]),
                np.concatenate([m.volume + start for m, start in zip(meshes, volumes)]),
                [name for m in meshes for name in m.volumes],
                {name: t + start for m, start in zip(meshes, nodes)
                 for name, t in m.surfaces.items()},
                " + ".join(m.source for m in meshes), [text for m in meshes for text in m.remarks],
                {name: shape for m in meshes for name, shape in m.smooth.items()},
                [replace(stand, volume=stand.volume + v, first=stand.first + n,
                         triangles=stand.triangles + n)
                 for m, v, n in zip(meshes, volumes.tolist(), nodes.tolist())
                 for stand in m.foreign])


def beam(mesh: Any) -> Mesh:
    """A box of bricks about h wide, from ``mesh.beam`` with ``size`` (3 lengths) and ``h`` (a
    length).
    """
    size, h = np.asarray(mesh.beam.size, dtype=float), float(mesh.beam.h)
    # Python's rounding would send 2.5 cells to 2; more than memory holds are counted all the same
    counts = np.maximum(np.floor(size / h + 0.5), 1).clip(max=1e15).astype(int)
    check_size(np.prod(counts + 1.0), ("mesh", "beam", "h"), f"h = {h:g}", coarser(h))
    return bricks(size, counts, "beam")


def box(mesh: Any) -> Mesh:
    """A box of given bricks, from ``mesh.box`` with ``size`` (3 lengths) and ``cells`` (3
    counts).
    """
    counts = np.asarray(mesh.box.cells)
    check_size(np.prod(counts + 1.0), ("mesh", "box", "cells"), f"cells: {counts.tolist()}",
               lambda factor: f"take fewer cells, each {factor:.2g} times as large")
    return bricks(mesh.box.size, counts, "box")


def bricks(size: Sequence[float], counts: Sequence[int], name: str) -> Mesh:
    """Return the mesh of a box with a corner at the origin.

    The split, Kuhn's, is the same in every brick, so slices of equal thickness are congruent.
    Nodes and bricks are in lexicographic order, z fastest, tets follow each other brick by brick.

    size : (3,) lengths; counts : (3,) bricks along x, y, z
    name : of the one volume; the six sides are named xmin, xmax, ymin, …
    """
    counts = np.asarray(counts)
    shape = tuple(int(c) + 1 for c in counts)
    index = np.stack(np.unravel_index(np.arange(np.prod(counts)), counts), axis=1)
    cells = (np.ravel_multi_index(index.T, shape)[:, None, None] + _tets(shape)).reshape(-1, 4)
    at = np.unravel_index(np.arange(np.prod(shape)), shape)
    nodes = np.column_stack([np.linspace(0.0, length, n)[i]
                             for length, n, i in zip(map(float, size), shape, at)])
    return Mesh(nodes, cells, np.zeros(len(cells), dtype=int), [name], _sides(index, shape), name)


def _sides(index: np.ndarray, shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Return the six sides, as outward triangles cut along the diagonals of bricks (k, 3)."""
    stride, sides = np.array([shape[1] * shape[2], shape[2], 1]), {}
    for axis, letter in enumerate("xyz"):
        one, two = np.delete(stride, axis)
        for end, label in ((0, "min"), (shape[axis] - 1, "max")):
            own = index[index[:, axis] == max(end - 1, 0)]
            a = (own @ stride) + (end - own[:, axis]) * stride[axis]
            a, b, c, d = a, a + one, a + one + two, a + two
            triangles = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
            # (y,z), (x,z), (x,y): the middle pair is left-handed.
            outward = (axis != 1) == (end > 0)
            sides[letter + label] = triangles if outward else triangles[:, ::-1]
    return sides


def _tets(shape: tuple[int, ...]) -> np.ndarray:
    """Return (6, 4) nodes of a brick's tets beyond its first, in a grid of nodes: one for each
    order
    of the axes, from one corner to the opposite one."""
    stride, tets = np.array([shape[1] * shape[2], shape[2], 1]), []
    for order in permutations(range(3)):
        walk = np.cumsum([0, *stride[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        tets.append(walk[[0, 2, 1, 3]] if odd else walk)
    return np.array(tets)
