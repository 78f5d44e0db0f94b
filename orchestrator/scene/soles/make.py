"""The soles of all interfaces: which kind each gets, and layers of prisms on facets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.kept import kept
from orchestrator.scene.congruence import first_congruent
from orchestrator.scene.mesh.geometry import position_rank, tet_volumes
from orchestrator.scene.mesh.quadratic import lines_of, with_middles
from orchestrator.scene.interface import Difficulty, Interface
from orchestrator.scene.model import Scene
from orchestrator.scene.soles import Sole
from orchestrator.scene.soles.bonded import BondedNodes
from orchestrator.scene.soles.facets import Facets, facets_of
from orchestrator.scene.soles.overlap import difficulty, overlap

# Thickness is halved this often where prisms would invert; facets that stay bad get outer
# nodes of their own, along their own normal, where inversion is impossible.
HALVINGS = 3
# A tet thinner than this fraction of its prism's regular share (area × thickness / 3) is bad.
FLATNESS = 0.1


def make_soles(scene: Scene, settings, wanted: Sequence[bool] | None = None,
               share: bool = True) -> list[tuple[Sole, Sole] | None]:
    """The soles of every interface, first and second side, after ``method.sole`` of the
    configuration.

    wanted : per interface; the others get none
    share : layers on facets that are equal up to a translation are made once
    """
    hard = difficulty(scene) if settings.kind in ("auto", "overlap") else None
    mixed = np.zeros(len(scene.interfaces), bool) if hard is None else hard.mixed_moduli
    soles: list[tuple[Sole, Sole] | None] = [None] * len(scene.interfaces)
    layers: dict[int, tuple[str, list[Facets]]] = {}
    bonded: BondedNodes | None = None
    for index, interface in enumerate(scene.interfaces):
        if wanted is not None and not wanted[index]:
            continue
        kind = settings.contact if not interface.law.perfect else kind_for(
            hard, interface) if settings.kind == "auto" else settings.kind
        # of nodes alone, where there are no facets to put a layer on
        kind = kind if len(interface.triangles) else "overlap"
        paired = interface.paired
        together = paired and np.array_equal(*(scene.side_nodes(interface, side)
                                               for side in (0, 1)))
        if kind == "overlap" and together:
            others = ()
            if mixed[index]:
                bonded = bonded or BondedNodes(scene)
                others = bonded.others(interface)
            soles[index] = overlap(scene, interface, settings.modulus_ratio, others)
            continue
        kind = "symmetric" if kind == "overlap" else kind
        # of one side for both where they lie upon each other
        upon = together or paired and np.array_equal(
            *(scene.side_points(interface, side) for side in (0, 1)))
        layers[index] = kind, [facets_of(scene, interface, settings, kind, side)
                               for side in ((0,) if upon else (0, 1))]
    of = list(layers)
    for index, first in zip(of, _first_alike(list(layers.values())) if share else range(len(of))):
        kind, (one, *two) = layers[index]
        if of[first] == index:
            soles[index] = soles_of(one, kind, *two)
        else:
            soles[index] = _elsewhere(soles[of[first]],
                                      one.points[0] - layers[of[first]][1][0].points[0])
    return soles


def _first_alike(layers: Sequence[tuple[str, list[Facets]]]) -> list[int]:
    """For each layer the first one that it equals but for a translation: itself if there is none
    before.
    """
    def key(kind: str, sides: list[Facets]) -> tuple:
        return kind, *((len(f.points), *(x.tobytes() for x in (f.triangles, f.young, f.poisson)))
                       for f in sides)

    return first_congruent((key(*layer) for layer in layers),
                           [np.concatenate([f.points for f in sides]) for _, sides in layers],
                           lambda i: np.concatenate([f.thickness for f in layers[i][1]])).tolist()


def _elsewhere(pair: tuple[Sole, Sole], shift: np.ndarray) -> tuple[Sole, Sole]:
    """The soles, moved; one and the same object where they are."""
    one, two = pair
    moved = replace(one, points=one.points + shift)
    return moved, moved if two is one else replace(two, points=two.points + shift)


def kind_for(hard: Difficulty, interface: Interface) -> str:
    """The kind that ``auto`` stands for on a perfect interface."""
    soft = hard.incompressible_or_slender[list(interface.subdomains)].any()
    return "overlap" if soft or hard.mixed_moduli[interface.index] else "symmetric"


@kept
def soles_of(facets: Facets, kind: str, second: Facets | None = None) -> tuple[Sole, Sole]:
    """The soles of the first and the second side; one and the same object when ``symmetric``.

    kind : layer, springs or symmetric
    second : the facets where the second side is, if not on the first
    """
    if kind in ("layer", "springs"):
        return prisms(facets, +1), prisms(second or facets, -1)
    both = []
    for f in [facets] if second is None else [facets, second]:
        one, two = (prisms(f, direction) for direction in (+1, -1))
        both.append(merge(replace(one, young=one.young / 2), replace(two, young=two.young / 2),
                          len(f.points)))
    return both[0], both[-1]


def prisms(facets: Facets, direction: int) -> Sole:
    """One layer of prisms, each split in three tets along diagonals fixed by the node order.

    facets : the interface
    direction : +1 outward of the first side, −1 outward of the second

    Neighbouring prisms agree on the diagonal of their common face because both sort its nodes, by
    position rather than by number: renumbering the mesh then changes nothing. Where the thickness
    must shrink, the modulus shrinks with it: E/thickness is what counts.
    """
    n = len(facets.points)
    triangles, odd, order = split(facets.triangles[:, :3], position_rank(facets.points))
    # in a thin layer the three tets of a prism are springs of its last, middle and first corner
    young = np.take_along_axis(facets.young, order, axis=1)[:, ::-1]
    turn = direction * odd
    area = np.linalg.norm(facets.area_vectors, axis=1)
    thickness = facets.thickness.copy()
    for attempt in range(HALVINGS + 1):
        points = facets.points + direction * thickness[:, None] * facets.normals
        bad = ~_sound(facets.points, points, triangles, turn,
                      area * thickness[triangles].mean(1) / 3)
        if not bad.any() or attempt == HALVINGS:
            break
        thickness[np.unique(triangles[bad])] *= 0.5
    outer_of = triangles + n  # outer vertex behind each corner
    wanted, achieved = facets.thickness[triangles].mean(axis=1), thickness[triangles].mean(axis=1)
    if bad.any():  # own outer nodes along the facet's normal
        lone = np.flatnonzero(bad)
        step = direction * wanted[lone, None] * facets.area_vectors[lone] / area[lone, None]
        own = facets.points[triangles[lone]] + step[:, None, :]
        outer_of[lone] = 2 * n + np.arange(3 * len(lone)).reshape(-1, 3)
        points = np.vstack([points, own.reshape(-1, 3)])
        achieved[lone] = wanted[lone]
    tets = _three_tets(triangles, outer_of)
    tets[turn < 0] = tets[turn < 0][:, :, [1, 0, 2, 3]]
    cells = tets.reshape(-1, 4)
    used, inverse = np.unique(cells[cells >= n], return_inverse=True)
    cells[cells >= n] = n + inverse
    points = points[used - n]
    if facets.triangles.shape[1] == 6:
        points, cells = with_middles(facets.points, lines_of(facets.triangles), points, cells)
    return Sole(points=points, cells=cells, young=(young * (achieved / wanted)[:, None]).ravel(),
                poisson=np.repeat(facets.poisson, 3))


def split(corners: np.ndarray, rank: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(k, 3) corners of facets sorted by the rank (n,) of their nodes, (k,) −1 where that turns a
    facet over, else 1, and (k, 3) the places that they had.
    """
    order = np.argsort(rank[corners], axis=1)
    # an odd permutation has an inversion count of 1 or 3
    odd = ((order[:, 0] > order[:, 1]).astype(int) + (order[:, 0] > order[:, 2])
           + (order[:, 1] > order[:, 2])) % 2
    return np.take_along_axis(corners, order, axis=1), np.where(odd == 1, -1.0, 1.0), order


