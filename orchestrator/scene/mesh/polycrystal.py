"""A box of grains: Voronoi cells, tidied, each meshed by one of the ranks so that neighbours share their interfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import QhullError

from orchestrator.errors import wrong
from orchestrator.optional import check_there
from orchestrator.parallel.placement import owners
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.mesh.checks import DENSITY, check_size, coarser
from orchestrator.scene.mesh.geometry import dihedral_angles, dihedral_range, roundness
from orchestrator.scene.mesh.grain_meshes import Failed, GrainMesh, GrainMesher, mended
from orchestrator.scene.mesh.grains import tidied
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.polyhedra import Tessellation, scattered
from orchestrator.scene.mesh.skeleton import EACH, Skeleton
from orchestrator.timing import predicted_cost

PATH = ("mesh", "polycrystal")
# How many seeds are tried, one after another.
TRIES = 10
# The worst tet accepted: its roundness (1 for the regular one), its dihedral angles in degrees.
ROUND, ANGLE = 0.05, 4.0
# Bad tets are mended one by one while they are few, a few per grain; when this share of all is bad, h suits no grain.
FEW = 0.02

def polycrystal(mesh: Any) -> Mesh:
    """Grains from ``mesh.polycrystal`` with ``grains`` (count), ``size`` (a length or three), ``h``, ``seed``, ``lloyd``.

    Volumes are named grain_1, grain_2, …, the sides of the box xmin, xmax, ymin, …. Where tets are bad, they are
    mended; when the grains of a seed cannot be meshed at all, the next seed is taken; ``remarks`` tell of both.
    The same entry always gives the same mesh, on any number of ranks; size and h times ten give that mesh times ten.

    Raises InputError: h too coarse or too fine, or no seed gives a good mesh
    """
    check(mesh)
    return share(mesh, ALONE)[0]


def check(mesh: Any, ranks: int = 1) -> None:
    """Raises InputError: h is too coarse or, for what one of some ranks can hold, too fine; gmsh is missing."""
    entry = mesh.polycrystal
    count, h, size = int(entry.grains), float(entry.h), np.broadcast_to(np.asarray(entry.size, dtype=float), (3,))
    typical = min(float(np.cbrt(np.prod(size) / count)), float(size.min()))
    if h > typical:
        raise wrong((*PATH, "h"), f"h = {h:g}, where grains measure about {typical:.3g}",
                    "elements smaller than the grains", f"take h: {typical / 3:.2g} or less")
    check_size(DENSITY * np.prod(size / h) / ranks, (*PATH, "h"), f"h = {h:g}", coarser(h))
    check_there("gmsh")


def share(mesh: Any, team: Team) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """A rank's grains of the mesh, and tags of its nodes (n,) and tets (m,): ascending as in the whole mesh, whose names it has. All ranks
    ask together, once each has checked the entry; grains are as many at least.

    Raises InputError: on all of them, where no seed gives a good mesh
    """
    entry = mesh.polycrystal
    count, h, seed = int(entry.grains), float(entry.h), int(entry.seed)
    size = np.broadcast_to(np.asarray(entry.size, dtype=float), (3,))
    # gmsh's tolerances are absolute: what it sees is at most 1 long, and the same in every unit.
    unit = size.max()
    relative, fine, complaints = np.round(size / unit, 12), round(h / unit, 12), []
    for current in range(seed, seed + TRIES):
        # One makes the cells for all: rounding may differ from machine to machine.
        cells = team.share(None if team.rank else _cells(count, relative, fine, current, int(entry.lloyd)))
        made = cells if isinstance(cells, str) else _meshed(Skeleton(cells, fine), team)
        if not isinstance(made, str):
            whole, remarks = made
            source = f"polycrystal of {count} grains, seed {current}"
            remarks = [f"{source}: {remark}" for remark in (*(f"passed over {complaint}" for complaint in complaints), *remarks)]
            return _as_mesh(whole, count, relative, size, source, remarks)
        complaints.append(f"seed {current}: {made}")
    raise wrong(PATH, f"no good mesh with seeds {seed} to {current}; {complaints[-1]}",
                f"tets rounder than {ROUND} with dihedral angles above {ANGLE:g} degrees",
                "take a smaller h, lloyd: 10 for rounder grains, or another seed")


def _cells(count: int, size: np.ndarray, h: float, seed: int, lloyd: int) -> Tessellation | str:
    """The grains of one seed before they are meshed, or what is wrong with it."""
    try:
        grains = tidied(scattered(count, size, seed, lloyd), h)
    except QhullError:
        return "no Voronoi cells"
    return grains.plane() if grains.sound else "grains are folded"


def _meshed(skeleton: Skeleton, team: Team) -> tuple[GrainMesh, list[str]] | str:
    """This rank's grains, mended if need be, with remarks; or what is wrong with any rank's."""
    nodes, pairs, common = skeleton.sizes()
    rank_of = team.share(None if team.rank else owners(predicted_cost(3 * nodes), pairs, common, team.size))
    mine, mesher, failed = np.flatnonzero(rank_of == team.rank).tolist(), GrainMesher(skeleton), None
    try:
        grains = mesher.of(mine)
    except Failed as error:
        failed = error.args
    if told := [first for first in team.all_gather(failed) if first]:
        return min(told)[1]
    _check_same(mesher, team)
    whole, done = GrainMesh.joined(grains), []
    fit = _fitness(whole.points, whole.cells)
    tets, bad = team.sum(len(fit), np.sum(fit < 1))
    if 0 < bad < FEW * tets:
        whole, change = mended(mesher, whole, fit < 1, _fitness, team)
        fit, done = _fitness(whole.points, whole.cells), [f"mended where tets were bad: {change.told(skeleton.h)}"]
    if team.max(-fit.min())[0] <= -1:
        return whole, done
    sharp, blunt = dihedral_range(whole.points, whole.cells)
    round_, sharp, blunt = team.max(-roundness(whole.points, whole.cells).min(), -sharp, blunt)
    return f"a tet of roundness {-round_:.2g}, dihedral angles {-sharp:.2g} to {blunt:.4g} degrees"


def _check_same(mesher: GrainMesher, team: Team) -> None:
    """Raises InputError, on all ranks: two of them have not made the same of a face."""
    own = mesher.prints
    most = np.array(team.max(*np.where(np.isnan(own), -np.inf, own), *np.where(np.isnan(own), -np.inf, -own))).reshape(2, -1)
    if not np.array_equal(most[0], -most[1]):
        raise wrong(PATH, "ranks that have meshed a face differently", "machines that round alike")


def _fitness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) how good tets are, below 1 where they are not accepted; -1 without volume."""
    sharp, blunt = dihedral_angles(nodes, cells)
    with np.errstate(invalid="ignore"):
        found = np.minimum(roundness(nodes, cells) / ROUND, np.minimum(sharp, 180 - blunt) / ANGLE)
    return np.where(np.isfinite(found), found, -1.0)


def _as_mesh(whole: GrainMesh, count: int, relative: np.ndarray, size: np.ndarray, source: str,
             remarks: list[str]) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """See ``share``; the grains are in a box of lengths ``relative`` (3,) that becomes one of lengths ``size``."""
    mesh = Mesh(whole.points / relative * size, whole.cells, whole.grain, [f"grain_{i + 1}" for i in range(count)],
                whole.sides(relative), source, remarks)
    return mesh, whole.tags, whole.grain * EACH + np.arange(len(whole.grain)) - np.searchsorted(whole.grain, whole.grain)
