"""``orchestrator init``: a configuration to begin with, its file's own names filled in."""

from __future__ import annotations

import json
import os
import re
import textwrap
from pathlib import Path

import numpy as np

from orchestrator.errors import some, wrong
from orchestrator.inspect import section_of
from orchestrator.scene.inspection import SurfaceRow, pairs_of_mesh, surfaces_of
from orchestrator.scene.mesh.sources import make_mesh

SHOWN = 60  # names of a kind in a comment
WIDTH = 100
METIS = 20_000  # dofs of a subdomain, where the file has one volume


def begin(target: Path, source: Path | None, h: float | None) -> list[str]:
    """Writes the configuration ``target`` for the mesh or CAD file ``source``, or for a beam without one.

    h : element size for CAD files; None: the mesher derives one
    Returns what was written and what to do next, lines
    Raises InputError: the file cannot be read or has no surfaces; the target is there already, or its folder cannot be written to
    """
    text = _beam(target.stem) if source is None else _of_file(target, source, h)
    try:
        with open(target, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise wrong((), f"{target}, which is there already", "a file that is not", "name another one") from None
    except OSError as error:
        raise wrong((), f"{target}: {error.strerror}", "a place that can be written to", "name another one") from error
    return [f"{target} is written: look for EDIT in it, then", f"    orchestrator check {target}", f"    orchestrator run {target}"]


def _of_file(target: Path, source: Path, h: float | None) -> str:
    section = section_of(source, h)
    mesh, faces = make_mesh(section)
    rows = [row for row in surfaces_of(mesh) if row.area > 0]
    if not rows:
        raise wrong((), f"{source} without surfaces that have names", "physical groups of surfaces, node sets or a CAD file",
                    "name the surfaces where the mesh is made, or select faces by {plane: z, at: 0}")
    held, loaded = _lowest_and_highest(rows)
    several = len(mesh.volumes) > 1
    place = str(source) if str(source).startswith("gmsh:") else os.path.relpath(source, target.parent)
    pairs = len(list(pairs_of_mesh(mesh, faces))) if several else 0
    given = f"file: {json.dumps(place)}"
    if section.step:
        given = f"step: {json.dumps(place)}" + (f", h: {h:g}" if h else "") + ", conforming: false"
    subdomains = "groups                # one per volume" if several else (
        f"{{metis: {max(2, round(3 * len(mesh.nodes) / METIS))}}}            # connected parts of about equal size")
    # names as YAML has them: JSON's texts are YAML's
    return f"""# A first configuration for {source.name}, by orchestrator init. Units are yours: one system throughout, such as N, mm, MPa.
name: {re.sub(r"[^A-Za-z0-9_. -]", "_", target.stem)}

mesh: {{{given}}}

# Volumes:  {_names(mesh.volumes)}
# Surfaces: {_names([row.name for row in rows])}
# With areas, centres and normals, and the pairs of parts that lie on each other: orchestrator inspect {target.name}

subdomains: {subdomains}

materials:                          # EDIT: the last match wins
  - {{young: 200e3, poisson: 0.3}}    # everywhere; a part of its own: {{young: 70e3, poisson: 0.33, on: {json.dumps(mesh.volumes[-1])}}}

boundary:                           # EDIT: what is held and what acts
  - {{on: {json.dumps(held.name)}, displacement: [0, 0, 0]}}      # the lowest plane surface; null leaves a component free
  - {{on: {json.dumps(loaded.name)}, resultant: {{force: [0, 0, -1]}}}}   # the highest; or traction: [..], pressure: 1, motion: {{..}}
{_joints(pairs)}
blackbox: {{element: auto}}         # ten-node tets (P2) unless the mesh is too large for them; P1: four-node ones
method:
  tolerance: {{error: 1.0e-6}}        # bonded: guaranteed bound on the energy error; with contact, the laws' residual
"""


def _joints(pairs: int) -> str:
    if not pairs:
        return ""
    count = "one pair of parts lies" if pairs == 1 else f"{pairs} pairs of parts lie"
    return f"""
interfaces:                         # {count} on each other
  - {{between: auto, law: perfect}}   # EDIT: bonded; or law: contact, friction: 0.1, between: auto or [one, other]
"""


def _beam(name: str) -> str:
    return f"""# A first configuration, by orchestrator init. Units are yours: one system throughout, such as N, mm, MPa.
name: {re.sub(r"[^A-Za-z0-9_. -]", "_", name)}

mesh: {{beam: {{size: [160, 10, 10], h: 2.5}}}}    # EDIT: or file: my.msh, or step: my.stp (orchestrator init my.yaml my.stp)
subdomains: {{slices: {{axis: x, count: 8}}}}
materials:
  - {{young: 200e3, poisson: 0.3}}
boundary:                           # surfaces are called xmin … zmax
  - {{on: xmin, displacement: [0, 0, 0]}}
  - {{on: xmax, traction: [10, 0, 0]}}
method:
  tolerance: {{error: 1.0e-6}}
"""


def _lowest_and_highest(rows: list[SurfaceRow]) -> tuple[SurfaceRow, SurfaceRow]:
    """Of the plane surfaces if there are two, along the longest extent of the surfaces' centres."""
    plane = [row for row in rows if row.shape.kind == "plane"]
    chosen = plane if len(plane) > 1 else rows
    centres = np.array([row.centre for row in chosen])
    axis = int(np.ptp(centres, axis=0).argmax())
    return chosen[int(centres[:, axis].argmin())], chosen[int(centres[:, axis].argmax())]


def _names(names: list[str]) -> str:
    """In lines of a comment."""
    return "\n#           ".join(textwrap.wrap(some(names, SHOWN), WIDTH, break_long_words=False))
