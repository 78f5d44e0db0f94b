"""Factor by which displacements are drawn larger: visible, and no body distorted by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields

LARGEST = 0.1  # largest drawn displacement over the structure's size
# how far a body is drawn stretched, an open or tightened interface parted, over the (smaller) body
DISTORTED = 0.2
TOUCHING = 0.01  # over the structure's size, how far faces that touch may be drawn apart


def exaggeration(fields: Fields, kept: np.ndarray, steps: Sequence[int]) -> float:
    """Return the factor for cells (k,) int at some load steps; 1 where nothing moves."""
    largest = largest_displacement(fields, kept, steps)
    if largest == 0:
        return 1.0
    whole = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    limits = [LARGEST * whole / largest]
    size, stretched = _bodies(fields, kept, steps)
    limits += (DISTORTED * size[stretched > 0] / stretched[stretched > 0]).tolist()
    if (i := fields.interfaces) is not None:
        jump = np.abs(i.gap - i.initial_gap)[list(steps)]
        open_ = np.isin(i.status[list(steps)], i.kinds[i.kind_names == COUNTED[0]])
        given = np.array([law in LAWS and LAWS[law].as_one for law in i.laws])[i.interface_of_node]
        room = np.where(
            open_ | given,
            DISTORTED * size[i.subdomains].min(axis=1)[i.interface_of_node],
            TOUCHING * whole,
        )
        limits += (room[(jump > 0) & (room > 0)] / jump[(jump > 0) & (room > 0)]).tolist()
    return float(f"{min(limits):.1e}")


def largest_displacement(fields: Fields, kept: np.ndarray, steps: Sequence[int]) -> float:
    """Return the largest displacement of cells (k,) int at some load steps."""
    ours = np.unique(fields.opened.cells[kept])
    return max(
        float(np.linalg.norm(fields.opened.displacement[step][ours], axis=1).max())
        for step in steps
    )


def _bodies(
    fields: Fields, kept: np.ndarray, steps: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (E,) size of each subdomain's box, and of its displacements'; 0 without ``kept`` cells."""
    drawn, cells = fields.opened, fields.opened.cells[kept]
    order = np.argsort(fields.subdomain[kept], kind="stable")
    number, first = np.unique(fields.subdomain[kept][order], return_index=True)

    def extent(values: np.ndarray) -> np.ndarray:
        of_cells, found = values[cells[order]], np.zeros(int(fields.subdomain.max()) + 1)
        box = np.maximum.reduceat(of_cells.max(axis=1), first) - np.minimum.reduceat(
            of_cells.min(axis=1), first
        )
        found[number] = np.linalg.norm(box, axis=1)
        return found

    return extent(drawn.nodes), np.max([extent(drawn.displacement[step]) for step in steps], axis=0)
