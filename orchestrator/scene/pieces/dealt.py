"""Meshes that ranks have in shares, cut in subdomains: each rank is dealt the cells of its subdomains, and of others those around."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.parallel.numbering import met, rendezvous
from orchestrator.parallel.team import Team
from orchestrator.scene.interfaces.opposite import REACH, Body, outer_bodies
from orchestrator.scene.mesh.faces import Faces, faces_of
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.pieces.piece import Extent, Piece, Share

PLACES = 2**17  # along an axis: three of them are a number that messages can hold
OUTER = ""  # what names the triangles of the whole mesh's outer faces: no surface is called so


class Dealt:
    """A mesh of which each rank has a share at first. All ranks make it, and call what has a ``team``, together.

    names : of its subdomains; further : whether they are pieces of bodies; extent : of all of it
    sizes : (subdomains,) nodes of each; (k, 2) int, pairs that share three or more; (k,) how many
    """

    def __init__(self, share: Share, nodes: int, team: Team):
        self._share, self.names, self.further, points = share, share.partition.names, bool(share.partition.bodies), share.mesh.nodes
        ends = np.stack([-points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)])
        low, high = np.array(team.max(*ends.ravel())).reshape(2, 3)
        self.extent = Extent(nodes, np.stack([-low, high]))
        self.sizes = self._measured(team)

    def _measured(self, team: Team) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``sizes``; nodes that are at one place, but for what a grid of ``PLACES`` does not tell apart, are one."""
        mesh, of, (low, high) = self._share.mesh, self._share.partition.subdomain, self.extent.box
        n = len(mesh.nodes)
        own = np.unique(of[:, None] * np.int64(n) + mesh.cells)
        nodes, = team.sum(np.bincount(own // n, minlength=len(self.names)))
        faces = faces_of(mesh.cells, n)
        sides = of[np.stack([faces.owner, np.where(faces.neighbour < 0, faces.owner, faces.neighbour)])]
        border = (faces.neighbour < 0) | (sides[0] != sides[1])
        place = np.rint((mesh.nodes - low) / (high - low).max() * (PLACES - 1)).astype(int) @ PLACES ** np.arange(3)
        pairs, common = met(np.tile(place[faces.triangles[border]].ravel(), 2), np.repeat(sides[:, border].ravel(), 3), team)
        return nodes, pairs[common > 2], common[common > 2]

    def deal(self, rank_of: np.ndarray, entries: Sequence[Any], team: Team) -> None:
        """Hands the subdomains on to their ranks (subdomains,) int, with what is around each rank's:
        cells that touch them, and those behind outer faces that are near outer faces of theirs, as
        far as ``entries`` of ``interfaces`` reach."""
        share, self._share = self._share, None
        home = rank_of[share.partition.subdomain]
        share = share.handed_on([np.flatnonzero(home == rank) for rank in range(team.size)], team)
        around = _touching(share, team)
        beside = share.handed_on(around, team)
        faces = faces_of(beside.mesh.cells, len(beside.mesh.nodes))
        mine = rank_of[beside.partition.subdomain[faces.owner]] == team.rank
        outer = faces.triangles[mine & (faces.neighbour < 0)]
        outer = np.searchsorted(share.number, beside.number[outer])
        del beside, faces, mine
        share = replace(share, mesh=replace(share.mesh, surfaces={**share.mesh.surfaces, OUTER: outer}))
        found = [around, [_supporting(share.mesh, outer, some) for some in around]]
        if len(share.mesh.volumes) > 1:
            found.append(_near(share, outer, entries, team))
        around = [np.unique(np.concatenate(some)) for some in zip(*found)]
        self._share = share.handed_on(around, team)

    def piece(self, mine: np.ndarray) -> Piece:
        """Of some subdomains, ascending, once they are dealt.

        Raises InputError: one of them is not connected, tets are inverted, ranks have read what does not agree
        """
        share, self._share = self._share, None
        surfaces = dict(share.mesh.surfaces)
        outer = surfaces.pop(OUTER)
        return Piece.of(replace(share, mesh=replace(share.mesh, surfaces=surfaces, within=self.extent.box)), outer, mine)


def _touching(share: Share, team: Team) -> list[np.ndarray]:
    """For every rank the cells of this one's that touch its, be it in a single node; for this rank all."""
    found = [np.empty(0, int)] * team.size
    found[team.rank] = np.arange(len(share.mesh.cells))
    for rank, nodes in rendezvous(share.number[:, None].astype(float), team).items():
        met_there = np.zeros(len(share.number), dtype=bool)
        met_there[nodes] = True
        found[rank] = np.flatnonzero(met_there[share.mesh.cells].any(axis=1))
    return found


def _supporting(mesh: Mesh, outer: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(k,) int, cells behind outer faces (f, 3) that may hold nodes of some cells (c,)."""
    there = np.zeros(len(mesh.nodes), dtype=bool)
    there[mesh.cells[cells]] = True
    faces, there[:] = outer[there[outer].any(axis=1)], False
    there[faces] = True
    return np.flatnonzero(there[mesh.cells].sum(axis=1) > 2)


def _near(share: Share, outer: np.ndarray, entries: Sequence[Any], team: Team) -> list[np.ndarray]:
    """For every rank cells of this one's subdomains that have outer faces (k, 3) of a volume within reach of such of its, of another volume:
    those behind all outer faces, which tell of a pair what the whole would, and those that touch outer faces within reach of the box around
    its, or, where sides may slide on, any."""
    mesh, bodies, farthest = share.mesh, _bodies(share, outer), max((e.reach or 0.0 for e in entries), default=0.0)
    slide = any(e.follows for e in entries)
    boxes = np.array([[*np.concatenate(body.box), max(REACH * body.size.max(), farthest), body.volume] for body in bodies]).reshape(-1, 8)
    found = [np.empty(0, int)] * team.size
    for rank, theirs in enumerate(team.all_gather(boxes)):
        cells, met_there = [np.empty(0, int)], np.zeros(len(mesh.nodes), dtype=bool)
        for body, (*_, room, _) in zip(bodies, boxes) if rank != team.rank else ():
            (low, high), reach = body.box, np.maximum(theirs[:, 6], room)[:, None]
            close = theirs[((theirs[:, 3:6] >= low - reach) & (theirs[:, :3] <= high + reach)).all(axis=1) & (theirs[:, 7] != body.volume)]
            cells += [body.cells] * bool(len(close))
            for box in close:
                met_there[body.triangles[body.within((box[:3], box[3:6]), np.inf if slide else max(box[6], room))]] = True
        found[rank] = np.union1d(np.concatenate(cells), np.flatnonzero(met_there[mesh.cells].any(axis=1)))
    return found


def _bodies(share: Share, outer: np.ndarray) -> list[Body]:
    """Outer faces (k, 3) of a mesh, by its subdomains and volumes."""
    mesh = share.mesh
    faces = faces_of(mesh.cells, len(mesh.nodes))
    at, none = faces.find(outer), np.empty(0, int)
    if not len(at):
        return []
    return outer_bodies(mesh, Faces(faces.nodes, faces.triangles[at], faces.keys[at], faces.owner[at], np.full(len(at), -1), none, none),
                        share.partition.subdomain)
