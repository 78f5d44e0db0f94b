"""STEP and BREP assemblies meshed solid by solid: each at its own element size, sharing nothing with those it touches.

Solids are independent of each other, so that several processes mesh them where that is worth starting any (gmsh has one
model per process). What a solid becomes depends neither on the others nor on who meshes it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from orchestrator.errors import InputError, Problem, Problems
from orchestrator.scene.mesh.cad import ATTEMPTS, check_h, leave_out, load, locate, product, read_model
from orchestrator.scene.mesh.gmsh_session import TET, TRIANGLE, elements, last_complaint, points, session
from orchestrator.scene.mesh.size import DENSITY
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion, unique_names
from orchestrator.wording import some

# Edges and faces shorter than this share of the whole model are told: elements there are as small.
SMALL = 1e-3
# Nodes from which on several processes mesh faster than one: gmsh makes about 20,000 a second, and a process takes half a
# second to start.
WORTH = 20_000
PROCESS = f"from {__name__} import main; main()"
SHOWN = 5  # faces that one sentence names


@dataclass
class Solid:
    """One solid of a model.

    Parameters
    ----------
    tag : gmsh's; name : unique; faces : tags of its faces, ascending, named ``name:1`` and on
    h : element size, none: gmsh's own choice
    nodes : estimated number of nodes, 0 where h is none
    """

    tag: int
    name: str
    faces: list[int]
    h: float | None
    nodes: float

    def face(self, tag: int) -> str:
        """Name of a face."""
        return f"{self.name}:{self.faces.index(tag) + 1}"


@dataclass
class Meshed:
    """What gmsh has made of a solid: points (n, 3), cells (m, 4), triangles per face; or why nothing."""

    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    cells: np.ndarray = field(default_factory=lambda: np.empty((0, 4), dtype=int))
    surfaces: list[np.ndarray] = field(default_factory=list)
    complaint: str = ""


def step(mesh: Any) -> Mesh:
    """The CAD model named by ``mesh.step``, meshed with elements of size ``mesh.h`` (in the model's units).

    Without h, gmsh takes a tenth of the model's size, less where the shape asks for it.
    """
    if getattr(mesh, "conforming", None) is False:
        return step_apart(mesh)
    return load(locate(str(mesh.step)), None if mesh.h is None else float(mesh.h), str(mesh.step),
                getattr(mesh, "exclude", None) or [])


def step_apart(mesh: Any) -> Mesh:
    """The CAD model named by ``mesh.step``, each solid meshed by itself with elements of its own size ``mesh.h``.

    Names are those of ``cad.load``; all faces of a solid are outer ones.

    Raises
    ------
    InputError : unreadable, no solids, faces that close no solid, names that match none, solids that gmsh cannot mesh
    """
    path, source = locate(str(mesh.step)), str(mesh.step)
    with session():
        solids, remarks = _survey(path, source, mesh.h, mesh.exclude or [])
    made = _all(path, solids)
    failed = [Problem(("mesh", "step"), f"{source}: {solid.name} cannot be meshed: {one.complaint}",
                      "solids whose faces close and can be meshed", f"repair the solid, try a smaller h, or leave it out: "
                      f"exclude: [{solid.name}]") for solid, one in zip(solids, made) if one.complaint]
    if failed:
        raise InputError(failed)
    starts = np.cumsum([0, *(len(one.points) for one in made)])
    surfaces = {f"{solid.name}:{k}": triangles + start for solid, one, start in zip(solids, made, starts)
                for k, triangles in enumerate(one.surfaces, start=1)}
    return Mesh(np.concatenate([one.points for one in made]),
                np.concatenate([one.cells + start for one, start in zip(made, starts)]),
                np.repeat(np.arange(len(made)), [len(one.cells) for one in made]), [solid.name for solid in solids],
                surfaces, source, remarks, list(surfaces))


def _survey(path: Path, source: str, h: Any, exclude: list[str]) -> tuple[list[Solid], list[str]]:
    """The solids that are to be meshed, and remarks on what is small in them; gmsh must be switched on."""
    found, loose = read_model(path, source)
    names = unique_names([product(*s) or "solid" for s in found])
    shells = [f"shell_{i}" for i in range(1, len(loose) + 1)]
    kept = leave_out(source, names, exclude, [*names, *shells])
    left = {name for pattern in exclude for name in matching(pattern, [*names, *shells])}
    open_ = [(name, faces) for name, faces in zip(shells, loose) if name not in left]
    if open_:
        raise InputError([Problem(
            ("mesh", "step"), f"{source}: {name}, {len(faces)} faces, the first at "
            f"({', '.join(f'{x:.4g}' for x in gmsh.model.occ.getCenterOfMass(2, faces[0]))}), close no solid",
            "closed solids", f"repair the body in CAD and export it again, or leave it out: exclude: [{name}]")
            for name, faces in open_])
    sizes = _sizes([names[i] for i in kept], h)
    if sizes:
        check_h([found[i] for i in kept], max(sizes.values()))
    solids = []
    for i in kept:
        size = sizes.get(names[i])
        faces = sorted({tag for _, tag in gmsh.model.getBoundary([found[i]], combined=False, oriented=False)})
        count = 0.0 if size is None else DENSITY * gmsh.model.occ.getMass(*found[i]) / size**3
        solids.append(Solid(found[i][1], names[i], faces, size, count))
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


def _all(path: Path, solids: list[Solid]) -> list[Meshed]:
    """Meshes of the solids, by several processes where that is worth it."""
    workers = min(len(os.sched_getaffinity(0)), len(solids))
    if workers < 2 or sum(solid.nodes for solid in solids) < WORTH:
        return mesh_solids(path, solids)
    shares = _shares(solids, workers)
    folder = str(Path(__file__).parents[3])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [folder, os.environ.get("PYTHONPATH")]))}
    result: list[Meshed] = [Meshed()] * len(solids)
    with tempfile.TemporaryDirectory(prefix="orchestrator-solids-") as temporary:
        started = []
        try:
            for number, share in enumerate(shares):
                answer = Path(temporary) / str(number)
                process = subprocess.Popen([sys.executable, "-P", "-c", PROCESS, str(answer)], stdin=subprocess.PIPE,
                                           stdout=subprocess.DEVNULL, env=environment)
                started.append((process, share, answer))
                with suppress(BrokenPipeError), process.stdin as requests:  # who is gone is noticed below
                    requests.write(pickle.dumps((path, [solids[i] for i in share])))
            for process, share, answer in started:
                if process.wait() or not answer.is_file():
                    # a crash of the mesher's takes one process with it: which solid it was, the same work tells again
                    raise InputError(Problem(("mesh", "step"), f"{path}: gmsh has crashed on one of "
                                             f"{some([solids[i].name for i in share], 8)} (exit code {process.returncode})",
                                             "solids that can be meshed", "repair the model, or leave the solid out: exclude"))
                for i, one in zip(share, pickle.loads(answer.read_bytes())):
                    result[i] = one
        finally:
            for process, _, _ in started:
                if process.poll() is None:
                    process.kill()
                    process.wait()
    return result


def _shares(solids: list[Solid], workers: int) -> list[list[int]]:
    """Indices of solids for each process: the largest first, each to the one that has least to do."""
    shares, load = [[] for _ in range(workers)], np.zeros(workers)
    for i in sorted(range(len(solids)), key=lambda i: -solids[i].nodes):
        least = int(load.argmin())
        shares[least].append(i)
        load[least] += solids[i].nodes
    return [share for share in shares if share]


def mesh_solids(path: Path, solids: list[Solid]) -> list[Meshed]:
    """Meshes of some solids of a model, one after another."""
    result = [Meshed(complaint="not tried") for _ in solids]
    for algorithm, per_circle in ATTEMPTS:
        left = [i for i, one in enumerate(result) if one.complaint]
        if not left:
            break
        with session():
            read_model(path, str(path))
            everything = gmsh.model.getEntities()
            gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_circle)
            gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
            for i in left:
                gmsh.model.setVisibility(everything, 0)
                gmsh.model.setVisibility([(3, solids[i].tag)], 1, recursive=True)
                result[i] = _one(solids[i])
                gmsh.model.mesh.clear()
    return result


def _one(solid: Solid) -> Meshed:
    """The mesh of the one solid that is visible."""
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22 if solid.h is None else solid.h)
    try:
        gmsh.model.mesh.generate(2)
        if complaint := _open(solid):
            return Meshed(complaint=complaint)
        gmsh.model.mesh.generate(3)
    except Exception as error:
        return Meshed(complaint=last_complaint(error))
    cells, _ = elements(TET, [solid.tag])
    if not len(cells):  # gmsh passes over what it cannot fill
        return Meshed(complaint=f"no tetrahedra with h = {'auto' if solid.h is None else f'{solid.h:g}'}")
    used, inverse = np.unique(cells, return_inverse=True)
    return Meshed(points(used), inverse.reshape(-1, 4),
                  [np.searchsorted(used, elements(TRIANGLE, [tag])[0]) for tag in solid.faces])


def _open(solid: Solid) -> str:
    """Says which faces of a solid do not close; empty where they do."""
    triangles, face = elements(TRIANGLE, solid.faces)
    bare = [solid.face(tag) for k, tag in enumerate(solid.faces) if not (face == k).any()]
    if bare:
        return f"no triangles on its faces {some(bare, SHOWN)}"
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, first, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
    alone = count % 2 == 1
    if not alone.any():
        return ""
    tags, lengths = np.unique(np.tile(face, 3)[first[alone]], return_counts=True)
    where = points(np.unique(edges[first[alone]])).mean(axis=0)
    names = [solid.face(solid.faces[k]) for k in tags[np.argsort(-lengths, kind="stable")]]
    return (f"its faces do not close: {alone.sum()} edges of {some(names, SHOWN)} have one triangle beside them, "
            f"about ({', '.join(f'{x:.4g}' for x in where)})")


def main() -> None:
    """A process that meshes some solids: what to do on standard input, what came of it in a file."""
    path, solids = pickle.load(sys.stdin.buffer)
    answer = Path(sys.argv[1])
    made = mesh_solids(path, solids)
    answer.with_suffix(".part").write_bytes(pickle.dumps(made))
    answer.with_suffix(".part").rename(answer)

