"""``orchestrator init``: a configuration to begin with, the names in its files, their pairs and
their bolts filled in.
"""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from orchestrator.config.mesh import Curved
from orchestrator.errors import LISTED, some, wrong
from orchestrator.inspect import section_of
from orchestrator.proposal import Proposal
from orchestrator.scene.inspection import SurfaceRow, surfaces_of
from orchestrator.scene.mesh.faces import Faces, faces_of
from orchestrator.scene.mesh.geometry import areas, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.sources import joined, make_mesh, placed
from orchestrator.scene.names import unique_names

WIDTH = 100  # of a line in the file
METIS = 20_000  # dofs of a subdomain, where the file has one volume
# elements on a full circle: chords are off it by 3 % of its radius, ten-node tets bend with it
CIRCLE = 12
# of the largest element the smallest, so that no fillet decides how large the mesh gets
LEAST = 0.1
NAMELESS = re.compile(r"solid(_\d+)?")


def begin(target: Path, sources: Sequence[Path], h: float | None) -> list[str]:
    """Writes the configuration ``target`` for mesh and CAD files, or for a beam without any.

    h : element size for CAD files; None: by thickness and curvature
    Returns what was written and what to do next, lines
    Raises InputError: a file cannot be read or has no surfaces; the target is there already, or its
    folder cannot be written to
    """
    text, remarks = _of_files(target, [_read(source, h) for source in sources]) if sources else (
        _beam(target.stem), [])
    try:
        with open(target, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise wrong((), f"{target}, which is there already", "the name of a new file",
                    "name another one, or remove it") from None
    except OSError as error:
        raise wrong((), f"{target}: {error.strerror}", "a place that can be written to",
                    "name another one") from error
    edit = ": it runs once you have been at every EDIT in it" * bool(sources)
    return [*remarks, f"{target} is written{edit}; then",
            f"    orchestrator check {target}", f"    orchestrator run {target}"]


@dataclass
class Source:
    """A file with its mesh.

    h : element sizes that are proposed for it, as text of the YAML; empty: no word of them
    left : names of solids that cannot be meshed, and why; rename : names of its volumes, and better
        ones
    """

    path: Path
    mesh: Mesh
    cad: bool
    h: str = ""
    left: dict[str, str] = field(default_factory=dict)
    rename: dict[str, str] = field(default_factory=dict)


def _read(path: Path, h: float | None) -> Source:
    section, failed = section_of(path, h), {}
    if section.step and h is None:
        section = section.model_copy(update={"h": Curved(curvature=CIRCLE)})
    mesh, faces = make_mesh(section, failed)
    size = f"{h:g}" if h else _sizes(mesh, faces)
    return Source(path, mesh, bool(section.step), size if section.step else "",
                  {name: problem.found for name, problem in failed.items()})


def _sizes(mesh: Mesh, faces: Faces) -> str:
    """Element sizes by curvature, none larger than the thickest solid is thick: twice its volume
    over its area.
    """
    each = areas(mesh.nodes, faces.triangles[faces.outer])
    thick = 2 * np.bincount(mesh.volume, tet_volumes(mesh.nodes, mesh.cells)) / np.bincount(
        mesh.volume[faces.owner[faces.outer]], each)
    largest = float(f"{thick.max():.2g}")
    return f"{{curvature: {CIRCLE}, min: {LEAST * largest:.2g}, max: {largest:g}}}"


def _of_files(target: Path, sources: list[Source]) -> tuple[str, list[str]]:
    """The configuration's text; and what was left out, lines."""
    names = unique_names([re.sub(r"[^\w. -]", "_", source.path.stem) for source in sources])
    mesh = sources[0].mesh if len(sources) == 1 else joined([placed(s.mesh, name, None)
                                                             for s, name in zip(sources, names)])
    faces = faces_of(mesh.cells, len(mesh.nodes))
    proposal = Proposal.of(mesh, faces)
    mesh = proposal.renamed({volume: name for volume, name in proposal.roles.items()
                             if NAMELESS.fullmatch(volume.rpartition("/")[2])})
    for source, name in zip(sources, names):
        inside = "" if len(sources) == 1 else f"{name}/"
        source.rename = {old.removeprefix(inside): new.removeprefix(inside)
                         for old, new in proposal.new_names.items() if old.startswith(inside)}
    rows = [row for row in surfaces_of(mesh) if row.area > 0]
    if not rows:
        raise wrong((), f"{some([str(s.path) for s in sources])} without surfaces that have names",
                    "physical groups of surfaces, node sets or a CAD file",
                    "name the surfaces where the mesh is made, or select faces by {plane: z, at: "
                    "0}")
    said = [f"remark: {text}; it is left out" for source in sources
            for text in source.left.values()]
    return _text(target, sources, names, mesh, rows, proposal), said


def _text(target: Path, sources: list[Source], names: list[str], mesh: Mesh,
          rows: list[SurfaceRow], proposal: Proposal) -> str:
    if len(sources) == 1:
        given = f"mesh: {_mesh(target, sources[0])}"
    else:
        given = "parts:\n" + "\n".join(f"  - {{name: {json.dumps(name)}, mesh: "
                                       f"{_mesh(target, s)}}}" for name, s in zip(names, sources))
    subdomains = "groups                # one per volume" if len(mesh.volumes) > 1 else (
        f"{{metis: {max(2, round(3 * len(mesh.nodes) / METIS))}}}            # connected parts of "
        "about equal size")
    held, loaded = _ends(rows, bool(proposal.bolts))
    # names as YAML has them: JSON's texts are YAML's
    return f"""# A first configuration \
for {some([s.path.name for s in sources])}, by orchestrator init.
# Units are yours: one system \
throughout, such as N, mm, MPa.
name: {re.sub(r"[^A-Za-z0-9_. -]", "_", target.stem)}

{given}

# Volumes:  {_names(mesh.volumes)}
# Surfaces: {_names([row.name for row in rows])}
# With areas, centres and normals, and the pairs of parts that lie on each other: \
orchestrator inspect {target.name}

subdomains: {subdomains}

materials:                          # EDIT: the moduli; the last match wins
  - {{young: 200e3, poisson: 0.3}}    # everywhere; a part of its own: \
{{young: 70e3, poisson: 0.33, on: {json.dumps(mesh.volumes[-1])}}}

{proposal.boundary(held, loaded)}{proposal.interfaces()}
blackbox: {{element: auto}}         # ten-node tets (P2) unless the mesh is too large for \
them; P1: four-node ones
method:
  tolerance: {{error: {proposal.tolerance}}}        # of the energy: guaranteed \
where parts are bonded, estimated with friction
"""


def _mesh(target: Path, source: Source) -> str:
    """The ``mesh:`` section for a file."""
    place = str(source.path) if str(source.path).startswith("gmsh:") else os.path.relpath(
        source.path, target.parent)
    words = [f"{'step' if source.cad else 'file'}: {json.dumps(place)}"]
    if source.cad:
        words += [f"h: {source.h}", "conforming: false"]
    if source.left:
        words.append(f"exclude: {json.dumps(list(source.left))}")
    if source.rename:
        words.append("rename: {" + ", ".join(f"{json.dumps(old)}: {new}"
                                             for old, new in source.rename.items()) + "}")
    return "{" + ", ".join(words) + "}"


def _beam(name: str) -> str:
    return f"""# A first configuration, by orchestrator init. Units are yours: one system \
throughout, such as N, mm, MPa.
name: {re.sub(r"[^A-Za-z0-9_. -]", "_", name)}

mesh: {{beam: {{size: [160, 10, 10], h: 2.5}}}}    # or file: my.msh, or step: my.stp \
(orchestrator init my.stp)
subdomains: {{slices: {{axis: x, count: 8}}}}
materials:
  - {{young: 200e3, poisson: 0.3}}
boundary:                           # surfaces are called xmin … zmax
  - {{on: xmin, displacement: [0, 0, 0]}}
  - {{on: xmax, traction: [10, 0, 0]}}
method:
  tolerance: {{error: 1.0e-6}}
"""


def _ends(rows: list[SurfaceRow], across: bool) -> tuple[SurfaceRow, SurfaceRow]:
    """The lowest and the highest of the plane surfaces if there are two, along the longest extent
    of the surfaces' centres.

    across : of those that look along it, where there are two
    """
    plane = [row for row in rows if row.shape.kind == "plane"]
    chosen = plane if len(plane) > 1 else rows
    axis = int(np.ptp([row.centre for row in chosen], axis=0).argmax())
    facing = [row for row in chosen if row.shape.kind == "plane"
              and abs(row.shape.direction[axis]) > 0.9] if across else []
    chosen = facing if len(facing) > 1 else chosen
    centres = np.array([row.centre for row in chosen])
    return chosen[int(centres[:, axis].argmin())], chosen[int(centres[:, axis].argmax())]


def _names(names: list[str]) -> str:
    """Names as lines of a comment."""
    return "\n#           ".join(textwrap.wrap(some(names, LISTED), WIDTH, break_long_words=False))
