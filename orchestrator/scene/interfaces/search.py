"""The search for interfaces: a divided mesh; the entry of ``interfaces:`` that governs a pair, and where problems are told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np

from orchestrator.config.boundary import Entry, ROUND
from orchestrator.errors import Problems
from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.between import Hidden, hidden
from orchestrator.scene.interfaces.mortar.surfaces import Matter
from orchestrator.scene.interfaces.opposite import Body, COINCIDE, REACH, TOUCHING, cosine_of, outer_bodies
from orchestrator.scene.interfaces.overlap import Overlap, Solid, overlap
from orchestrator.scene.interfaces.skins import Skins, surface_of
from orchestrator.scene.mesh.faces import Faces, components, pack, pieces
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface
from orchestrator.scene.names import matching
from orchestrator.scene.partition import Partition

BONDED = Entry()


def govern(interface: Interface, entry: Any, factors: Sequence[float], direction: float = 1.0, distance: np.ndarray | None = None) -> None:
    """Give an interface the law of an entry, and where it differs between load steps that of each.

    factors : (steps,) what multiplies the entry
    direction, distance : as for ``Law.of``
    """
    law, count = LAWS[entry.law], len(interface.global_nodes)
    interface.law_at_steps = [law.of(at, count, direction, distance) for at in entry.at_steps(factors)] if len(factors) else []
    interface.law = max(interface.law_at_steps, key=lambda one: one.imposed) if interface.law_at_steps else \
        law.of(entry, count, direction, distance)


class Laws:
    """Finds the entry that governs a pair and remembers which entries were of use.

    entries : of the YAML, each with a ``pair`` of patterns, pairs to ``exclude``, and ``law``; the last match wins
    names : everything an entry could name, subdomains and volumes
    factors : per entry (steps,) what multiplies it; none: one load step
    """

    def __init__(self, entries: list[Any], names: Iterable[str], factors: Sequence[Sequence[float]] = ()):
        names = list(dict.fromkeys(names))
        self.entries, self.factors, self.names = list(entries), factors, names
        self.used = [False] * len(self.entries)
        # with self in it, it would refer to itself, and go only when Python looks for such things
        self.meant = cache(lambda pattern: frozenset(matching(pattern, names)))

    def between(self, first: Iterable[str], second: Iterable[str]) -> int:
        """Index of the governing entry, -1 for none.

        first, second : the names each side goes by (its subdomain's, its volume's)
        """
        hits = self._matching(first, second)
        for i in hits:
            self.used[i] = True
        return hits[-1] if hits else -1

    def foreseen(self, first: Iterable[str], second: Iterable[str]) -> int:
        """The entry for two sides that may turn out to have no interface: no entry counts as used."""
        hits = self._matching(first, second)
        return hits[-1] if hits else -1

    def apply(self, index: int, interface: Interface, distance: np.ndarray | None = None) -> None:
        """Give an interface the law of an entry; it stays what it is when none matched.

        distance : (n,) of the sides along the normal, where it has been read from the geometry
        """
        if index < 0:
            return
        entry, interface.entry = self.entries[index], index
        direction = 1.0 if self.means(entry.pair[0], interface.called[0]) else -1.0  # which way the entry's parts are ordered
        govern(interface, entry, self.factors[index] if self.factors else [], direction, distance)

    def __getitem__(self, index: int) -> Any:
        """The entry of an index; of −1 one that bonds what touches."""
        return self.entries[index] if index >= 0 else BONDED

    def slave(self, index: int, first: Iterable[str], second: Iterable[str]) -> int | None:
        """The side, 0 or 1, that an entry makes the slave; None: neither, or both by the same word."""
        chosen = [self[index].slave is not None and self.means(self[index].slave, side) for side in (first, second)]
        return None if chosen[0] == chosen[1] else chosen.index(True)

    def tolerance(self, index: int) -> float:
        """Distance up to which an entry pairs faces, in units of the element size."""
        entry = self[index]
        if entry.tolerance != "auto":
            return ROUND * entry.tolerance
        return TOUCHING if entry.found else REACH if entry.apart else COINCIDE

    def opposite(self, index: int) -> float:
        """Bound on the cosine between normals of faces that an entry pairs."""
        return cosine_of(self[index].angle)

    def refuse_within(self, cuts: Iterable[tuple[str, str]], problems: Problems) -> None:
        """Adds a problem for each entry whose law is meant for cuts through a body alone: these are perfect.

        cuts : names of the two sides
        """
        cuts = list(dict.fromkeys(cuts))
        for i, entry in enumerate(self.entries):
            hit = None if self.used[i] else next((c for c in cuts if i in self._matching(c[:1], c[1:])), None)
            if hit is None:
                continue
            self.used[i] = True
            if not LAWS[entry.law].perfect:
                problems.add(("interfaces", i, "between"), f"{entry.law} between {hit[0]} and {hit[1]}, pieces of one body",
                             "names of different bodies: their pieces are joined by perfect interfaces",
                             "leave this entry out; a real joint needs two volumes in the mesh")

    def _matching(self, first: Iterable[str], second: Iterable[str]) -> list[int]:
        """Indices of all entries that match, ascending."""
        return [i for i, entry in enumerate(self.entries)
                if entry.tool is None and self._are(entry.pair, first, second) and not self._left_out(entry, first, second)]

    def excluded(self, first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether an entry would govern two sides if it did not leave them out, and no other does."""
        return not self._matching(first, second) and any(self._left_out(entry, first, second) for entry in self.entries)

    def _left_out(self, entry: Any, first: Iterable[str], second: Iterable[str]) -> bool:
        return any(self._are(two, first, second) for two in entry.exclude or [])

    def _are(self, two: Sequence[str], first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether two patterns name two sides, in either order."""
        a, b = two
        return (self.means(a, first) and self.means(b, second)) or (self.means(b, first) and self.means(a, second))

    def means(self, pattern: str, names: Iterable[str]) -> bool:
        """Whether a pattern means one of a side's names."""
        return not self.meant(pattern).isdisjoint(names)


@dataclass
class Search:
    """A divided mesh, and what interfaces in it go by.

    mesh, faces, partition, numbering : the mesh, its faces, its subdomains, and their own numbers of nodes
    laws : the entries of ``interfaces:`` in the YAML
    problems : where what is wrong is told
    asked : whether the user has written the entries; what is near without an interface is a mistake then
    matter : what chooses slaves where nodes do not match; None: such faces are no interface
    slaves : of pairs of bodies that are cut further, the names of those whose pieces are the slaves, once chosen
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    numbering: SplitNumbering
    laws: Laws
    problems: Problems
    asked: bool = True
    matter: Matter | None = None
    slaves: dict[tuple[str, str], str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        mesh, faces = self.mesh, self.faces  # without self, as above

        def solid(v: int) -> Solid:
            own = mesh.volume == v
            return Solid(mesh.nodes, mesh.cells[own], faces.triangles[faces.outer[own[faces.owner[faces.outer]]]])

        self._solid = cache(solid)

    @cached_property
    def bodies(self) -> list[Body]:
        """The outer faces, by subdomain and volume; none where there is a single volume."""
        return outer_bodies(self.mesh, self.faces, self.partition.subdomain) if len(self.mesh.volumes) > 1 else []

    @cached_property
    def skins(self) -> Skins:
        """The surfaces that the bodies' faces stand for."""
        return Skins(self.mesh, self.faces, None if self.matter is None else self.matter.held)

    def hidden(self, one: Body, two: Body) -> Hidden:
        """The test whether another body is between faces of two."""
        return hidden(self.bodies, self.skins, one, two)

    @cached_property
    def pieces(self) -> tuple[int, np.ndarray]:
        """Number of pieces of the mesh that share no faces with each other, and the piece (m,) of each tet."""
        return pieces(self.faces, np.zeros(len(self.mesh.cells), dtype=int))

    def inside(self, one: int, two: int) -> Overlap | None:
        """Depth of two volumes in each other; None: not worth mentioning."""
        both = [self._solid(v) for v in (one, two)]
        if overlap(*both) is None:
            return None
        # worth a closer look: curved faces of coarse chords may be meant to touch
        return overlap(*both, tuple(surface_of(s.nodes, s.outer, self.skins.smooth[self.faces.find(s.outer[:, :3])]).sagitta for s in both))

    def names(self, sides: tuple[int, int]) -> tuple[str, str]:
        """Names of two subdomains."""
        return self.partition.names[sides[0]], self.partition.names[sides[1]]

    def known(self, body: Body) -> tuple[str, str]:
        """Names by which an entry may call a body: its subdomain's name, and its volume's."""
        return self.partition.names[body.subdomain], self.mesh.volumes[body.volume]

    def called(self, sides: tuple[int, int], volumes: Sequence[np.ndarray]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names by which an entry may call two subdomains that meet with cells of some volumes.

        Inside one volume only the subdomains' names count: a law for a part against all others is not meant for
        the cuts within that part.
        """
        within = len(self.mesh.volumes) == 1 or len(np.intersect1d(*volumes))
        return tuple((name, *(() if within else (self.mesh.volumes[v] for v in own))) for name, own in zip(self.names(sides), volumes))

    def cut_further(self, body: Body) -> bool:
        """Whether a body is a piece of a larger one."""
        return self.partition.body(body.subdomain) != self.partition.names[body.subdomain]

    def interface(self, sides: tuple[int, int], nodes: tuple[np.ndarray, np.ndarray], triangles: np.ndarray, cells: np.ndarray,
                  **more: Any) -> Interface:
        """An interface of subdomains, of global nodes (n₁,) and (n₂,) on either side; all components count as free."""
        own = tuple(self.numbering.find(np.int64(e), ids) - self.numbering.offsets[e] for e, ids in zip(sides, nodes))
        return Interface(-1, " | ".join(self.names(sides)), sides, nodes[0], own, triangles, cells,
                         np.ones((len(nodes[0]), 3), dtype=bool), **more)


def bonded(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(N,) int, label of each split node: equal where perfect interfaces of paired nodes make them one."""
    pairs = [numbering.sides(i) for i in interfaces if i.law.perfect and i.matching]
    one, two = (np.concatenate([np.empty(0, int), *side]) for side in (zip(*pairs) if pairs else ((), ())))
    return components(one, two, len(numbering.nodes))[1]


def paired_faces(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(k,) keys of the outer faces, of ``pack``, that interfaces pair with others; shared faces are no outer ones."""
    keys = [np.empty(0, np.int64)]
    for i in interfaces:
        if i.surfaces is not None:
            met = (np.unique(own) for own in (i.surfaces.segments.slave, i.surfaces.segments.master))
            sides = zip(i.surfaces.nodes, (t[own] for t, own in zip(i.surfaces.triangles, met)))
        else:
            nodes = [numbering.nodes[own] for own in numbering.sides(i)]
            sides = zip(nodes, 2 * [i.triangles]) if not np.array_equal(*nodes) else ()
        keys += [pack(nodes[triangles[:, :3]], numbering.total) for nodes, triangles in sides]
    return np.concatenate(keys)
