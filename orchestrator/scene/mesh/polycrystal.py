"""A box of grains: Voronoi cells, tidied, meshed so that neighbours share their interfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import QhullError

from orchestrator.errors import wrong
from orchestrator.scene.mesh.grains import Grains, tidied
from orchestrator.scene.mesh.polyhedra import SIDES, area_vector, scattered
from orchestrator.scene.mesh.geometry import area_vectors, dihedral_angles, dihedral_range, roundness
from orchestrator.scene.mesh.gmsh_session import HXT, TET, TRIANGLE, elements, gmsh, last_complaint, points, session
from orchestrator.scene.mesh.mending import mend
from orchestrator.scene.mesh.checks import DENSITY, check_size, coarser
from orchestrator.scene.mesh.mesh import Mesh

PATH = ("mesh", "polycrystal")
# How many seeds are tried, one after another.
TRIES = 10
# The worst tet accepted: its roundness (1 for the regular one), its dihedral angles in degrees.
ROUND, ANGLE = 0.05, 4.0
# Bad tets are mended one by one while they are few, a few per grain; when this share of all is bad, h suits no grain.
FEW = 0.02
# Faces whose corners leave their plane by more than this share of the box's longest side are cut into triangles.
FLAT = 1e-7


def polycrystal(mesh: Any) -> Mesh:
    """Grains from ``mesh.polycrystal`` with ``grains`` (count), ``size`` (a length or three), ``h``, ``seed``, ``lloyd``.

    Volumes are named grain_1, grain_2, …, the sides of the box xmin, xmax, ymin, …. Where tets are bad, they are
    mended; when the grains of a seed cannot be meshed at all, the next seed is taken; ``remarks`` tell of both.
    The same entry always gives the same mesh; size and h times ten give that mesh times ten.

    Raises InputError: h too coarse or too fine, or no seed gives a good mesh
    """
    entry = mesh.polycrystal
    count, h, seed = int(entry.grains), float(entry.h), int(entry.seed)
    size = np.broadcast_to(np.asarray(entry.size, dtype=float), (3,))
    _check_size(count, size, h)
    # gmsh's tolerances are absolute: what it sees is at most 1 long, and the same in every unit.
    unit = size.max()
    relative, fine = np.round(size / unit, 12), round(h / unit, 12)
    complaints = []
    for current in range(seed, seed + TRIES):
        made = _attempt(count, relative, fine, current, int(entry.lloyd))
        if isinstance(made, Mesh):
            made.nodes = made.nodes / relative * size
            made.source = f"polycrystal of {count} grains, seed {current}"
            made.remarks = [f"{made.source}: {remark}" for remark in (
                *(f"passed over {complaint}" for complaint in complaints), *made.remarks)]
            return made
        complaints.append(f"seed {current}: {made}")
    raise wrong(PATH, f"no good mesh with seeds {seed} to {current}; {complaints[-1]}",
                f"tets rounder than {ROUND} with dihedral angles above {ANGLE:g} degrees",
                "take a smaller h, lloyd: 10 for rounder grains, or another seed")


def _check_size(count: int, size: np.ndarray, h: float) -> None:
    typical = min(float(np.cbrt(np.prod(size) / count)), float(size.min()))
    if h > typical:
        raise wrong((*PATH, "h"), f"h = {h:g}, where grains measure about {typical:.3g}",
                    "elements smaller than the grains", f"take h: {typical / 3:.2g} or less")
    check_size(DENSITY * np.prod(size / h), (*PATH, "h"), f"h = {h:g}", coarser(h))


def _attempt(count: int, size: np.ndarray, h: float, seed: int, lloyd: int) -> Mesh | str:
    """The mesh of one seed, mended if need be, or what is wrong with it."""
    try:
        grains = tidied(scattered(count, size, seed, lloyd), h)
    except QhullError:
        return "no Voronoi cells"
    if not grains.sound:
        return "grains are folded"
    with session():
        try:
            made = _meshed(grains, count, h)
        except Exception as error:
            return f"gmsh: {last_complaint(error)}"
    bad = np.mean(_fitness(made.nodes, made.cells) < 1)
    if 0 < bad < FEW:
        made, done = mend(made, _fitness)
        made.remarks.append(f"mended where tets were bad: {done.told(h)}")
        bad = np.mean(_fitness(made.nodes, made.cells) < 1)
    if bad == 0:
        return made
    round_, (sharp, blunt) = roundness(made.nodes, made.cells).min(), dihedral_range(made.nodes, made.cells)
    return f"a tet of roundness {round_:.2g}, dihedral angles {sharp:.2g} to {blunt:.4g} degrees"


def _fitness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) how good tets are, below 1 where they are not accepted; -1 without volume."""
    sharp, blunt = dihedral_angles(nodes, cells)
    found = np.minimum(roundness(nodes, cells) / ROUND, np.minimum(sharp, 180 - blunt) / ANGLE)
    return np.where(np.isfinite(found), found, -1.0)


def _meshed(grains: Grains, count: int, h: float) -> Mesh:
    """Hands the grains to gmsh's own kernel, where points, lines and surfaces are shared, and meshes them."""
    geo = gmsh.model.geo
    kept = sorted({vertex for loop in grains.loops.values() for vertex in loop})
    point = {vertex: geo.addPoint(*grains.points[vertex], h) for vertex in kept}
    lines: dict[tuple[int, int], int] = {}

    def line(a: int, b: int) -> int:
        if (a, b) in lines or (b, a) in lines:
            return lines.get((a, b)) or -lines[b, a]
        lines[a, b] = geo.addLine(point[a], point[b])
        return lines[a, b]

    bounds: list[list[int]] = [[] for _ in range(count)]
    sides: list[list[int]] = [[] for _ in SIDES]
    for face in sorted(grains.loops):
        loop, (one, other) = grains.loops[face], grains.cells[face]
        for part in [loop] if _flat(grains.points[loop]) else grains.triangles[face]:
            wire = geo.addCurveLoop([line(a, part[k - len(part) + 1]) for k, a in enumerate(part)])
            tag = geo.addPlaneSurface([wire])
            bounds[one].append(tag)
            (bounds if other >= 0 else sides)[other if other >= 0 else -1 - other].append(tag)
    volumes = [geo.addVolume([geo.addSurfaceLoop(tags)]) for tags in bounds]
    geo.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    # Inside, h counts alone: following the sizes on the faces, which short edges refine, makes 12 % more nodes.
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.Algorithm3D", HXT)
    gmsh.model.mesh.generate(3)
    tets, volume = elements(TET, volumes)
    if len(np.unique(volume)) < count:
        raise RuntimeError("a grain without tetrahedra")
    used, cells = np.unique(tets, return_inverse=True)
    nodes = points(used)
    surfaces = {}
    for index, (name, tags) in enumerate(zip(SIDES, sides)):
        triangles = np.searchsorted(used, elements(TRIANGLE, tags)[0])
        outward = area_vectors(nodes, triangles)[:, index // 2] * (1 if index % 2 else -1) > 0
        surfaces[name] = np.where(outward[:, None], triangles, triangles[:, ::-1])
    return Mesh(nodes, cells.reshape(-1, 4), volume, [f"grain_{i + 1}" for i in range(count)], surfaces)


def _flat(corners: np.ndarray) -> bool:
    normal = area_vector(corners)
    return bool(np.ptp(corners @ normal) <= FLAT * np.linalg.norm(normal))
