"""What ranks tell each other of the subdomains and interfaces that they have made: numbers for each, nothing of their size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from orchestrator.scene.cautions import Acting, beside_others, locking, noted, ratios
from orchestrator.scene.conditions.supports import Supports, with_grounds
from orchestrator.scene.interfaces.search import Laws
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.overview import Beside, Difficulty, Overview
from orchestrator.scene.part import overview, without_nodes
from orchestrator.scene.pieces.piece import Extent

_NONE = np.empty(0, dtype=int)
OF_INTERFACES = ("sides", "called", "entry", "order", "joins", "apart", "laws", "bolts", "mixed", "matched", "met")
SHARED, OPPOSITE, AT_NODES, BEHIND = range(4)  # kinds of interfaces, see ``Outline.order``


@dataclass
class Outline:
    """Of some subdomains and of the interfaces whose first side they are, in the order of the whole scene.

    number : (s,) int, which of the scene's subdomains; of some until all are joined a number that only puts them in their order
    names, bodies : theirs; code : (s,) int; heated : (s,) bool; cells : (s,) int, how many each has
    sides : (k, 2) int, subdomains of each interface; called : as these have it; entry : (k,) int, of ``interfaces:`` that governs it, −1 for none
    order : (k, 2) int, of ``SHARED`` faces, of ``OPPOSITE`` ones, ``AT_NODES`` alone, or ``BEHIND`` bodies, with a ground; and its
        place among those of its pair
    joins : (k,) bool, as their laws have it; apart : (k, 2) least and largest distance before they move
    laws : of grounds and bolts, at every load step; None of others, which ``entry`` tells of
    bolts : what is known of a bolt there but for its interface; None where there is none
    mixed, matched, met : (k,) of interfaces, and sizes, … : (s, …) of subdomains, as in ``Overview`` and ``Difficulty``
    faces : (entries,) int, how many of each entry of ``boundary`` are on them
    supports, kept : theirs, and with what grounds keep them from; used : (materials,) bool; ratio : of volumes, as ``ratios`` of cautions
    told : sentences
    acting : what acts on them; near, covered : as of a scene
    """

    number: np.ndarray
    names: list[str]
    bodies: list[str]
    code: np.ndarray
    heated: np.ndarray
    cells: np.ndarray
    sizes: np.ndarray
    hard: np.ndarray
    soft: np.ndarray
    slenderness: np.ndarray
    nodes: np.ndarray
    prints: np.ndarray
    sides: np.ndarray
    called: list
    entry: np.ndarray
    order: np.ndarray
    joins: np.ndarray
    apart: np.ndarray
    laws: list
    bolts: list
    mixed: np.ndarray
    matched: np.ndarray
    met: np.ndarray
    faces: np.ndarray
    supports: Supports
    kept: Supports
    used: np.ndarray
    ratio: np.ndarray
    told: list[str]
    acting: Acting
    near: dict[tuple[int, int], Beside]
    covered: np.ndarray

    @classmethod
    def of(cls, scene: Scene, part: Scene, present: np.ndarray, own: np.ndarray) -> Outline:
        """Of some subdomains of a scene that was made of a piece.

        part : the part of it that belongs to these
        present : (subdomains,) int, which of the whole scene's those of the scene are
        own : (s,) int, ascending, which of them are told of
        """
        known, subdomains = overview(scene), [scene.subdomains[e] for e in own]
        mine = np.isin(np.arange(len(present)), own)
        order, at = _order(scene), np.array([i.index for i in scene.interfaces if mine[i.subdomains[0]]], dtype=int)
        first, bolts = [scene.interfaces[k] for k in at], {bolt.interface.index: replace(bolt, interface=None) for bolt in scene.bolts}
        sides = ends_of(first)
        hard = known.difficulty
        used = np.unique(np.concatenate([s.material for s in subdomains]))
        return cls(present[own], [s.name for s in subdomains], [s.body for s in subdomains], np.array([s.code for s in subdomains]),
                   np.array([s.heated for s in subdomains], dtype=bool), np.array([len(s.cells) for s in subdomains]),
                   *(x[own] for x in (known.sizes, hard.incompressible_or_slender, hard.soft, hard.slenderness, known.nodes, known.prints)),
                   present[sides], [i.called for i in first], np.array([i.entry for i in first], dtype=int), order[at],
                   np.array([i.law.joins for i in first], dtype=bool), np.array([_ends(i) for i in first]).reshape(-1, 2),
                   [[law.elsewhere() for law in (i.law, *i.law_at_steps)] if i.entry < 0 and not i.law.perfect else None for i in first],
                   [bolts.get(i.index) for i in first],
                   *(x[at] for x in (hard.mixed_moduli, known.matched, known.met)),
                   np.array([len(entry.triangles) for entry in part.boundary], dtype=int), Supports.joined([known.supports], own),
                   with_grounds(scene, subdomains), np.isin(np.arange(len(scene.materials)), used), ratios(scene), [*noted(scene)],
                   Acting.of(part, subdomains), scene.near, scene.covered)

    @classmethod
    def joined(cls, several: Sequence[Outline]) -> Outline:
        """Of all ranks'."""
        number = np.concatenate([x.number for x in several])
        own, order, sides = np.argsort(number), *(np.concatenate([getattr(x, name) for x in several]) for name in ("order", "sides"))
        sides = np.searchsorted(number[own], sides)
        first, last = np.where(order[:, :1] == BEHIND, sides[:, ::-1], np.sort(sides, axis=1)).T  # what is behind bodies follows each other
        pairs = np.lexsort((order[:, 1], last, first, order[:, 0]))

        def sorted_(name: str) -> object:
            values = [getattr(x, name) for x in several]
            if name in ("number", "sides"):
                return np.arange(len(own)) if name == "number" else sides[pairs]
            if name == "acting":
                return Acting.joined(values)
            if name == "near":
                return dict(sorted({pair: text for told in values for pair, text in told.items()}.items()))
            if name in ("supports", "kept"):
                return Supports.joined(values, own)
            if name == "told":
                return list(dict.fromkeys(sentence for told in values for sentence in told))
            if name == "ratio":
                return np.max(values, axis=0)
            if name in ("faces", "used", "covered"):
                return np.sum(values, axis=0).astype(values[0].dtype)
            if name in ("names", "bodies", "called", "laws", "bolts"):
                every = [word for words in values for word in words]
                return [every[i] for i in (pairs if name in OF_INTERFACES else own)]
            return np.concatenate(values)[pairs if name in OF_INTERFACES else own]

        return cls(**{f.name: sorted_(f.name) for f in fields(cls)})

    @property
    def titles(self) -> list[str]:
        """The interfaces' names."""
        pair, count = np.unique(self.sides, axis=0, return_inverse=True, return_counts=True)[1:]
        several, seen, titles = count[pair.ravel()] > 1, {}, []
        for (one, two), more, kind in zip(self.sides.tolist(), several.tolist(), self.order[:, 0].tolist()):
            seen[one, two] = seen.get((one, two), 0) + 1
            other = self.bodies[two] if kind == BEHIND else self.names[two]
            titles.append(f"{self.names[one]} | {other}" + f" (patch {seen[one, two]})" * more)
        return titles

    def overview(self, part: Scene, extent: Extent, rank_of: np.ndarray) -> Overview:
        """What every part has to know; ``part`` is any of them."""
        joined = self.sides[self.joins & (self.order[:, 0] != BEHIND)]
        loose = np.zeros(len(self.number), dtype=bool) if self.joins.all() else self.kept.loose(joined)
        return Overview(self.sizes, loose, Difficulty(self.mixed, self.hard, self.soft, self.slenderness), self.nodes, self.matched,
                        self.met, self.used, self.supports, [*locking(part.mesh.volumes, self.ratio), *self.told,
                                                      *beside_others(self.near, part.boundary, part.mesh.volumes, self.covered),
                                                      *self.acting.sentences(part.boundary)], extent.nodes, extent.box, self.prints, rank_of)

    def around(self, part: Scene, present: np.ndarray, known: Overview, laws: Laws) -> Scene:
        """A part of the scene of a piece as a part of the whole scene: with places for all other subdomains and interfaces.

        present : as for ``of``; laws : of the whole, which interfaces elsewhere get
        """
        local = {e: s for e, s in zip(present.tolist(), part.subdomains)}
        subdomains = [replace(local[e], index=e, heated=heated, code=int(self.code[e])) if e in local else self._hollow(e, part)
                      for e, heated in enumerate(self.heated.tolist())]
        there: dict[tuple[int, int], list[Interface]] = {}
        for i in part.interfaces:
            there.setdefault(tuple(present[list(i.subdomains)].tolist()), []).append(i)
        interfaces, none = [], np.empty((0, 3 if part.mesh.cells.shape[1] == 4 else 6), dtype=int)
        for k, (pair, title, entry) in enumerate(zip(map(tuple, self.sides.tolist()), self.titles, self.entry.tolist())):
            own = there[pair].pop(0) if there.get(pair) else None
            if own is not None and len(own.nodes[0]):
                interfaces.append(replace(own, index=k, subdomains=pair, name=title))
                continue
            at = np.arange(2)  # of all nodes those that the sides are least and farthest apart at
            own = Interface(k, title, pair, at, (at, at), none, np.empty((0, 2), int), np.ones((2, 3), bool), called=self.called[k])
            laws.apply(entry, own, self.apart[k])
            if self.laws[k] is not None:
                own.law, *own.law_at_steps = self.laws[k]
            interfaces.append(without_nodes(own))
        bolts = [replace(bolt, interface=i, name=i.name)
                 for bolt, i in zip(self.bolts, interfaces) if bolt]
        return replace(part, near=self.near, bolts=bolts, subdomains=subdomains, interfaces=interfaces, overview=known,
                       cell_subdomain=present[part.cell_subdomain])

    def _hollow(self, e: int, part: Scene) -> Subdomain:
        return Subdomain(e, self.names[e], _NONE, _NONE, part.mesh.cells[:0], _NONE, np.empty((0, 3), bool), np.empty((part.steps, 0, 3)),
                         np.empty((part.steps, 0, 3)), np.empty((0, 3), int), int(self.code[e]), body=self.bodies[e], heated=bool(self.heated[e]))


