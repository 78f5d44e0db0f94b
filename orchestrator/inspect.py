"""``orchestrator inspect``: what is in a file or in a configuration, before anything is asked of it."""

from __future__ import annotations

from pathlib import Path

from orchestrator.config import Config
from orchestrator.config.mesh import Mesh as Section
from orchestrator.errors import InputError
from orchestrator.scene.build import build_scene
from orchestrator.scene.inspection.content import surfaces_of, volumes_of
from orchestrator.scene.inspection.pairs import pairs_of_mesh, pairs_of_scene
from orchestrator.scene.inspection.tables import pair_table, surface_table, volume_table
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.sources import make_mesh, make_parts
from orchestrator.scene.model import Mesh

CAD = {".stp", ".step", ".brep"}


def inspected(path: Path, h: float | None = None) -> list[str]:
    """Lines on a mesh file, or on a CAD file whose solids are meshed one by one.

    Raises
    ------
    InputError : it cannot be read, or is no sound mesh
    """
    return _lines(*make_mesh(section_of(path, h)))


def section_of(path: Path, h: float | None = None) -> Section:
    """What ``mesh:`` says of a file; solids of a CAD file share nothing."""
    if path.suffix.lower() in CAD or str(path).startswith("gmsh:"):
        return Section(step=str(path), h=h, conforming=False)
    return Section(file=str(path))


def listed(config: Config) -> list[str]:
    """Lines on a configuration: of its scene where it makes one, else of its meshes, and what is wrong.

    Raises
    ------
    InputError : there is no mesh
    """
    try:
        scene = build_scene(config)
    except InputError as error:
        mesh = make_mesh(config.mesh) if config.mesh else make_parts(config.parts)
        return [*_lines(*mesh), "", f"no scene yet, {len(error.problems)} problem"
                f"{'s' if len(error.problems) > 1 else ''} in the input: orchestrator check tells"]
    return [*_content(scene.mesh), *pair_table(pairs_of_scene(scene))]


def _lines(mesh: Mesh, faces: Faces) -> list[str]:
    return [*_content(mesh), *pair_table(pairs_of_mesh(mesh, faces)), *(f"remark: {text}" for text in mesh.remarks)]


def _content(mesh: Mesh) -> list[str]:
    return [repr(mesh), "", *volume_table(volumes_of(mesh)), "", *surface_table(surfaces_of(mesh)), ""]
