"""Meshes of STEP and BREP models in which touching solids share their faces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.errors import wrong
from orchestrator.scene.mesh.cad import (
    Sizing, apply_refinement, check_curvature, face_shape, refined_faces)
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.gmsh_session import (
    ATTEMPTS, TET, TRIANGLE, check_h, elements, gmsh, last_complaint, leave_out, points, read_model,
    session)
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.size_map import Sizes, WHOLE
from orchestrator.scene.names import renamed


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
