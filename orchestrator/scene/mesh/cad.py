"""STEP and BREP models, meshed by gmsh so that touching parts share their interfaces."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import gmsh
import numpy as np

from orchestrator.errors import InputError, Problem, Problems
from orchestrator.scene.mesh.gmsh_session import HXT, TET, TRIANGLE, elements, last_complaint, points, session
from orchestrator.scene.mesh.recognised import check_content
from orchestrator.scene.mesh.size import DENSITY, check_size, coarser
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion, unique_names

# Labels that programs write where nobody has named a solid.
NOISE = re.compile(r"STEP translator|^=>\[[\d:]+\]$")
DELAUNAY = 1
# 3D algorithm, elements per full circle. HXT is three times faster and leaves far fewer slivers, but gives up
# on coarse curved surfaces; there finer circles help, where Delaunay does not.
ATTEMPTS = ((HXT, 0), (DELAUNAY, 0), (HXT, 6))


def locate(name: str) -> Path:
    """The file of a name; ``gmsh:part.stp`` is one of the examples that come with gmsh.

    Raises
    ------
    InputError : there is no such file
    """
    if name.startswith("gmsh:"):
        wanted = name.removeprefix("gmsh:")
        examples = [f for f in metadata.files("gmsh") or [] if "examples" in f.parts and f.suffix in (".stp", ".step")]
        for found in examples:
            if found.name == wanted and (path := Path(found.locate())).is_file():
                return path.resolve()
        raise InputError(Problem(("mesh", "step"), f"{name}: no such example of gmsh",
                                 "one of " + ", ".join(sorted({f"gmsh:{f.name}" for f in examples}))))
    if not Path(name).is_file():
        raise InputError(Problem(("mesh", "step"), f"{name}: no such file", "an existing STEP or BREP file",
                                 "check the path"))
    return Path(name)


def load(path: Path, h: float | None, source: str, exclude: Sequence[str] = ()) -> Mesh:
    """Imports, joins and meshes a model.

    Volumes carry the solids' product names (bolt_1, bolt_2, … where a name recurs); each geometric surface
    on the outer boundary is a named surface ``<solid>:<k>``, k from 1.

    Parameters
    ----------
    source : what the user calls the file, for messages
    exclude : patterns of names of solids that are left out

    Raises
    ------
    InputError : unreadable, no solids, names that match none, or gmsh cannot mesh it
    """
    complaint = ""
    for algorithm, per_circle in ATTEMPTS:
        with session():
            names, owner = _import(path, source, h, exclude)
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
            empty = {names[solid] for tag, solid in owner.items()
                     if not len(gmsh.model.mesh.getElementsByType(TET, tag)[0])}
            if not empty:
                return _arrays(source, names, owner)
            complaint = "no tetrahedra in " + ", ".join(sorted(empty))
    raise InputError(Problem(("mesh", "step"), f"{source}: gmsh cannot mesh it with h = {h}: {complaint}",
                             "solids that can be meshed", "try a smaller h, or repair the model"))


def _import(path: Path, source: str, h: float | None, exclude: Sequence[str]) -> tuple[list[str], dict[int, int]]:
    """Names of the solids; and the tag of each piece of the joined model → the solid it comes from."""
    solids, _ = read_model(path, source, shells=False)
    names = unique_names([product(*s) or "solid" for s in solids])
    if exclude:
        kept = leave_out(source, names, exclude, names)
        gmsh.model.occ.remove([s for i, s in enumerate(solids) if i not in kept], recursive=True)
        gmsh.model.occ.synchronize()
        solids, names = [solids[i] for i in kept], [names[i] for i in kept]
    if h is not None:
        check_h(solids, h)
    return names, _join(solids)


def read_model(path: Path, source: str, shells: bool = True) -> tuple[list[tuple[int, int]], list[list[int]]]:
    """The solids of a model, by dimension and tag, and shells of faces that close none, each the tags of its faces.

    gmsh must be switched on, and holds the model afterwards, its loose faces where ``shells`` are asked for.

    Raises
    ------
    InputError : unreadable, no solids
    """
    check_content(path, ("mesh", "step"), source)
    try:
        found = gmsh.model.occ.importShapes(str(path), highestDimOnly=not shells)
    except Exception as error:
        raise InputError(Problem(("mesh", "step"), f"{source}: cannot be read: {last_complaint(error)}",
                                 "a STEP or BREP file", "export the model again")) from None
    gmsh.model.occ.synchronize()
    solids = [s for s in found if s[0] == 3]
    if not solids:
        raise InputError(Problem(("mesh", "step"), f"{source}: no solids", "a model with at least one solid",
                                 "export closed solids, not surfaces"))
    loose = [tag for _, tag in gmsh.model.getEntities(2) if not len(gmsh.model.getAdjacencies(2, tag)[0])]
    grown: list[tuple[set[int], list[int]]] = []
    for tag in loose:
        edges, faces = {int(e) for e in gmsh.model.getAdjacencies(2, tag)[1]}, [tag]
        for shell in [shell for shell in grown if shell[0] & edges]:
            grown.remove(shell)
            edges, faces = edges | shell[0], [*shell[1], *faces]
        grown.append((edges, faces))
    return solids, [faces for _, faces in grown]


def leave_out(source: str, names: list[str], exclude: Sequence[str], known: list[str]) -> list[int]:
    """Indices of the solids that stay.

    Parameters
    ----------
    names : of the solids; known : all that ``exclude`` may name

    Raises
    ------
    InputError : patterns that match nothing, or all solids
    """
    problems = Problems()
    for pattern in exclude:
        if not matching(pattern, known):
            problems.add(("mesh", "exclude"), f"no solid is called {pattern!r}", "names of solids, shell wildcards allowed",
                         suggestion(pattern, known, "solid"))
    left = {name for pattern in exclude for name in matching(pattern, known)}
    kept = [i for i, name in enumerate(names) if name not in left]
    if not kept:
        problems.add(("mesh", "exclude"), f"{source}: no solid is left", "at least one solid", "leave fewer out")
    problems.raise_if_any()
    return kept


def check_h(solids: list[tuple[int, int]], h: float) -> None:
    """Refuses an h that no mesher could follow: larger than the model, or far too small for memory."""
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    extent = float(np.ptp(box, axis=0).max())
    if h > extent:
        raise InputError(Problem(("mesh", "h"), f"h = {h:g}, where the model measures {extent:.3g}",
                                 "elements smaller than the model", f"take h: {extent / 10:.2g} or less; "
                                 "h is in the model's own units, before scale"))
    inside = DENSITY * sum(gmsh.model.occ.getMass(*solid) for solid in solids) / h**3
    # A plane of equilateral triangles has 1.15 nodes per h².
    faces = gmsh.model.getBoundary(solids, combined=False, oriented=False)
    on_faces = 1.15 * sum(gmsh.model.occ.getMass(*face) for face in set(faces)) / h**2
    check_size(max(inside, on_faces), ("mesh", "h"), f"h = {h:g}", coarser(h))


def product(dimension: int, tag: int) -> str:
    """The last part of a label such as ``Shapes/assembly/NUT::1/nut & & 256``; none where a program has only named itself.

    Such are "Open CASCADE STEP translator 7.1 1:37" and "=>[0:1:1:2]": they tell nothing and change with every export.
    """
    label = gmsh.model.getEntityName(dimension, tag).split("/")[-1].split(" & ")[0].strip()
    return "" if NOISE.search(label) else label


def _join(solids: list[tuple[int, int]]) -> dict[int, int]:
    """Makes touching solids share faces; the tag of each piece → the solid it comes from."""
    if len(solids) == 1:
        return {solids[0][1]: 0}
    _, children = gmsh.model.occ.fragment(solids, [])
    gmsh.model.occ.synchronize()
    owner: dict[int, int] = {}
    for i, pieces in enumerate(children):
        for dimension, tag in pieces:
            if dimension == 3:
                # Where solids overlap, the piece goes to the first.
                owner.setdefault(tag, i)
    return owner


def _arrays(source: str, names: list[str], owner: dict[int, int]) -> Mesh:
    """The mesh that gmsh holds; parameters as ``_import`` returns them."""
    pieces = [tag for _, tag in gmsh.model.getEntities(3)]
    cells, piece = elements(TET, pieces)
    used, inverse = np.unique(cells, return_inverse=True)
    surfaces: dict[str, np.ndarray] = {}
    counts = dict.fromkeys(names, 0)
    for _, tag in gmsh.model.getEntities(2):
        beside = gmsh.model.getAdjacencies(2, tag)[0]
        if len(beside) != 1:
            continue
        name = names[owner[int(beside[0])]]
        counts[name] += 1
        surfaces[f"{name}:{counts[name]}"] = np.searchsorted(used, elements(TRIANGLE, [tag])[0])
    kept, volume_index = np.unique(np.array([owner[tag] for tag in pieces])[piece], return_inverse=True)
    return Mesh(points(used), inverse.reshape(-1, 4), volume_index,
                [names[i] for i in kept], surfaces, source, smooth=list(surfaces))
