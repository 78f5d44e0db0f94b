"""gmsh switched on for one model, and its answers as arrays; STEP and BREP models as it reads them,
and what no mesher could follow.
"""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import numpy as np

from orchestrator.errors import Problems, wrong
from orchestrator.optional import Late, check_there
from orchestrator.scene.mesh.checks import (
    DENSITY, check_complete, check_content, check_size, coarser)
from orchestrator.scene.names import matching, suggestion, unique_names

gmsh = Late("gmsh")
# gmsh's numbers of algorithms and of elements
HXT, DELAUNAY = 10, 1
TRIANGLE, TET = 2, 4  # the latter
# 3D algorithm, elements per full circle. HXT is three times faster and leaves far fewer slivers,
# but gives up
# on coarse curved surfaces; there finer circles help, where Delaunay does not.
ATTEMPTS = ((HXT, 0), (DELAUNAY, 0), (HXT, 6))


@contextmanager
def session() -> Iterator[None]:
    """gmsh switched on, quiet, with a model of its own; always switched off again."""
    # gmsh gives these back to the system: a broken pipe would kill the program without a word, a
    # hangup despite nohup
    handlers = {number: signal.getsignal(number)
                for number in (signal.SIGHUP, signal.SIGPIPE, signal.SIGTERM, signal.SIGINT)}
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():
            signal.signal(number, handler)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        # With several threads gmsh gives another mesh at every call; alone it is hardly slower.
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def elements(kind: int, tags: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Node tags (k, 3 or 4) of the triangles or tets of some entities, and the entity (k,) as index
    into tags.
    """
    width = 4 if kind == TET else 3
    blocks = [gmsh.model.mesh.getElementsByType(kind, tag)[1].reshape(-1, width).astype(np.int64)
              for tag in tags]
    return np.concatenate(blocks), np.repeat(np.arange(len(tags)), [len(block) for block in blocks])


def points(tags: np.ndarray) -> np.ndarray:
    """(n, 3) coordinates of nodes, given by their tags."""
    known, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(known)
    return coordinates.reshape(-1, 3)[order[np.searchsorted(known[order], tags)]]


def last_complaint(error: Exception) -> str:
    """The last line of gmsh's error message."""
    lines = str(error).strip().splitlines() or gmsh.logger.getLastError().strip().splitlines()
    return lines[-1] if lines else type(error).__name__


# Labels that programs write where nobody has named a solid.
NOISE = re.compile(r"STEP translator|^=>\[[\d:]+\]$")


def locate(name: str) -> Path:
    """The file of a name; ``gmsh:part.stp`` is one of the examples that come with gmsh. Raises
    InputError where there is none.
    """
    if name.startswith("gmsh:"):
        check_there("gmsh")
        examples = [f for f in metadata.files("gmsh") or [] if "examples" in f.parts
                    and f.suffix in (".stp", ".step")]
        for found in examples:
            if found.name == name.removeprefix("gmsh:") and (
                path := Path(found.locate())).is_file():
                return path.resolve()
        raise wrong(("mesh", "step"), f"{name}: no such example of gmsh",
                    "one of " + ", ".join(sorted({f"gmsh:{f.name}" for f in examples})))
    if not Path(name).is_file():
        raise wrong(("mesh", "step"), f"{name}: no such file", "an existing STEP or BREP file",
                    "check the path")
    return Path(name)


def read_unit(path: Path) -> list[str]:
    """Return a sentence on a STEP file whose lengths are not in mm, into which all are converted;
    none of one in mm, and of a BREP file."""
    data = path.read_bytes() if path.suffix.lower() != ".brep" else b""
    listed = b" ".join(re.findall(rb"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", data))
    tags, names = set(re.findall(rb"#\d+", listed)), set()
    for tag, text in re.findall(rb"(#\d+)\s*=([^;]*LENGTH_UNIT[^;]*);", data):
        unit = re.sub(rb"\s", b"", text).decode(errors="replace") if tag in tags else ""
        if own := re.search(r"CONVERSION_BASED_UNIT\('([^']*)'", unit):
            names.add(own[1].lower())
        elif own := re.search(r"SI_UNIT\((?:\.(\w+)\.|\$),\.METRE\.", unit):
            names.add(f"{(own[1] or '').lower()} metre".strip())
    return [] if names <= {"milli metre", "millimetre"} else [
        f"the file's unit of length is the {' and the '.join(sorted(names))}: its lengths are read "
        "in mm, and so are h and all other lengths; scale: 0.001 gives metres"]


def read_model(path: Path, source: str,
               shells: bool = True) -> tuple[list[tuple[int, int]], list[str], list[list[int]]]:
    """Solids of a model, by dimension and tag, with their names, and shells of faces that close
    none, each the tags of its faces.

    gmsh must be switched on, and holds the model afterwards, its loose faces where ``shells`` are
    asked for. Solids are called as the model's products, bolt_1, bolt_2, … where a name recurs.
    Raises InputError: unreadable, no solids
    """
    check_content(path, ("mesh", "step"), source)
    check_complete(path, ("mesh", "step"), source)
    try:
        found = gmsh.model.occ.importShapes(str(path), highestDimOnly=not shells)
    except Exception as error:
        raise wrong(("mesh", "step"), f"{source}: cannot be read: {last_complaint(error)}",
                    "a STEP or BREP file", "export the model again") from None
    gmsh.model.occ.synchronize()
    solids = [s for s in found if s[0] == 3]
    if not solids:
        raise wrong(("mesh", "step"), f"{source}: no solids", "a model with at least one solid",
                    "export closed solids, not surfaces")
    loose = [tag for _, tag in gmsh.model.getEntities(2)
             if not len(gmsh.model.getAdjacencies(2, tag)[0])]
    grown: list[tuple[set[int], list[int]]] = []
    for tag in loose:
        edges, faces = {int(e) for e in gmsh.model.getAdjacencies(2, tag)[1]}, [tag]
        for shell in [shell for shell in grown if shell[0] & edges]:
            grown.remove(shell)
            edges, faces = edges | shell[0], [*shell[1], *faces]
        grown.append((edges, faces))
    return solids, unique_names([_product(*s) or "solid" for s in solids]), [
        faces for _, faces in grown]


def _product(dimension: int, tag: int) -> str:
    """The last part of a label such as ``Shapes/assembly/NUT::1/nut & & 256``; none where a program
    has only named itself.

    Such are "Open CASCADE STEP translator 7.1 1:37" and "=>[0:1:1:2]": they tell nothing and change
    with every export.
    """
    label = gmsh.model.getEntityName(dimension, tag).split("/")[-1].split(" & ")[0].strip()
    return "" if NOISE.search(label) else label


def leave_out(source: str, names: list[str], exclude: Sequence[str], known: list[str]) -> list[int]:
    """Indices of the solids ``names`` that stay when patterns among ``known`` names are left out.

    Raises InputError: patterns that match nothing, or all solids
    """
    problems = Problems()
    for pattern in exclude:
        if not matching(pattern, known):
            problems.add(("mesh", "exclude"), f"no solid is called {pattern!r}",
                         "names of solids, shell wildcards allowed",
                         suggestion(pattern, known, "solid"))
    left = {name for pattern in exclude for name in matching(pattern, known)}
    kept = [i for i, name in enumerate(names) if name not in left]
    if not kept:
        problems.add(("mesh", "exclude"), f"{source}: no solid is left", "at least one solid",
                     "leave fewer out")
    problems.raise_if_any()
    return kept


def check_h(solids: list[tuple[int, int]], h: float) -> None:
    """Raises InputError for an h that no mesher could follow: larger than the model, or far too
    small for memory.
    """
    extent = float(np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0).max())
    if h > extent:
        raise wrong(("mesh", "h"), f"h = {h:g}, where the model measures {extent:.3g}",
                    "elements smaller than the model",
                    f"take h: {extent / 10:.2g} or less; h is in mm for STEP, whatever the file's "
                    "unit, before scale")
    inside = DENSITY * sum(gmsh.model.occ.getMass(*solid) for solid in solids) / h**3
    # A plane of equilateral triangles has 1.15 nodes per h².
    faces = gmsh.model.getBoundary(solids, combined=False, oriented=False)
    on_faces = 1.15 * sum(gmsh.model.occ.getMass(*face) for face in set(faces)) / h**2
    check_size(max(inside, on_faces), ("mesh", "h"), f"h = {h:g}", coarser(h))
