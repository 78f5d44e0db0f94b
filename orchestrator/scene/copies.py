"""Nodes with a copy for each subdomain that has them, one subdomain after another, and which of them bonds make one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.parallel.numbering import Borders, classes, Meeting, runs
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.mesh.faces import components, pack
from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Copies:
    """N copies in all, of the subdomains of a scene, or of those of a part that are its rank's own.

    scene : whose
    ends : (subdomains + 1,) int, where each subdomain's begin
    node : (N,) int, nodes of the mesh
    meeting : equal labels where perfect interfaces make copies one, and which of them are one with other ranks'
    """

    scene: Scene
    ends: np.ndarray
    node: np.ndarray
    meeting: Meeting

    @classmethod
    def of(cls, scene: Scene, rank_of: np.ndarray | None = None, team: Team = ALONE) -> Copies:
        """Copies of all ranks, which ask together.

        rank_of : (subdomains,) int, the rank of each; None: all are this one's
        """
        rank_of = np.zeros(len(scene.subdomains), dtype=int) if rank_of is None else rank_of
        mine = rank_of == team.rank
        ends = np.cumsum([0, *(len(s.nodes) if own else 0 for s, own in zip(scene.subdomains, mine))])
        node = np.concatenate([s.nodes for s, own in zip(scene.subdomains, mine) if own])
        return cls(scene, ends, node, _meeting(scene, ends, rank_of, team))

    @property
    def label(self) -> np.ndarray:
        """(N,) int, equal where perfect interfaces make copies one."""
        return self.meeting.label

    @property
    def own(self) -> np.ndarray:
        """(m,) bool, the tets of these subdomains."""
        return (np.diff(self.ends) > 0)[self.scene.cell_subdomain]

    @cached_property
    def cells(self) -> np.ndarray:
        """(m, 4 or 10) int, copies that each of these tets is on."""
        cells = np.zeros_like(self.scene.mesh.cells)
        for s, start, end in zip(self.scene.subdomains, self.ends, self.ends[1:]):
            if end > start:  # its own
                cells[s.cells] = s.connectivity + start
        return cells

    @cached_property
    def _borders(self) -> Borders:
        return self.meeting.borders(np.arange(len(self.node)))

    def one_with(self, chosen: np.ndarray) -> np.ndarray:
        """(N,) bool, copies that are one with some, int, of any rank; all ranks ask together."""
        return self._borders(np.isin(self.label, self.label[chosen]).astype(float)) > 0

    def faces_of(self, triangles: np.ndarray, surface: np.ndarray) -> np.ndarray:
        """(k,) bool, which triangles (k, 3) of the mesh are among those of a surface, of which each rank has some; all ask together."""
        team, count = self.meeting.team, len(self.scene.mesh.nodes)
        found = np.isin(pack(triangles, count), pack(surface, count))
        if team.size == 1:
            return found
        every = np.concatenate([triangles, surface])
        at = np.arange(len(every))
        there = np.concatenate([found, np.ones(len(surface))])
        return Borders(np.sort(self.scene.number[every], axis=1), at, team)(there)[: len(found)] > 0


def _meeting(scene: Scene, ends: np.ndarray, rank_of: np.ndarray, team: Team) -> Meeting:
    pairs: dict[int, list[np.ndarray]] = {team.rank: [np.empty((2, 0), dtype=int)]}
    for i in scene.interfaces:
        if i.law.perfect and i.mortar is None and len(i.nodes[0]):
            copies = [ends[e] + nodes for e, nodes in zip(i.subdomains, i.nodes) if rank_of[e] == team.rank]
            if copies:
                pairs.setdefault(int(rank_of[list(i.subdomains)].sum() - team.rank), []).append(np.stack(copies))
    within, count = np.concatenate(pairs.pop(team.rank), axis=1), int(ends[-1])
    if team.size == 1:
        return Meeting(components(*within, count)[1], np.zeros(count, dtype=bool))
    across = {rank: np.concatenate(copies, axis=1)[0] for rank, copies in pairs.items()}
    counts = np.diff(ends)
    every = team.sum(counts)[0].astype(int)
    label = classes(runs(np.cumsum(every) - every, counts), *within, across, team)
    return Meeting(label, np.isin(label, label[np.concatenate([np.empty(0, int), *across.values()])]), team)