def _three_tets(inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """(k, 3, 4) tets of prisms between triangles (k, 3) and those behind them, in the order of the
    corners.
    """
    (a, b, c), (a1, b1, c1) = inner.T, outer.T
    return np.stack([np.stack([a, b, c, c1], 1), np.stack([a, b, c1, b1], 1),
                     np.stack([a, a1, b1, c1], 1)], 1)


def _sound(points: np.ndarray, outer: np.ndarray, triangles: np.ndarray, turn: np.ndarray,
           share: np.ndarray) -> np.ndarray:
    """(k,) bool, whether no tet of a prism is flat, or turned over.

    points, outer : (n, 3) nodes of the facets (k, 3), and those behind them
    turn : (k,) ±1, orientation; share : (k,) regular volume of a tet
    """
    tets = _three_tets(triangles, triangles + len(points))
    volume = tet_volumes(np.vstack([points, outer]), tets.reshape(-1, 4)).reshape(-1, 3)
    return ~(turn * np.where(turn > 0, volume.min(axis=1), volume.max(axis=1)) < FLATNESS * share)


def merge(first: Sole, second: Sole, n: int) -> Sole:
    """Both soles on the same interface of n nodes, each with its own other nodes."""
    shifted = np.where(second.cells >= n, second.cells + len(first.points), second.cells)
    return Sole(np.vstack([first.points, second.points]), np.vstack([first.cells, shifted]),
                np.r_[first.young, second.young], np.r_[first.poisson, second.poisson])
