"""Fields of every interface, as those of the macro problem, on the traces of both sides and at the points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import narrow
from orchestrator.method.interface.transfer import Transfer


def both_sides(transfer: Transfer, bases: Sequence[np.ndarray], signs: tuple[float, float]) -> sp.csr_array:
    """(D, sum of m) forces of every interface's points, (points, m) each, on both sides with a sign for each.

    Interfaces without points here keep their columns. Zeros are no entries.
    """
    fields, G1, G2 = _on_points_of(transfer, bases), transfer.products.G1, transfer.products.G2
    return narrow(sp.csr_array((signs[0] * G1 + signs[1] * G2)[:, : transfer.size].T @ fields))


def displacements(transfer: Transfer, bases: Sequence[np.ndarray]) -> sp.csr_array:
    """(D, sum of m) fields of every interface without any jump: (points, m) each, the same on both sides where nodes
    match, elsewhere (trace dofs of side 1 and of side 2, m)."""
    if transfer.picks:
        return both_sides(transfer, bases, (1.0, 1.0))
    starts = np.cumsum([0] + [b.shape[1] for b in bases])
    rows, columns, values = [np.empty(0, int)], [np.empty(0, int)], [np.empty(0)]
    for index, basis in enumerate(bases):
        one, two = transfer.sides[index]
        dofs = np.concatenate([one, two])
        each = np.concatenate([basis, basis]) if transfer.matched[index] and len(dofs) else basis
        own = np.flatnonzero(dofs < transfer.size)
        at, column = np.nonzero(each[own])
        rows.append(dofs[own[at]])
        columns.append(starts[index] + column)
        values.append(each[own[at], column])
    return sp.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(transfer.size, int(starts[-1])))


def on_points(transfer: Transfer, bases: Sequence[np.ndarray]) -> sp.csr_array:
    """(Q, sum of m) the fields of ``displacements`` at the points."""
    return _on_points_of(transfer, [b if m else transfer.products.G1[a:e][:, one] @ b[: len(one)] for b, m, a, e, (one, _) in zip(
        bases, transfer.matched, transfer.bounds[:-1], transfer.bounds[1:], transfer.sides)])


def _on_points_of(transfer: Transfer, bases: Sequence[np.ndarray]) -> sp.csr_array:
    """(Q, sum of m) fields (points, m) of every interface, on its own points and in columns of its own."""
    widths, counts = np.array([b.shape[1] for b in bases], dtype=int), np.diff(transfer.bounds)
    values = np.concatenate([np.empty(0), *(b.ravel() for b, count in zip(bases, counts) if count)])  # what is met here
    width = np.repeat(widths, counts)  # of each point's row of its basis
    filled, point = np.flatnonzero(values), np.repeat(np.arange(len(width)), width)
    point = point[filled]
    column = filled + (np.repeat(np.cumsum(widths) - widths, counts) - (np.cumsum(width) - width))[point]
    ends = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=len(width)))])
    return narrow(sp.csr_array((values[filled], column, ends), shape=(len(width), int(widths.sum()))))
