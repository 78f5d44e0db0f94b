"""Meshes of STEP and BREP models: touching solids share their faces; or each solid is meshed by itself, at its own element size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from orchestrator.errors import InputError, Problem, Problems, some, wrong
from orchestrator.scene.mesh.gmsh_session import (
    HXT, TET, TRIANGLE, check_h, elements, last_complaint, leave_out, locate, points, read_model, session)
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.names import matching, suggestion

DELAUNAY = 1
# 3D algorithm, elements per full circle. HXT is three times faster and leaves far fewer slivers, but gives up
# on coarse curved surfaces; there finer circles help, where Delaunay does not.
ATTEMPTS = ((HXT, 0), (DELAUNAY, 0), (HXT, 6))
# Edges and faces shorter than this share of the whole model are told: elements there are as small.
SMALL = 1e-3
SHOWN = 5  # faces that one sentence names


def step(mesh: Any) -> Mesh:
    """The CAD model named by ``mesh.step``, meshed with elements of size ``mesh.h`` (in the model's units).

    Without h, gmsh takes a tenth of the model's size, less where the shape asks for it. Volumes carry the solids' names; each
    geometric surface on the outer boundary is a named surface ``<solid>:<k>``, k from 1.
    Raises InputError: unreadable, no solids, faces that close none, names that match none, solids that gmsh cannot mesh
    """
    path, source, exclude = locate(str(mesh.step)), str(mesh.step), getattr(mesh, "exclude", None) or []
    if getattr(mesh, "conforming", None) is False:
        return _apart(path, source, mesh.h, exclude)
    return _conforming(path, source, None if mesh.h is None else float(mesh.h), exclude)


def _conforming(path: Path, source: str, h: float | None, exclude: list[str]) -> Mesh:
    """The mesh in which touching solids share their faces."""
    complaint = ""
    for algorithm, per_circle in ATTEMPTS:
        with session():
            names, owner = _joined(path, source, h, exclude)
            if h is not None:
                gmsh.option.setNumber("Mesh.MeshSizeMax", h)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_circle)
            gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
            try:
                gmsh.model.mesh.generate(3)
            except Exception as error:
                complaint = last_complaint(error)
                continue
            # gmsh passes over solids it cannot fill without raising an error.
            empty = {names[solid] for tag, solid in owner.items() if not len(gmsh.model.mesh.getElementsByType(TET, tag)[0])}
            if not empty:
                return _arrays(source, names, owner)
            complaint = "no tetrahedra in " + ", ".join(sorted(empty))
    raise wrong(("mesh", "step"), f"{source}: gmsh cannot mesh it with h = {h}: {complaint}",
                "solids that can be meshed", "try a smaller h, or repair the model")


def _joined(path: Path, source: str, h: float | None, exclude: list[str]) -> tuple[list[str], dict[int, int]]:
    """Makes touching solids share faces: their names, and the tag of each piece → the solid it comes from."""
    solids, names, _ = read_model(path, source, shells=False)
    if exclude:
        kept = leave_out(source, names, exclude, names)
        gmsh.model.occ.remove([s for i, s in enumerate(solids) if i not in kept], recursive=True)
        gmsh.model.occ.synchronize()
        solids, names = [solids[i] for i in kept], [names[i] for i in kept]
    if h is not None:
        check_h(solids, h)
    if len(solids) == 1:
        return names, {solids[0][1]: 0}
    _, children = gmsh.model.occ.fragment(solids, [])
    gmsh.model.occ.synchronize()
    owner: dict[int, int] = {}
    for i, pieces in enumerate(children):
        for dimension, tag in pieces:
            if dimension == 3:
                owner.setdefault(tag, i)  # where solids overlap, the piece goes to the first
    return names, owner


def _arrays(source: str, names: list[str], owner: dict[int, int]) -> Mesh:
    """The mesh that gmsh holds of solids as ``_joined`` tells them."""
    pieces = [tag for _, tag in gmsh.model.getEntities(3)]
    cells, piece = elements(TET, pieces)
    used, inverse = np.unique(cells, return_inverse=True)
    surfaces: dict[str, np.ndarray] = {}
    counts = dict.fromkeys(names, 0)
    for _, tag in gmsh.model.getEntities(2):
        beside = gmsh.model.getAdjacencies(2, tag)[0]
        if len(beside) == 1:
            name = names[owner[int(beside[0])]]
            counts[name] += 1
            surfaces[f"{name}:{counts[name]}"] = np.searchsorted(used, elements(TRIANGLE, [tag])[0])
    kept, volume = np.unique(np.array([owner[tag] for tag in pieces])[piece], return_inverse=True)
    return Mesh(points(used), inverse.reshape(-1, 4), volume, [names[i] for i in kept], surfaces, source, smooth=list(surfaces))


@dataclass
class Solid:
    """One solid of a model that is meshed by itself.

    tag : gmsh's; name : unique; faces : tags of its faces, ascending, named ``name:1`` and on
    h : element size, none: gmsh's own choice
    points : (n, 3), cells : (m, 4), surfaces : triangles per face, once it is meshed; complaint : why it is not
    """

    tag: int
    name: str
    faces: list[int]
    h: float | None
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    cells: np.ndarray = field(default_factory=lambda: np.empty((0, 4), dtype=int))
    surfaces: list[np.ndarray] = field(default_factory=list)
    complaint: str = "not tried"

    def face(self, tag: int) -> str:
        """Name of a face."""
        return f"{self.name}:{self.faces.index(tag) + 1}"


def _apart(path: Path, source: str, h: Any, exclude: list[str]) -> Mesh:
    """The mesh in which solids share nothing; what becomes of one does not depend on the others."""
    with session():
        solids, remarks = _survey(path, source, h, exclude)
    for algorithm, per_circle in ATTEMPTS:
        if not (left := [solid for solid in solids if solid.complaint]):
            break
        with session():
            read_model(path, source)
            everything = gmsh.model.getEntities()
            gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_circle)
            gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
            for solid in left:
                gmsh.model.setVisibility(everything, 0)
                gmsh.model.setVisibility([(3, solid.tag)], 1, recursive=True)
                solid.complaint = _mesh_visible(solid)
                gmsh.model.mesh.clear()
    failed = [Problem(("mesh", "step"), f"{source}: {solid.name} cannot be meshed: {solid.complaint}",
                      "solids whose faces close and can be "
                      f"meshed", f"repair the solid, try a smaller h, or leave it out: exclude: [{solid.name}]")
              for solid in solids if solid.complaint]
    if failed:
        raise InputError(failed)
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    surfaces = {f"{solid.name}:{k}": triangles + start for solid, start in zip(solids, starts)
                for k, triangles in enumerate(solid.surfaces, start=1)}
    return Mesh(np.concatenate([solid.points for solid in solids]),
                np.concatenate([solid.cells + start for solid, start in zip(solids, starts)]),
                np.repeat(np.arange(len(solids)), [len(solid.cells) for solid in solids]), [solid.name for solid in solids],
                surfaces, source, remarks, list(surfaces))


def _survey(path: Path, source: str, h: Any, exclude: list[str]) -> tuple[list[Solid], list[str]]:
    """The solids that are to be meshed, and remarks on what is small in them; gmsh must be switched on."""
    found, names, loose = read_model(path, source)
    shells = [f"shell_{i}" for i in range(1, len(loose) + 1)]
    kept = leave_out(source, names, exclude, [*names, *shells])
    left = {name for pattern in exclude for name in matching(pattern, [*names, *shells])}
    open_ = [Problem(("mesh", "step"), f"{source}: {name}, {len(faces)} faces, the first at "
                     f"({', '.join(f'{x:.4g}' for x in gmsh.model.occ.getCenterOfMass(2, faces[0]))}), close no solid",
                     "closed solids", f"repair the body in CAD and export it again, or leave it out: exclude: [{name}]")
             for name, faces in zip(shells, loose) if name not in left]
    if open_:
        raise InputError(open_)
    sizes = _sizes([names[i] for i in kept], h)
    if sizes:
        check_h([found[i] for i in kept], max(sizes.values()))
    solids = [Solid(found[i][1], names[i], sorted({tag for _, tag in gmsh.model.getBoundary([found[i]], combined=False, oriented=False)}),
                    sizes.get(names[i])) for i in kept]
    return solids, list(_small(solids))


def _sizes(names: list[str], h: Any) -> dict[str, float]:
    """Element size by name; of several patterns that match, the last wins."""
    if h is None:
        return {}
    if not isinstance(h, dict):
        return dict.fromkeys(names, float(h))
    problems, sizes = Problems(), {}
    for pattern, size in h.items():
        if not (own := matching(pattern, names)):
            problems.add(("mesh", "h"), f"no solid is called {pattern!r}", "names of solids, shell wildcards allowed",
                         suggestion(pattern, names, "solid"))
        sizes.update(dict.fromkeys(own, float(size)))
    if left := [name for name in names if name not in sizes]:
        problems.add(("mesh", "h"), f"no element size for {some(left, 8)}", "an element size for each solid",
                     "begin with one for all: '*': 5")
    problems.raise_if_any()
    return sizes


def _small(solids: list[Solid]) -> Iterator[str]:
    """Sentences on edges and faces that are tiny beside the whole model."""
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    least = SMALL * float(np.linalg.norm(box[1] - box[0]))
    for solid in solids:
        tiny: dict[str, float] = {}
        for tag in solid.faces:
            edges = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False)
            lengths = [length for length in (gmsh.model.occ.getMass(*edge) for edge in set(edges)) if length > 0]
            size = min([np.sqrt(gmsh.model.occ.getMass(2, tag)), *lengths])
            if size < least:
                tiny[solid.face(tag)] = size
        if tiny:
            yield (f"{solid.name} is small in places beside the whole model, {len(tiny)} of its {len(solid.faces)} faces "
                   f"measure {min(tiny.values()):.3g} or have an edge that short ({some(sorted(tiny, key=tiny.get), SHOWN)}): "
                   f"elements there are as small; heal the model, or leave the solid out: exclude: [{solid.name}]")


def _mesh_visible(solid: Solid) -> str:
    """Meshes the one solid that is visible; says what is wrong, empty where nothing is."""
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22 if solid.h is None else solid.h)
    try:
        gmsh.model.mesh.generate(2)
        if complaint := _open(solid):
            return complaint
        gmsh.model.mesh.generate(3)
    except Exception as error:
        return last_complaint(error)
    cells, _ = elements(TET, [solid.tag])
    if not len(cells):  # gmsh passes over what it cannot fill
        return f"no tetrahedra with h = {'auto' if solid.h is None else f'{solid.h:g}'}"
    used, inverse = np.unique(cells, return_inverse=True)
    solid.points, solid.cells = points(used), inverse.reshape(-1, 4)
    solid.surfaces = [np.searchsorted(used, elements(TRIANGLE, [tag])[0]) for tag in solid.faces]
    return ""


def _open(solid: Solid) -> str:
    """Says which faces of a solid do not close; empty where they do."""
    triangles, face = elements(TRIANGLE, solid.faces)
    bare = [solid.face(tag) for k, tag in enumerate(solid.faces) if not (face == k).any()]
    if bare:
        return f"no triangles on its faces {some(bare, SHOWN)}"
    ends, edge = edges_of(triangles, TRIANGLE_EDGES)
    alone = np.bincount(edge.ravel()) % 2 == 1
    if not alone.any():
        return ""
    tags, lengths = np.unique(np.repeat(face, 3)[alone[edge].ravel()], return_counts=True)
    where = points(np.unique(ends[alone])).mean(axis=0)
    names = [solid.face(solid.faces[k]) for k in tags[np.argsort(-lengths, kind="stable")]]
    return (f"its faces do not close: {alone.sum()} edges of {some(names, SHOWN)} have one triangle beside them, "
            f"about ({', '.join(f'{x:.4g}' for x in where)})")
