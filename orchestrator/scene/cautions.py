"""Sentences on scenes that can be solved, but hardly are what was meant: ``check`` says them, and every summary."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from orchestrator.scene.interfaces.search import paired_faces
from orchestrator.scene.mesh.quadratic import LOCKING
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Interface, Scene
from orchestrator.scene.mesh.mesh import SplitNumbering
from orchestrator.errors import some

FLAT = 1e-9  # share of a force, along an axis, that is rounding


def locking(scene: Scene) -> Iterator[str]:
    """Four-node tets of nearly incompressible matter."""
    if scene.mesh.cells.shape[1] != 4:
        return
    poisson = np.array([material.poisson for material in scene.materials])[scene.cell_material]
    stiff = poisson > LOCKING
    if stiff.any():
        where = some([scene.mesh.volumes[v] for v in np.unique(scene.mesh.volume[stiff])])
        yield (f"Poisson's ratio {poisson.max():g} in {where} with four-node tets (P1), which lock from about {LOCKING:g} on: "
               "they move too little, however small the residuals; take blackbox: {element: P2}, which code: freefem has")


def noted(scene: Scene) -> Iterator[str]:
    """Cautions noted when the scene was built: parts that are near each other, histories without use."""
    yield from scene.warnings


def unloaded(scene: Scene) -> Iterator[str]:
    """Nothing acts, or only where it goes straight into a support."""
    moved = any(s.prescribed.any() for s in scene.subdomains) or any(law.acts for i in scene.interfaces for law in (i.law, *i.law_at_steps))
    if not moved and not any(s.loads.any() for s in scene.subdomains):
        yield ("nothing loads the scene: no traction, no pressure, no body force, no displacement other than zero; "
               "nothing will move")
    for entry in scene.boundary:
        largest = entry.forces.largest if entry.forces else np.zeros(3)
        acts = largest > FLAT * largest.max()
        if not acts.any():
            continue
        if scene.fixed[entry.nodes][:, acts].all():
            yield (f"boundary[{entry.index}], a {entry.kind}, acts on faces alone whose displacement is prescribed along "
                   "it: it goes straight into the support and moves nothing")


RULES: list[Callable[[Scene], Iterator[str]]] = [locking, noted, unloaded]


def scene_cautions(scene: Scene) -> list[str]:
    """Cautions that a user should know before the scene is solved."""
    return [sentence for rule in RULES for sentence in rule(scene)]


def loads_on_pairs(mesh: Mesh, boundary: list[BoundaryEntry], interfaces: list[Interface],
                   numbering: SplitNumbering) -> list[str]:
    """A sentence for each traction or pressure that acts on faces which an interface pairs with another part's.

    interfaces : all there are; only sides with nodes of their own count, shared faces are no outer ones
    """
    loads = [entry for entry in boundary if entry.forces and len(entry.triangles)]
    if not loads:
        return []
    paired = paired_faces(numbering, interfaces)
    result = []
    for entry in loads if len(paired) else []:
        hit = np.isin(pack(entry.triangles[:, :3], len(mesh.nodes)), paired)
        if hit.any():
            names = sorted({mesh.volumes[v] for v in mesh.volume[entry.cells[hit, 0]]})
            result.append(f"boundary[{entry.index}], a {entry.kind}, acts on {hit.sum()} faces of {', '.join(names)} that lie on another "
                          "part: name a surface of the part, as part/surface, or a smaller box, if that is not meant")
    return result
