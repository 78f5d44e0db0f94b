"""Factor by which displacements are drawn larger than they are: visible, and no body distorted, parted or sunk into another by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields

LARGEST = 0.1  # largest drawn displacement over the structure's size
OPENING, FARTHEST = 0.03, 0.25  # the same for the largest opening, and the limit to which it may raise the other
DISTORTED = 0.2  # how far a body's points may be drawn from where they are in it, over its size; halves of a bolt into each other
MISFIT = 0.01  # over the structure's size, how far faces that touch may be drawn apart or into each other


def exaggeration(fields: Fields, steps: Sequence[int]) -> float:
    """Factor that shows the displacements, and the openings where there are any."""
    size, largest, i = float(np.linalg.norm(np.ptp(fields.nodes, axis=0))), max(largest_displacements(fields, steps)), fields.interfaces
    if largest == 0:
        return 1.0
    factor, opening = LARGEST * size / largest, 0.0 if i is None else float((i.gap - i.initial_gap)[list(steps)].max(initial=0.0))
    if opening > 0:
        factor = max(factor, min(OPENING * size / opening, FARTHEST * size / largest))
    sizes, distortions = _bodies(fields, steps)
    limits = [DISTORTED * sizes[distortions > 0] / distortions[distortions > 0]]
    if i is not None:  # faces that touch may part, or sink into each other, by ``MISFIT``; halves of a bolt by ``DISTORTED``
        most, given = _misfit(fields, steps)
        room = np.where(given, DISTORTED * sizes[i.subdomains].min(axis=1)[i.interface_of_node], MISFIT * size)
        limits.append(room[(most > 0) & (room > 0)] / most[(most > 0) & (room > 0)])
    return float(f"{min(factor, *(float(limit.min(initial=np.inf)) for limit in limits)):.1e}")


def largest_displacements(fields: Fields, steps: Sequence[int]) -> list[float]:
    """Per load step the largest displacement of what is ours: cells may stand for parts whose mesh is another program's."""
    drawn = fields.opened
    ours = np.unique(drawn.cells[drawn.lame[:, 1] > 0])
    return [float(np.linalg.norm(drawn.displacement[step][ours], axis=1).max(initial=0.0)) for step in steps]


def _bodies(fields: Fields, steps: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """(E,) size of each subdomain's box, and of that of its displacements, the largest of the load steps; 0 of those not ours.

    A node that several share counts for one of them.
    """
    drawn = fields.opened
    count, ours = int(drawn.subdomain.max()) + 1, drawn.lame[:, 1] > 0
    owner = np.full(len(drawn.nodes), count)
    owner[drawn.cells[ours]] = drawn.subdomain[ours, None]
    order = np.argsort(owner, kind="stable")[:int((owner < count).sum())]
    starts = np.flatnonzero(np.diff(owner[order], prepend=-1))

    def extent(values: np.ndarray) -> np.ndarray:
        found, values = np.zeros(count), values[order]
        if len(starts):
            box = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
            found[owner[order[starts]]] = np.linalg.norm(box, axis=1)
        return found

    return extent(drawn.nodes), np.max([extent(drawn.displacement[step]) for step in steps], axis=0)


def misfit(fields: Fields, steps: Sequence[int], factor: float) -> float:
    """Distance by which faces that touch are drawn apart or into each other; 0 where that is not seen: a tenth of what is let through."""
    if fields.interfaces is None:
        return 0.0
    most, given = _misfit(fields, steps)
    drawn = factor * float(np.where(given, 0.0, most).max(initial=0.0))
    return drawn if drawn > 0.1 * MISFIT * float(np.linalg.norm(np.ptp(fields.nodes, axis=0))) else 0.0


def _misfit(fields: Fields, steps: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) per interface node the jump that is not there, as a prescribed gap makes it up; (N,) whether it is imposed."""
    i = fields.interfaces
    jump = (i.gap - i.initial_gap)[list(steps)]
    apart = np.isin(i.status[list(steps)], i.kinds[i.kind_names == COUNTED[0]])
    given = np.array([law in LAWS and LAWS[law].as_one for law in i.laws])[i.interface_of_node]
    return np.where(apart, -jump, np.abs(jump)).max(axis=0, initial=0.0), given