def _order(scene: Scene) -> np.ndarray:
    """(interfaces,) two numbers for each, see ``Outline``; the slave of sides that do not match may come first, whichever of the two it is."""
    made = scene.interfaces
    kind = np.array([BEHIND if i.law.on_ground else AT_NODES if not len(i.triangles) else
                     SHARED if np.array_equal(*(scene.side_nodes(i, side) for side in (0, 1))) else OPPOSITE for i in made], dtype=int)
    pairs = np.sort(ends_of(made), axis=1)
    changes = np.diff(np.column_stack([kind, pairs]), axis=0).any(axis=1)
    begins = np.flatnonzero(np.concatenate([[True], changes])) if made else _NONE
    return np.column_stack([kind, np.arange(len(made)) - np.repeat(begins, np.diff(np.append(begins, len(made))))])


def _ends(i: Interface) -> tuple[float, float]:
    """The least and the largest distance of its sides before they move."""
    distance = np.atleast_1d(i.law.distance)
    return (distance.min(), distance.max()) if len(distance) else (0.0, 0.0)


def hollow(scene: Scene) -> Scene:
    """A part of a scene without any of its arrays: what is known of all of the scene."""
    none = {name: getattr(scene, name)[:0] for name in ("cell_subdomain", "cell_material", "fixed", "number", "cell_number")}
    none |= {name: x[:, :0] for name in ("thermal", "body_force") if (x := getattr(scene, name)) is not None}
    mesh = replace(scene.mesh.hollow, within=scene.overview.box)
    return replace(scene, mesh=mesh, subdomains=[replace(s, cells=_NONE, nodes=_NONE, connectivity=s.connectivity[:0], material=_NONE,
                                                         fixed=s.fixed[:0], prescribed=s.prescribed[:, :0], loads=s.loads[:, :0],
                                                         held_by=s.held_by[:0], contact_area=s.contact_area[:0]) for s in scene.subdomains],
                   interfaces=[without_nodes(i) for i in scene.interfaces],
                   boundary=[b.of(np.empty(0, int)) for b in scene.boundary], prescribed=scene.prescribed[:, :0], loads=scene.loads[:, :0],
                   sagitta={}, **none)
