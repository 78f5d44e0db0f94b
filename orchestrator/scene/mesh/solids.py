"""Meshes of STEP and BREP models: each solid by itself, at its own element size, or solids that
share the faces where they touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.errors import InputError, Problem, some, visible, wrong
from orchestrator.scene.mesh.cad import (
    apply_refinement, check_curvature, face_shape, refined_faces, sizes_of, Sizing)
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.gmsh_session import (
    ATTEMPTS, check_h, elements, gmsh, last_complaint, leave_out, locate, points, read_model,
    read_unit, session, TET, TRIANGLE)
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import edges_of, TRIANGLE_EDGES
from orchestrator.scene.mesh.size_map import Sizes, WHOLE
from orchestrator.scene.names import matching, renamed
from orchestrator.scene.shapes import Shape


# Edges and faces shorter than this share of the whole model are told: elements there are as small.
SMALL = 1e-3


def step(mesh: Any, failed: dict[str, Problem] | None = None, sizes: Sizes | None = None) -> Mesh:
    """The CAD model named by ``mesh.step``, meshed with elements of size ``mesh.h``, lengths of
    STEP in mm.

    Without h, gmsh takes a tenth of the model's size, less where the shape asks for it. Volumes
    carry the solids' names; each geometric surface on the outer boundary is a named surface
    ``<solid>:<k>``, k from 1.

    failed : takes what is wrong with single solids, by name, of a mesh that is not conforming: they
        are left out then
    sizes : elements are as small as these say, in the solid of that name, or in all that is meshed
        in one piece
    Raises InputError: unreadable, no solids, faces that close none, names that match none, solids
    that gmsh cannot mesh
    """
    path = locate(str(mesh.step))
    if getattr(mesh, "conforming", None) is False:
        made = _apart(path, mesh, failed, sizes or {})
    else:
        made = conforming(path, mesh, sizes or {})
    return replace(made, remarks=[*read_unit(path), *made.remarks])


@dataclass
class MeshedSolid:
    """One solid of a model that is meshed by itself.

    tag : gmsh's; name : unique; faces : tags of its faces, ascending, named ``name:1`` and on
    size : of its elements
    points : (n, 3), cells : (m, 4), surfaces : triangles per face, shapes : of its faces, once it
        is meshed; complaint : why it is not
    """

    tag: int
    name: str
    faces: list[int]
    size: Sizing
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    cells: np.ndarray = field(default_factory=lambda: np.empty((0, 4), dtype=int))
    surfaces: list[np.ndarray] = field(default_factory=list)
    shapes: list[Shape] = field(default_factory=list)
    complaint: str = "not tried"

    def face(self, tag: int) -> str:
        """Name of a face."""
        return f"{self.name}:{self.faces.index(tag) + 1}"


def _apart(path: Path, mesh: Any, failed: dict[str, Problem] | None, sizes: Sizes) -> Mesh:
    """The mesh in which solids share nothing; what becomes of one does not depend on the others."""
    source, refine = str(mesh.step), getattr(mesh, "refine", None) or []
    with session():
        solids, remarks = _survey(path, mesh, failed)
    refined = refined_faces(refine,
                            {solid.face(tag): tag for solid in solids for tag in solid.faces})
    for algorithm, per_circle in ATTEMPTS:
        if not (left := [solid for solid in solids if solid.complaint]):
            break
        with session():
            read_model(path, source)
            everything = gmsh.model.getEntities()
            gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
            gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
            for solid in left:
                finest = apply_refinement(refined, sizes.get(visible(solid.name), sizes.get(WHOLE)))
                gmsh.model.setVisibility(everything, 0)
                gmsh.model.setVisibility([(3, solid.tag)], 1, recursive=True)
                solid.size.apply(per_circle, finest)
                solid.complaint = _mesh_visible(solid)
                gmsh.model.mesh.clear()
    bad = {
        solid.name: Problem(("mesh", "step"),
                            f"{source}: {solid.name} cannot be meshed: {solid.complaint}",
                            "solids whose faces close and can be meshed",
                            "repair the solid, try a smaller h, or leave it out: exclude: "
                            f"[{solid.name}]")
           for solid in solids if solid.complaint}
    if bad and (failed is None or len(bad) == len(solids)):
        raise InputError(list(bad.values()))
    if bad:
        failed.update(bad)
    solids = [solid for solid in solids if not solid.complaint]
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    surfaces = {f"{solid.name}:{k}": triangles + start for solid, start in zip(solids, starts)
                for k, triangles in enumerate(solid.surfaces, start=1)}
    return Mesh(np.concatenate([solid.points for solid in solids]),
                np.concatenate([solid.cells + start for solid, start in zip(solids, starts)]),
                np.repeat(np.arange(len(solids)), [len(solid.cells) for solid in solids]),
                [solid.name for solid in solids],
                surfaces, source, remarks,
                dict(zip(surfaces, (shape for solid in solids for shape in solid.shapes))))


def _survey(path: Path, mesh: Any, failed: dict[str, Problem]
            | None) -> tuple[list[MeshedSolid], list[str]]:
    """The solids that are to be meshed, and remarks on what is small in them; gmsh must be switched
    on.
    """
    source, exclude = str(mesh.step), getattr(mesh, "exclude", None) or []
    found, names, loose = read_model(path, source)
    names = renamed(names, getattr(mesh, "rename", None), ("mesh", "rename"))
    shells = [f"shell_{i}" for i in range(1, len(loose) + 1)]
    kept = leave_out(source, names, exclude, [*names, *shells])
    left = {name for pattern in exclude for name in matching(pattern, [*names, *shells])}
    open_ = {
        name: Problem(
            ("mesh", "step"),
            f"{source}: {name}, {len(faces)} faces, the first at"
            f" ({', '.join(f'{x:.4g}' for x in gmsh.model.occ.getCenterOfMass(2, faces[0]))}),"
            " close no solid",
            "closed solids",
            f"repair the body in CAD and export it again, or leave it out: exclude: [{name}]")
        for name, faces in zip(shells, loose)
        if name not in left}
    if open_ and failed is None:
        raise InputError(list(open_.values()))
    if failed is not None:
        failed.update(open_)
    sizes = sizes_of([names[i] for i in kept], mesh.h)
    if largest := max((size.largest for size in sizes.values() if size.largest is not None),
                      default=None):
        check_h([found[i] for i in kept], largest)
    solids = [
        MeshedSolid(found[i][1], names[i],
                    sorted(
                        {tag
                         for _, tag in gmsh.model.getBoundary(
                             [found[i]], combined=False, oriented=False)}),
                    sizes[names[i]]) for i in kept]
    check_curvature((solid.faces, solid.size) for solid in solids)
    return solids, list(_small(solids))


def _small(solids: list[MeshedSolid]) -> Iterator[str]:
    """Sentences on edges and faces that are tiny beside the whole model."""
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    least = SMALL * float(np.linalg.norm(box[1] - box[0]))
    for solid in solids:
        tiny: dict[str, float] = {}
        for tag in solid.faces:
            edges = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False)
            lengths = [length for length in (gmsh.model.occ.getMass(*edge) for edge in set(edges))
                       if length > 0]
            size = min([np.sqrt(gmsh.model.occ.getMass(2, tag)), *lengths])
            if size < least:
                tiny[solid.face(tag)] = size
        if tiny:
            yield (
                f"{solid.name} is small in places beside the whole model, {len(tiny)} of its "
                f"{len(solid.faces)} faces measure {min(tiny.values()):.3g} or have an edge that "
                f"short ({some(sorted(tiny, key=tiny.get))}): elements there are as small; "
                f"heal the model, or leave the solid out: exclude: [{solid.name}]")


def _mesh_visible(solid: MeshedSolid) -> str:
    """Meshes the one solid that is visible; says what is wrong, empty where nothing is."""
    try:
        gmsh.model.mesh.generate(2)
        if complaint := _open(solid):
            return complaint
        gmsh.model.mesh.generate(3)
    except Exception as error:
        return last_complaint(error)
    cells, _ = elements(TET, [solid.tag])
    if not len(cells):  # gmsh passes over what it cannot fill
        return f"no tetrahedra with h = {solid.size}"
    used, solid.cells = renumbered(cells)
    solid.points = points(used)
    solid.surfaces = [np.searchsorted(used, elements(TRIANGLE, [tag])[0]) for tag in solid.faces]
    solid.shapes = [face_shape(tag) for tag in solid.faces]
    return ""


def _open(solid: MeshedSolid) -> str:
    """Says which faces of a solid do not close; empty where they do."""
    triangles, face = elements(TRIANGLE, solid.faces)
    bare = [solid.face(tag) for k, tag in enumerate(solid.faces) if not (face == k).any()]
    if bare:
        return f"no triangles on its faces {some(bare)}"
    ends, edge = edges_of(triangles, TRIANGLE_EDGES)
    alone = np.bincount(edge.ravel()) % 2 == 1
    if not alone.any():
        return ""
    tags, lengths = np.unique(np.repeat(face, 3)[alone[edge].ravel()], return_counts=True)
    where = points(np.unique(ends[alone])).mean(axis=0)
    names = [solid.face(solid.faces[k]) for k in tags[np.argsort(-lengths, kind="stable")]]
    return (
        f"its faces do not close: {alone.sum()} edges of {some(names)} have one triangle "
        f"beside them, about ({', '.join(f'{x:.4g}' for x in where)})")


def conforming(path: Path, mesh: Any, sizes: Sizes) -> Mesh:
    """The mesh of a model ``path``, as the keys of ``mesh`` say, and as fine as ``sizes``.

    Raises InputError: as ``solids.step``
    """
    source, sizing, complaint = str(mesh.step), Sizing.of(mesh.h), ""
    for algorithm, per_circle in ATTEMPTS:
        with session():
            names, owner = joined(path, mesh, sizing)
            refined = refined_faces(getattr(mesh, "refine", None) or [], outer_faces(names, owner))
            sizing.apply(per_circle, apply_refinement(refined, sizes.get(WHOLE)))
            gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
            try:
                gmsh.model.mesh.generate(3)
            except Exception as error:
                complaint = last_complaint(error)
                continue
            # gmsh passes over solids it cannot fill without raising an error.
            empty = {names[solid] for tag, solid in owner.items()
                     if not len(gmsh.model.mesh.getElementsByType(TET, tag)[0])}
            if not empty:
                return arrays(source, names, owner)
            complaint = "no tetrahedra in " + ", ".join(sorted(empty))
    raise wrong(("mesh", "step"), f"{source}: gmsh cannot mesh it with h = {sizing}: {complaint}",
                "solids that can be meshed", "try a smaller h, or repair the model")


def joined(path: Path, mesh: Any, sizing: Sizing) -> tuple[list[str], dict[int, int]]:
    """Makes touching solids share faces: their names, and the tag of each piece → the solid it
    comes from.
    """
    source, exclude = str(mesh.step), getattr(mesh, "exclude", None) or []
    solids, names, _ = read_model(path, source, shells=False)
    names = renamed(names, getattr(mesh, "rename", None), ("mesh", "rename"))
    if exclude:
        kept = leave_out(source, names, exclude, names)
        gmsh.model.occ.remove([s for i, s in enumerate(solids) if i not in kept], recursive=True)
        gmsh.model.occ.synchronize()
        solids, names = [solids[i] for i in kept], [names[i] for i in kept]
    if sizing.largest is not None:
        check_h(solids, sizing.largest)
    check_curvature([([tag for _, tag in gmsh.model.getEntities(2)], sizing)])
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


def outer_faces(names: list[str], owner: dict[int, int]) -> dict[str, int]:
    """Names of the faces on the outer boundary, ``<solid>:<k>``, and their tags."""
    counts, found = dict.fromkeys(names, 0), {}
    for _, tag in gmsh.model.getEntities(2):
        beside = gmsh.model.getAdjacencies(2, tag)[0]
        if len(beside) == 1:
            name = names[owner[int(beside[0])]]
            counts[name] += 1
            found[f"{name}:{counts[name]}"] = tag
    return found


def arrays(source: str, names: list[str], owner: dict[int, int]) -> Mesh:
    """The mesh that gmsh holds of solids as ``joined`` tells them."""
    pieces = [tag for _, tag in gmsh.model.getEntities(3)]
    cells, piece = elements(TET, pieces)
    used, cells = renumbered(cells)
    faces = outer_faces(names, owner)
    surfaces = {name: np.searchsorted(used, elements(TRIANGLE, [tag])[0])
                for name, tag in faces.items()}
    kept, volume = np.unique(np.array([owner[tag] for tag in pieces])[piece], return_inverse=True)
    return Mesh(points(used), cells, volume, [names[i] for i in kept], surfaces,
                source,
                smooth={name: face_shape(tag) for name, tag in faces.items()})
