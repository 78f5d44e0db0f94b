"""The fields of the whole, from the pieces that ranks have: array after array, block after block, so that nobody has all of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orchestrator.method.delivery.interface_fields import ALONG, InterfaceFields, rows_of
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.npz import SIDES, Streamed, fields_from, of_interfaces
from orchestrator.results.ranks import Piece

BLOCK = 1 << 19  # bytes


def arrays(piece: Piece) -> Iterator[tuple[str, np.ndarray | Streamed]]:
    """Names and arrays of fields.npz, in its order, on rank 0; every rank goes through them, and through all blocks, together."""
    f, team = piece.fields, piece.team
    nodes, cells = Rows(piece.number, team), Rows(piece.cells, team)
    yield "nodes", nodes.blocks(f.nodes)
    yield "cells", cells.blocks(piece.number[f.cells])
    yield "subdomain", cells.blocks(f.subdomain)
    yield "lame", cells.blocks(f.lame)
    yield "displacement", nodes.blocks(f.displacement, 1, None if f.joined is None else piece.copy)
    if f.joined is not None:
        yield from _sides(piece)
        yield from of_interfaces(piece.interfaces and _interfaces(piece.interfaces, team))
    if f.discretisation_error is not None:
        yield "discretisation_error", cells.blocks(f.discretisation_error, 1)
    yield "part", cells.blocks(f.part)
    if f.joined is not None:
        labels, own = np.unique(f.meeting.label, return_inverse=True)
        yield "joined", Rows(piece.copy, team).blocks(numbered(labels, team)[0][own.ravel()])
    if f.believed is not None:
        yield "believed", cells.blocks(f.believed)
    if f.thermal is not None:
        yield "thermal", cells.blocks(f.thermal, 1)
    yield "parts", np.array(f.parts, dtype=str)


def tell(piece: Piece) -> None:
    """What the other ranks do while rank 0 writes the arrays."""
    for _, array in arrays(piece):
        deque(array, 0)


def whole_fields(piece: Piece) -> Fields | None:
    """All fields, in memory, on rank 0; all ranks ask together."""
    found = {name: array.whole() if isinstance(array, Streamed) else array for name, array in arrays(piece)}
    return fields_from(found) if piece.team.rank == 0 else None


def _sides(piece: Piece) -> Iterator[tuple[str, np.ndarray]]:
    """Displacements of each subdomain's own nodes, of as many at once as are a block."""
    f, counts = piece.fields, piece.counts
    ends = np.cumsum(counts)
    own = np.searchsorted(piece.copy, ends - counts), np.searchsorted(piece.copy, ends)
    batch = (8 * f.displacement[:, :1].size * ends) // BLOCK
    for number in np.unique(batch):
        there = np.flatnonzero(batch == number)
        told = piece.team.gather({e: f.displacement[:, a:b] for e, a, b in zip(there, *(x[there] for x in own)) if b > a})
        if told is not None:
            sides = {e: u for one in told for e, u in one.items()}
            yield from ((f"{SIDES}{e}", sides[e]) for e in there)


def _interfaces(own: InterfaceFields, team: Team) -> InterfaceFields:
    """Those of all ranks, in the order of the scene, their arrays streamed but for texts."""
    index, *told = (np.concatenate(each) for each in zip(*team.all_gather((own.index, own.counts_of_each, own.names, own.laws))))
    every, names, laws = (each[np.argsort(index)] for each in told)
    number = rows_of(every, own.index)
    rows = {what: Rows(at, team) for what, at in number.items()}
    whole = replace(own, triangles=number["node"][own.triangles], owner=own.index[own.owner])
    streamed = {name: rows[of].blocks(x, axis) for name, (of, axis) in ALONG.items() if (x := getattr(whole, name)) is not None}
    return replace(own, **streamed | {"names": names, "laws": laws, "offsets": np.concatenate([[0], np.cumsum(every[:, 0])])},
                   own={name: rows["node"].blocks(x, 1) for name, x in own.own.items()})


class Rows:
    """Rows of a whole of which every rank has some; all ranks make it, and go through its blocks, together.

    number : (k,) int, which ones this rank has; others may have them too
    """

    def __init__(self, number: np.ndarray, team: Team):
        self._team, self._order = team, np.argsort(number, kind="stable")
        self._number = number[self._order]
        self._count = 1 + int(team.max(float(number.max(initial=-1)))[0])

    def blocks(self, values: np.ndarray, axis: int = 0, turn: np.ndarray | None = None) -> Streamed:
        """Values (k, …), or with ``axis`` 1 (T, k, …), of the whole.

        turn : (k,) int: of rows that are there several times the mean, added in this order; None: they are the same
        """
        shape = (*values.shape[:axis], self._count, *values.shape[axis + 1:])
        return Streamed(shape, values.dtype, self._made(values if axis else values[None], turn))

    def _made(self, layers: np.ndarray, turn: np.ndarray | None) -> Iterator[np.ndarray]:
        size = max(1, BLOCK // max(1, layers.itemsize * math.prod(layers.shape[2:])))
        for layer in layers:
            for first in range(0, self._count, size):
                block = self._block(layer, turn, first, min(size, self._count - first))
                if block is not None:
                    yield block

    def _block(self, layer: np.ndarray, turn: np.ndarray | None, first: int, size: int) -> np.ndarray | None:
        """Some rows of the whole, on rank 0."""
        a, b = np.searchsorted(self._number, [first, first + size])
        own, at = self._order[a:b], self._number[a:b] - first
        told = self._team.gather((at, layer[own], None if turn is None else turn[own]))
        if told is None:
            return None
        block = np.zeros((size, *layer.shape[1:]), layer.dtype)
        if turn is None:
            for at, rows, _ in told:
                block[at] = rows
            return block
        at, rows, turns = (np.concatenate(each) for each in zip(*told))
        order = np.argsort(turns, kind="stable")
        np.add.at(block, at[order], rows[order])
        return block / np.maximum(np.bincount(at, minlength=size), 1)[:, None]
