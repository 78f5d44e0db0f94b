"""A box of grains: Voronoi cells, tidied, each meshed so that neighbours share their interfaces."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import QhullError

from orchestrator.errors import wrong
from orchestrator.optional import check_there
from orchestrator.scene.mesh.checks import DENSITY, check_size, coarser
from orchestrator.scene.mesh.geometry import dihedral_angles, dihedral_range, roundness
from orchestrator.scene.mesh.grains.grain_meshes import Failed, grain_mesh, GrainMesh
from orchestrator.scene.mesh.grains.mending import Mending
from orchestrator.scene.mesh.grains.tidied import tidied
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.grains.polyhedra import scattered, Tessellation

PATH = ("mesh", "polycrystal")
# How many seeds are tried, one after another.
TRIES = 10
# The worst tet accepted: its roundness (1 for the regular one), its dihedral angles in degrees.
ROUND, ANGLE = 0.05, 4.0
# Bad tets are mended one by one while they are few, a few per grain; when this share of all is bad,
# h suits no grain.
FEW = 0.02

def polycrystal(mesh: Any) -> Mesh:
    """Grains from ``mesh.polycrystal`` with ``grains`` (count), ``size`` (a length or three),
    ``h``, ``seed``, ``lloyd``.

    Volumes are named grain_1, grain_2, …, the sides of the box xmin, xmax, ymin, …. Where tets are
    bad, they are mended; when the grains of a seed cannot be meshed at all, the next seed is taken;
    ``remarks`` tell of both. The same entry always gives the same mesh; size and h times ten give
    that mesh times ten.

    Raises InputError: h too coarse or too fine, or no seed gives a good mesh
    """
    entry = mesh.polycrystal
    _check(entry)
    count, h, seed = int(entry.grains), float(entry.h), int(entry.seed)
    size = np.broadcast_to(np.asarray(entry.size, dtype=float), (3,))
    # gmsh's tolerances are absolute: what it sees is at most 1 long, and the same in every unit.
    unit = size.max()
    relative, fine, complaints = np.round(size / unit, 12), round(h / unit, 12), []
    for current in range(seed, seed + TRIES):
        cells = _cells(count, relative, fine, current, int(entry.lloyd))
        made = cells if isinstance(cells, str) else _meshed(cells, fine)
        if not isinstance(made, str):
            whole, remarks = made
            source = f"polycrystal of {count} grains, seed {current}"
            remarks = [f"{source}: {remark}"
                       for remark in (*(f"passed over {complaint}" for complaint in complaints),
                                      *remarks)]
            return Mesh(whole.points / relative * size, whole.cells, whole.grain,
                        [f"grain_{i + 1}" for i in range(count)],
                        whole.sides(relative), source, remarks)
        complaints.append(f"seed {current}: {made}")
    raise wrong(PATH, f"no good mesh with seeds {seed} to {current}; {complaints[-1]}",
                f"tets rounder than {ROUND} with dihedral angles above {ANGLE:g} degrees",
                "take a smaller h, lloyd: 10 for rounder grains, or another seed")


def _check(entry: Any) -> None:
    """Raise InputError where h is too coarse or too fine, or gmsh is missing."""
    count, h, size = int(entry.grains), float(entry.h), np.broadcast_to(
        np.asarray(entry.size, dtype=float), (3,))
    typical = min(float(np.cbrt(np.prod(size) / count)), float(size.min()))
    if h > typical:
        raise wrong((*PATH, "h"), f"h = {h:g}, where grains measure about {typical:.3g}",
                    "elements smaller than the grains", f"take h: {typical / 3:.2g} or less")
    check_size(DENSITY * np.prod(size / h), (*PATH, "h"), f"h = {h:g}", coarser(h))
    check_there("gmsh")


def _cells(count: int, size: np.ndarray, h: float, seed: int, lloyd: int) -> Tessellation | str:
    """The grains of one seed before they are meshed, or what is wrong with it."""
    try:
        grains = tidied(scattered(count, size, seed, lloyd), h)
    except QhullError:
        return "no Voronoi cells"
    return grains.plane() if grains.sound else "grains are folded"


def _meshed(cells: Tessellation, h: float) -> tuple[GrainMesh, list[str]] | str:
    """Return the grains, mended if need be, with remarks; or what is wrong with one."""
    try:
        whole, done = grain_mesh(cells, h), []
    except Failed as error:
        return str(error)
    fit = _fitness(whole.points, whole.cells)
    if 0 < np.sum(fit < 1) < FEW * len(fit):
        mending = Mending(whole, _fitness)
        whole = replace(whole, points=mending.points)
        fit = _fitness(whole.points, whole.cells)
        done = [f"mended where tets were bad: {mending.told(h)}"]
    if fit.min() >= 1:
        return whole, done
    sharp, blunt = dihedral_range(whole.points, whole.cells)
    round_ = roundness(whole.points, whole.cells).min()
    return f"a tet of roundness {round_:.2g}, dihedral angles {sharp:.2g} to {blunt:.4g} degrees"


def _fitness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) how good tets are, below 1 where they are not accepted; -1 without volume."""
    sharp, blunt = dihedral_angles(nodes, cells)
    with np.errstate(invalid="ignore"):
        found = np.minimum(roundness(nodes, cells) / ROUND, np.minimum(sharp, 180 - blunt) / ANGLE)
    return np.where(np.isfinite(found), found, -1.0)
