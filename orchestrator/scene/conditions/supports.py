"""Rigid motions that supports keep subdomains from: six numbers' worth each, from whichever rank
has its nodes.

Loose bodies: those that nothing but contact could hold; interfaces that join bodies wholly, or in
single points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.conditions.rigid import Hinge, left_over, motions_about, null_space, size_of
from orchestrator.scene.interface import ends_of, Interface
from orchestrator.scene.mesh.faces import by_label, components
from orchestrator.scene.mesh.geometry import format_point, unit
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.partition import Partition


ORIGIN = np.zeros(3), 1.0


@dataclass(frozen=True)
class Supports:
    """Of some subdomains.

    centre, size : (s, 3) and (s,) that motions are about, as of ``motions_about``; all nodes are
        within
    rows : (s, 6, 6) triangular factors of the motions of what is held; count : (s,) int, how much
        that is
    """

    centre: np.ndarray
    size: np.ndarray
    rows: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, scene: Scene, own: Sequence[Subdomain],
           kept: Mapping[int, Sequence[np.ndarray]] = {}) -> Supports:
        """Of subdomains whose nodes are all there.

        kept : number of a subdomain → (q, 6) each, what else must rest, of a translation of the
            origin and a rotation about it
        """
        result = cls(np.zeros((len(own), 3)), np.ones(len(own)), np.zeros((len(own), 6, 6)),
                     np.zeros(len(own), dtype=int))
        for k, s in enumerate(own):
            points, at = scene.mesh.nodes[s.nodes], np.flatnonzero(s.fixed.any(axis=1))
            result.centre[k], result.size[k] = about = points.mean(axis=0), size_of(points)
            more = [rows @ _turned(ORIGIN, about) for rows in kept.get(s.index, ())]
            rows = np.concatenate([motions_about(points[at], *about)[s.fixed[at]],
                                   *map(unit, more)])
            factor = np.linalg.qr(rows, mode="r")
            result.rows[k, : len(factor)], result.count[k] = factor, len(rows)
        return result

    def of_body(self, pieces: np.ndarray) -> tuple[tuple[np.ndarray, float], np.ndarray]:
        """Centre (3,) and size of some subdomains (k,) int that move as one; (6 k, 6) what holds
        them, of motions about these.
        """
        centre = self.centre[pieces].mean(axis=0)
        about = centre, float(
            (np.linalg.norm(self.centre[pieces] - centre, axis=1) + self.size[pieces]).max())
        return about, np.concatenate([self.rows[e] @ _turned((self.centre[e], self.size[e]), about)
                                      for e in pieces])

    def free(self, body: np.ndarray) -> np.ndarray:
        """(bodies,) bool, which can move as rigid ones; ``body`` (s,) int that each subdomain is
        of.
        """
        result = np.ones(int(body.max()) + 1, dtype=bool)
        for b, pieces in enumerate(by_label(body)):
            count = self.count[pieces].sum()
            if count >= 6:
                rows = self.of_body(pieces)[1]
                result[b] = null_space(np.sqrt(len(rows) / count) * rows).shape[1] > 0
        return result

    def loose(self, joined: np.ndarray) -> np.ndarray:
        """(s,) bool, those that can move together with what pairs (k, 2) of them join."""
        body = components(*joined.T, len(self.count))[1]
        return self.free(body)[body]


def supports_of(scene: Scene) -> Supports:
    """Of all subdomains of a scene, or of the one that it is a part of."""
    return Supports.of(scene,
                       scene.subdomains) if scene.overview is None else scene.overview.supports


def _turned(one: tuple[np.ndarray, float], two: tuple[np.ndarray, float]) -> np.ndarray:
    """(6, 6) coefficients of a motion about a centre (3,) and a size, from those about another."""
    matrix = np.zeros((6, 6))
    matrix[:3] = motions_about(one[0][None], *two)[0]
    matrix[3:, 3:] = one[1] / two[1] * np.eye(3)
    return matrix


def loose_bodies(scene: Scene) -> np.ndarray:
    """(subdomains,) bool, those that can move as rigid bodies, together with what joining laws tie
    to them.

    What contact may do for them depends on the load, and is not looked at: a block that is pressed
    on another one and rubs is loose. A ground keeps from happening what its law says: a point that
    is pushed by a force holds nothing along it.
    """
    if scene.overview is not None:
        return scene.overview.loose
    kept: dict[int, list[np.ndarray]] = {}
    for i in scene.interfaces:
        if i.ground:
            kept.setdefault(i.subdomains[0],
                            []).append(
                                i.law.keeps(motions_about(scene.mesh.nodes[i.global_nodes],
                                                          *ORIGIN)))
    joining = ends_of(i for i in scene.interfaces if i.law.joins and not i.ground)
    return Supports.of(scene, scene.subdomains, kept).loose(joining)


SHARED = "an edge that bodies share is a hinge, and a corner less"


def joins(mesh: Mesh, partition: Partition,
          interfaces: Sequence[Interface]) -> tuple[list[np.ndarray], list[Hinge]]:
    """Cells (k, 2) on both sides of interfaces that join wholly, and the others.

    Under laws that do not join bodies, as contact, the sides are taken to hold each other: what
    they carry depends on the load.
    """
    first = np.unique(partition.subdomain, return_index=True)[1]
    whole, hinges = [], []
    for i in interfaces:
        points, cure = mesh.nodes[i.global_nodes], SHARED
        if len(i.triangles):
            # sides without any point are told of elsewhere
            if i.mortar is None or not i.law.joins or not len(i.mortar):
                whole.append(i.cells)
                continue
            points = i.mortar.places(i.mortar.first, points)
            if not left_over(points, np.ones(points.shape, dtype=bool)).shape[1]:
                whole.append(i.cells)
                continue
            many = "one point carries" if len(
                points) == 1 else f"{len(points)} points in a line carry"
            cure = (
                f"{i.name} have so little in common beside the size of their facets that {many}, "
                f"at {format_point(points.mean(axis=0))}: mesh both finer there")
        hinges.append(Hinge(tuple(int(first[e]) for e in i.subdomains), points, cure))
    return whole, hinges
