"""The surfaces on which two bodies face each other, and which of the two is the slave.

In this order: the side that the user names; the one that has free nodes at all; under a law by which the sides deform as
one, the softer where moduli differ much (a stiff slave with coarse facets leaves a soft master's waves free); the one that is
covered, where the other is not (no point then has its pressure on half its area); else the coarser, which has fewer points
and smoother pressures; of equal sides the first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.interfaces.mortar.segments import FACING, Segments, find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import Body

# Moduli that differ by more than this count as soft and stiff.
CONTRAST = 10.0
# A side is covered where the other overlaps this share of its facets: chords of curved faces leave slits.
FULL = 0.99
# Sides whose facets' mean areas differ by less than this are equally fine: rounding, or the same size asked for twice.
ALIKE = 0.05


@dataclass(frozen=True)
class Matter:
    """What the choice of the slave looks at, beside the surfaces.

    Parameters
    ----------
    young : (m,) modulus of each cell of the mesh; held : (n,) bool, nodes of which some component is prescribed
    """

    young: np.ndarray
    held: np.ndarray


@dataclass(frozen=True)
class Asked:
    """What is asked of two sides.

    Parameters
    ----------
    as_one : whether the law makes them deform as one
    reach : how far they may be apart, in units of h = √(2 × area) of the larger of two facets; depth : how far in each other
    within : a length in place of ``reach``
    slave : 0 or 1 where the user has chosen the first or the second side; None: as they are
    facing : the cosine between normals has to be below this
    """

    as_one: bool
    reach: float
    depth: float
    within: float | None = None
    slave: int | None = None
    facing: float = FACING


def facing_surfaces(points: np.ndarray, bodies: tuple[Body, Body], chosen: tuple[np.ndarray, np.ndarray], matter: Matter,
                    asked: Asked) -> Iterator[tuple[int, Surfaces]]:
    """Connected patches of faces that lie opposite each other, and which body, 0 or 1, is the slave there.

    Parameters
    ----------
    points : (n, 3) nodes of the mesh
    chosen : (a,), (b,) int, the facets of either body that come into question
    """
    found = _overlaps(bodies, chosen, 0, asked)
    if not len(found):
        return
    sides = tuple(body.triangles[own] for body, own in zip(bodies, chosen))
    cells = tuple(body.cells[own] for body, own in zip(bodies, chosen))
    for patch in Surfaces.of(points, sides, cells, found).patches(points):
        slave = slave_of(patch, matter, asked)
        if slave == 0:
            yield 0, patch
            continue
        # the same facets, seen from the other side
        turned = patch.turned()
        corners = [x[t[:, :3]] for x, t in zip(turned.points, turned.triangles)]
        back = _within(*corners, asked)
        if len(back):
            everywhere = tuple(n[t] for n, t in zip(turned.nodes, turned.triangles))
            yield 1, Surfaces.of(points, everywhere, turned.cells, back)


def slave_of(surfaces: Surfaces, matter: Matter, asked: Asked) -> int:
    """0: the side that the overlaps have been found from; 1: the other."""
    if asked.slave is not None:
        return asked.slave
    held = [matter.held[n].all() for n in surfaces.nodes]
    if held[0] != held[1]:
        return int(held[0])
    if asked.as_one:
        young = [float(np.mean(matter.young[c])) for c in surfaces.cells]
        if max(young) > CONTRAST * min(young):
            return int(young[1] < young[0])
    area = [_areas(x, t) for x, t in zip(surfaces.points, surfaces.triangles)]
    common = surfaces.segments.area.sum()
    covered = [common >= FULL * a.sum() for a in area]
    if covered[0] != covered[1]:
        return int(covered[1])
    mean = [float(a.mean()) for a in area]
    return int(mean[1] > (1 + ALIKE) * mean[0])


def _overlaps(bodies: tuple[Body, Body], chosen: tuple[np.ndarray, np.ndarray], slave: int, asked: Asked) -> Segments:
    own, other = (bodies[side].corners[chosen[side]] for side in (slave, 1 - slave))
    return _within(own, other, asked)


def _within(slave: np.ndarray, master: np.ndarray, asked: Asked) -> Segments:
    """The overlaps of facets (a, 3, 3) and (b, 3, 3) that are near enough for what is asked."""
    h = [np.sqrt(2 * _area(corners)) for corners in (slave, master)]
    if not len(slave) or not len(master):
        return find_segments(slave, master, h[0], h[0])
    most = np.maximum(h[0], h[1].max())
    reach = np.full(len(slave), asked.within) if asked.within is not None else asked.reach * most
    found = find_segments(slave, master, reach, asked.depth * most, asked.facing)
    larger = np.maximum(h[0][found.slave], h[1][found.master])
    near = found.distance >= -asked.depth * larger
    if asked.within is None:
        near &= found.distance <= asked.reach * larger
    return found.some(near)


def _areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    return _area(points[triangles[:, :3]])


def _area(corners: np.ndarray) -> np.ndarray:
    """(k,) of triangles (k, 3, 3)."""
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
