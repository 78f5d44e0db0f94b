"""Finds what probes read on a mesh: the tets of a part, those that have a point, and what is parted
there. Where a kind reads it finds itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.errors import InputError, KeyPath, Problems, wrong
from orchestrator.rounding import PLACED
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.geometry import barycentric
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.names import matching, suggestion

# On curved faces a point of the true surface lies beside the facets: taken to the nearest one
# within this share of the
# element's size, which facets of 40 degrees reach.
BESIDE = 0.1


@dataclass(frozen=True)
class Tets:
    """Tets that have a point: numbers (k,), ascending, barycentric coordinates (k, 4) there,
    volumes and subdomains (k,).

    place : (3,) the point, or the nearest one in the tet
    """

    number: np.ndarray
    weights: np.ndarray
    volume: np.ndarray
    subdomain: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class Finder:
    """Finds probes on a mesh.

    subdomain : (m,) int, of each tet; bodies : name of each subdomain's body
    name, cells, path : of the probe that is looked for; (m,) bool, the tets that are meant; its
        place in the YAML
    """

    mesh: Mesh
    faces: Faces | None
    subdomain: np.ndarray
    bodies: Sequence[str]
    interfaces: Sequence[Interface]
    problems: Problems
    name: str = ""
    cells: np.ndarray | None = None
    path: KeyPath = ()

    def find(self, asked: Mapping[str, Any]) -> list[Any]:
        """Return what ``output.probes`` asks for, by their names."""
        found = []
        for i, (name, one) in enumerate(asked.items()):
            path = ("output", "probes", i)
            try:
                cells = self._cells_of(one.part, (*path, "part"))
                found.append(one.found(replace(self, name=name, cells=cells, path=path)))
            except InputError as error:
                self.problems.found += error.problems
        return found

    def wrong(self, key: str, *why: str) -> InputError:
        """The error to raise for a key of the probe."""
        return wrong((*self.path, key), *why)

    def _cells_of(self, part: str | None, path: KeyPath) -> np.ndarray:
        """(m,) bool, the tets of a part; all where none is named.

        Raises InputError: there is none of that name
        """
        if part is None:
            return np.ones(len(self.mesh.cells), bool)
        if volumes := matching(part, self.mesh.volumes):
            return np.isin(self.mesh.volumes, volumes)[self.mesh.volume]
        own = np.isin(self.bodies, matching(part, self.bodies))[self.subdomain]
        if not own.any():
            raise wrong(path, f"no volume and no body is called {part!r}",
                        "a name of one, shell wildcards allowed",
                        suggestion(part,
                                   list(dict.fromkeys([*self.mesh.volumes, *self.bodies])),
                                   "volume"))
        return own

    def around(self, at: np.ndarray, allowed: np.ndarray) -> Tets:
        """Return tets that have a point; beside a curved surface the nearest one, farther away
        none.
        """
        cells, mesh = np.flatnonzero(allowed), self.mesh
        corners = mesh.nodes[mesh.cells[cells, :4]]
        size = np.ptp(corners, axis=1).max(axis=1)
        near = (np.maximum(corners.min(axis=1) - at, at - corners.max(axis=1)).max(axis=1) <= BESIDE
                * size)
        cells, corners, size = cells[near], corners[near], size[near]
        weights, place = barycentric(corners, at), at
        chosen = np.flatnonzero(weights.min(axis=1, initial=np.inf) >= -PLACED)
        if len(cells) and not len(chosen):
            weights = np.maximum(weights, 0.0)
            weights /= weights.sum(axis=1, keepdims=True)
            places = np.einsum("kax,ka->kx", corners, weights)
            away = np.linalg.norm(places - at, axis=1)
            chosen = away.argmin()[None]
            place = places[chosen[0]]
            chosen = chosen[away[chosen] <= BESIDE * size[chosen]]
        cells = cells[chosen]
        return Tets(cells, weights[chosen], mesh.volume[cells], self.subdomain[cells], place)

    def apart(self, tets: Tets) -> list[str]:
        """Names of what has tets of its own among these: volumes, and bodies that interfaces of one
        volume may part.
        """
        volumes = np.unique(tets.volume)
        if len(volumes) > 1:
            return [self.mesh.volumes[v] for v in volumes]
        theirs = np.unique(tets.subdomain)
        bonds = ends_of(i for i in self.interfaces if i.law.perfect)
        held = components(*bonds.T, len(self.bodies))[1][theirs]
        first = theirs[np.unique(held, return_index=True)[1]]
        return list(dict.fromkeys(self.bodies[e] for e in first))
