"""``orchestrator inspect``: what is in a file or in a configuration; ``orchestrator check``: what
is wrong with it. Nothing is solved.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from orchestrator.blackbox.start import find_codes
from orchestrator.config.mesh import MeshEntry as Section
from orchestrator.config.method import Method
from orchestrator.config.model import Config
from orchestrator.errors import InputError, LISTED, Problem
from orchestrator.method.interface.stabilisation import cautions as stabilisation_cautions
from orchestrator.registry import FOREIGN
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.foreign.joints import not_asked
from orchestrator.scene.inspection import (
    bolt_table, pair_table, pairs_of_mesh, pairs_of_scene, surface_table, surfaces_of, units_remark,
    volume_table)
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.sources import make_mesh, make_parts
from orchestrator.scene.model import Scene

STEP = {".stp", ".step"}
CAD = {*STEP, ".brep"}


def inspected(path: Path, h: float | None = None) -> list[str]:
    """Lines on a mesh file, or on a CAD file whose solids are meshed one by one; solids that cannot
    be are told.

    Raises InputError: it cannot be read, or is no sound mesh
    """
    failed: dict[str, Problem] = {}
    mesh, faces = make_mesh(section_of(path, h), failed)
    if path.suffix.lower() in STEP and not any("unit of length" in text for text in mesh.remarks):
        mesh.remarks.insert(0, "the file's unit of length is the mm, and so is that of h")
    return [*_lines(mesh, faces),
            *(f"remark: {problem.found}; {problem.cure}" for problem in failed.values())]


def section_of(path: Path, h: float | None = None) -> Section:
    """The ``mesh:`` section for a file; solids of a CAD file share nothing. Raises InputError for a
    folder.
    """
    if path.is_dir():
        results = (path / "summary.json").is_file()
        raise InputError(Problem((), "a folder of results" if results else "a folder",
                                 "a mesh, STEP or BREP file, or a YAML file to inspect",
                                 f"orchestrator report {shlex.quote(str(path))} tells what a run "
                                 "has found" if results else
                                 "name a file in it", str(path)))
    if path.suffix.lower() in CAD or str(path).startswith("gmsh:"):
        return Section(step=str(path), h=h, conforming=False)
    return Section(file=str(path))


def listed(config: Config, run_programs: bool = False) -> list[str]:
    """Lines on a configuration: of its scene where it makes one, else of its meshes, and what is
    wrong.

    run_programs : whether parts that are programs are started; else these are not there
    Raises InputError: there is no mesh
    """
    young = [matter.young for matter in config.matter]
    if not run_programs and _programs(config):
        mesh, faces = make_parts(config.parts, run_programs=None)
        return [*_lines(mesh, faces, young), "", *not_asked(config)]
    try:
        scene = build_scene(config, run_programs=run_programs)
    except InputError as error:
        mesh, faces = make_mesh(config.mesh) if config.mesh else make_parts(
            config.parts, run_programs=run_programs)
        return [*_lines(mesh, faces, young), "", f"no scene yet, {len(error.problems)} "
                                                 f"problem{'s' if len(error.problems) > 1 else ''} "
                                                 "in the input: orchestrator check tells"]
    mesh, first = scene.mesh, np.unique(scene.mesh.volume, return_index=True)[1]
    made_of = (scene.materials[m] for m in scene.cell_material[first])
    matter = {name: f"E {m.young:g}, ν {m.poisson:g}" for name, m in zip(mesh.volumes, made_of)}
    return [*_content(mesh, young, matter), *pair_table(pairs_of_scene(scene)), *bolt_table(scene)]


def _programs(config: Config) -> bool:
    """Whether there are parts that are programs, which no one knows before they are run."""
    return any(part.program for part in config.parts or ())


def _lines(mesh: Mesh, faces: Faces, young: Sequence[float] = ()) -> list[str]:
    return [*_content(mesh, young), *pair_table(pairs_of_mesh(mesh, faces)),
            *(f"remark: {text}" for text in mesh.remarks)]


def _content(mesh: Mesh, young: Sequence[float] = (),
             matter: Mapping[str, str] | None = None) -> list[str]:
    box = " … ".join(format_point(corner)
                     for corner in (mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)))
    return [repr(mesh), f"box {box}, {units_remark(mesh, young)}", "",
            *volume_table(mesh, matter), "",
            *surface_table(surfaces_of(mesh)), ""]


def checked(config: Config, run_programs: bool = False) -> list[str]:
    """Lines on a sound scene.

    run_programs : whether programs, interpreters and forms that the configuration names are run;
        else it is told what is not checked therefore: with a program among the parts, all but the
        meshes, matrices and decks of the others
    Raises InputError: the mesh, the codes or the number of iterations do not fit it
    """
    unsaid = [] if run_programs else not_asked(config)
    if not run_programs and _programs(config):
        return [*_parts_alone(config), *unsaid]
    scene = build_scene(config, run_programs=run_programs)
    for code in find_codes(config.codes, {s.code for s in scene.subdomains}, run_programs).values():
        if run_programs or not code.check_runs:
            code.check()
    _check_iterations(scene, config.method)
    lines = [f"OK: {scene!r}", *unsaid]
    if scene.element is not None:
        lines.append(f"element: {scene.element}")
    lines += [*_pairs(scene, config), *bolt_table(scene)]
    gaps = [beside.gap for beside in scene.near.values() if beside.gap]
    lines += [f"gap: {sentence}" for sentence in gaps[:LISTED]] + [
        f"… and {len(gaps) - LISTED} gaps more"] * (len(gaps) > LISTED)
    laws = dict.fromkeys(f"{i.name} {i.law.caution}" for i in scene.interfaces if i.law.caution)
    said = [*scene_cautions(scene), *stabilisation_cautions(config.method), *laws]
    if config.output.units is None:
        lines.append(
            f"units: {units_remark(scene.mesh, [matter.young for matter in config.matter])}")
    return lines + [f"warning: {sentence}" for sentence in said]


def _parts_alone(config: Config) -> list[str]:
    """Reports on the parts that are no programs, each by itself; raises InputError for what is
    wrong with them.
    """
    others = [part for part in config.parts if not part.program]
    lines = [f"OK as far as checked: {len(others)} of {len(config.parts)} parts, each by itself"]
    if others:
        mesh, _ = make_parts(config.parts, run_programs=None)
        lines += [f"warning: {remark}" for remark in mesh.remarks]
    meshed = any(part.mesh for part in others)
    used = [i for i, entry in enumerate(config.codes) if entry.code != "program"
            and (meshed or entry.code in FOREIGN)]
    for code in find_codes(config.codes, used, run_programs=False).values() if used else ():
        if not code.check_runs:
            code.check()
    return lines


def _pairs(scene: Scene, config: Config) -> list[str]:
    """Pairs that have been found rather than named, and those whose meshes do not match."""
    if not any(entry.found for entry in config.interfaces) and all(
        i.paired for i in scene.interfaces):
        return []
    return pair_table(pairs_of_scene(scene), LISTED)


def _check_iterations(scene: Scene, method: Method) -> None:
    """Whether there are enough of them; where there is no doubt, the method is not even
    imported.
    """
    if scene.steps > method.max_iterations:
        from orchestrator.method.iterated import load_cases
        from orchestrator.method.increments import check_iterations
        from orchestrator.refused import by_keys

        with by_keys():
            check_iterations(len(load_cases(scene).chosen), scene, method)
