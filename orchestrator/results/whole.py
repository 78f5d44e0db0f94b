"""The fields of the whole, from the pieces that ranks have: array after array, block after block, so that nobody has all of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orchestrator.method.delivery.interface_fields import ALONG, InterfaceFields, rows_of
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.npz import SIDES, fields_from, of_interfaces
from orchestrator.results.ranks import Piece
from orchestrator.results.rows import BLOCK, Rows, Streamed


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
