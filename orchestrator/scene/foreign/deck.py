"""The joints of a CalculiX deck: node sets, and the elements' faces whose nodes are all in one of them.

Nothing else of the deck is looked at but where it is supported, its first moduli, and the few cards that no part can have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.config.mesh import DeckPart
from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.foreign.deck_cards import check_deck, check_kept, check_loads
from orchestrator.scene.foreign.joints import Joints, cut_in_triangles, supports_left
from orchestrator.scene.mesh.inp_cards import Model, Row, cards, cards_of_a_model, numbers, outer
from orchestrator.scene.mesh.inp import SOLIDS, solid_nodes
from orchestrator.scene.mesh.splitting import CORNERS, EDGES, SIDES

SHAPES = {count: shape for count, shape in SOLIDS.items() if shape != "pyramid"}  # CalculiX has none
# Faces of elements by their number of nodes, corners first; anticlockwise seen from outside.
_CORNERS = {size: SIDES[CORNERS.get(shape, (shape,))[0]] for size, shape in SHAPES.items()}
# Of elements with such nodes, which one is in the middle of two corners.
_EDGES = {size: {tuple(sorted(ends)): CORNERS[shape][1] + i for i, ends in enumerate(EDGES[shape].tolist())}
          for size, shape in SHAPES.items() if shape in EDGES}


def joints(part: DeckPart, path: KeyPath, name: str) -> Joints:
    """The deck's joints, the nodes of all of them in ascending order of their numbers."""
    try:
        return _joints(part, path, name)
    except InputError as error:  # readers of cards know no more than the line
        raise InputError([p if p.path[:1] == path[:1] else replace(p, path=(*path, "calculix"), cure="mend that line of the deck")
                          for p in error.problems]) from error


def _joints(part: DeckPart, path: KeyPath, name: str) -> Joints:
    deck = Deck(Path(part.calculix), (*path, "calculix"), part.nonlinear)
    for i, file in enumerate(part.loads or []):
        check_loads(Path(file), (*path, "loads", i), part.nonlinear)
    check_kept([Path(file) for file in part.loads or []], (*path, "loads"))
    members = [deck.nodes_of(joint, (*path, "joints", i)) for i, joint in enumerate(part.joints)]
    ids = np.unique(np.concatenate(members))
    points = deck.places(ids)
    faces, joint, remarks = [], [], []
    for i, own in enumerate(members):
        tables = deck.faces_between(own)
        if not any(len(table) for table in tables):
            raise InputError(Problem((*path, "joints", i), f"the node set {part.joints[i]} of '{name}' holds no face of an element",
                                     "all nodes of the faces that the part meets others on, those in the middle of edges too",
                                     "put every node of those faces in the set"))
        faces.append([np.searchsorted(ids, table) for table in tables])
        joint.append([np.full(len(table), i) for table in tables])
        remarks += forgotten(deck.outer_faces, own, deck.ids, deck.points, f"joint {part.joints[i]} of '{name}'")
    flat = [table for tables in faces for table in tables]
    triangles, owner, face = cut_in_triangles(flat, points, path, f"'{name}'")
    for kind, options, rows in deck.cards:
        if kind == "TRANSFORM" and np.isin(ids, deck.nodes_of(options.get("NSET", ""), path)).any():
            rows[0].fail(f"*TRANSFORM on nodes of a joint of '{name}': forces would be turned and displacements not",
                         "joint nodes in the mesh's own axes")
    held, left = deck.supports(ids, points, [Path(file) for file in part.loads or []])
    if part.held != "auto":
        left = np.zeros((6, 0)) if part.held else np.eye(6)
    return Joints(ids, points, triangles, np.concatenate([j for own in joint for j in own])[owner], list(part.joints), held, left,
                  any(table.shape[1] in (6, 8) for table in flat), face, remarks, *deck.moduli())


def _solid(kind: str, row: Row) -> tuple[str, int] | None:
    if not kind.startswith("C3D"):
        return None
    if (count := solid_nodes(kind)) not in SHAPES:
        row.fail(f"solid elements of type {kind[:12]}", "C3D4, C3D6, C3D8, C3D10, C3D15 or C3D20")
    return SHAPES[count], count


class Deck(Model):
    """What of a deck is read.

    file : the deck
    path : of its key in the YAML
    nonlinear : whether its matter may flow
    """

    def __init__(self, file: Path, path: KeyPath, nonlinear: bool = False):
        self.path, self.file = path, file
        check_deck(file, path, nonlinear)
        try:
            self.cards = cards_of_a_model(file)
        except InputError as error:
            raise InputError([Problem(path, p.found, p.expected, "mend the deck") for p in error.problems]) from error
        super().__init__(self.cards, _solid, ["NSET"])
        if not len(self.nodes):
            raise InputError(Problem(path, f"{file}: no nodes", "*NODE with number, x, y, z",
                                     "name the file that has the nodes, or that includes it"))
        ids = self.nodes[::-1, 0].astype(int)
        self.ids, last = np.unique(ids, return_index=True)  # CalculiX takes the last
        self.points = self.nodes[::-1][last, 1:]

    def nodes_of(self, name: str, path: KeyPath) -> np.ndarray:
        """Numbers of a node set's nodes, ascending."""
        if (members := self.named("NSET", name)) is None:
            raise InputError(Problem(path, f"{self.file}: no node set {name}", "a set of *NSET: " + (", ".join(self.sets["NSET"]) or "there is none"),
                                     f"add *NSET, NSET={name} with the nodes of the joint"))
        return members

    def places(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where nodes are."""
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        if (self.ids[at] != ids).any():
            raise InputError(Problem(self.path, f"{self.file}: node {ids[self.ids[at] != ids][0]} of a joint is not there", "nodes that "
                                     "*NODE gives", "mend the node set"))
        return self.points[at]

    def faces_between(self, ids: np.ndarray) -> list[np.ndarray]:
        """Those of the outer faces whose nodes are all among the given ones."""
        return [outer[np.isin(outer, ids).all(axis=1)] for outer in self.outer_faces]

    @cached_property
    def outer_faces(self) -> list[np.ndarray]:
        """Tables (f, 3, 4, 6 or 8) of the outer faces of solid elements, by number of nodes."""
        found: dict[int, list[np.ndarray]] = {}
        for table in self.blocks.values():
            size = table.shape[1] - 1
            for corners in _CORNERS[size]:
                middles = _EDGES.get(size)
                own = corners + [middles[tuple(sorted(e))] for e in zip(corners, corners[1:] + corners[:1])] if middles else corners
                found.setdefault(len(own), []).append(table[:, 1:][:, own])
        return [outer(np.concatenate(tables)) for _, tables in sorted(found.items())]

    def solids(self) -> list[tuple[str, np.ndarray]]:
        """Solid elements by meshio's names, nodes as places in ``ids``; nodes of both programs come in the same order."""
        return [(shape, np.searchsorted(self.ids, self.blocks[shape][:, 1:])) for shape in SHAPES.values() if shape in self.blocks]

    def supports(self, ids: np.ndarray, points: np.ndarray, loads: list[Path]) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) bool, components of joint nodes that are held, and the rigid motions (6, r) that all supports leave.

        Raises InputError: loads that hold what the deck does not, or move what it holds on a joint
        """
        fixed = np.zeros((len(self.ids), 3), dtype=bool)
        for _, at, components in self._held(self.cards):
            fixed[np.ix_(at, components)] = True
        for file in loads:
            for row, at, components in self._held(cards(file)):
                if not fixed[np.ix_(at, components)].all():
                    row.fail("*BOUNDARY in the loads on dofs that the deck leaves free: its stiffness would be another",
                             "supports in the deck; loads may move what the deck holds")
                if np.isin(self.ids[at], ids).any():
                    row.fail("*BOUNDARY in the loads on nodes of a joint", "joint nodes that other parts move, or the deck holds")
        return fixed[np.searchsorted(self.ids, ids)], supports_left(points, self.points, fixed)

    def _held(self, given: Iterable[tuple[str, dict[str, str], list[Row]]]) -> Iterator[tuple[Row, np.ndarray, list[int]]]:
        """Lines of *BOUNDARY, with the nodes that they hold, as places in ``ids``, and components."""
        for card, _, rows in given:
            for row in rows if card == "BOUNDARY" else ():
                words = row.words
                nodes = self.named("NSET", words[0])
                nodes = np.array([row.integer(words[0])]) if nodes is None else nodes
                first = row.integer(words[1])
                last = row.integer(words[2]) if len(words) > 2 and words[2] else first
                yield row, np.flatnonzero(np.isin(self.ids, nodes)), [c - 1 for c in range(max(first, 1), min(last, 3) + 1)]

    def moduli(self) -> tuple[float, float] | tuple[None, float]:
        """A representative modulus and ratio: those of the first material, means of directions where it has several."""
        for card, options, rows in self.cards:
            if card == "ELASTIC":
                values, kind = numbers(rows), options.get("TYPE", "ISO").upper()
                if kind.startswith("ENGINEERING") and len(values) >= 9:
                    return float(values[:3].mean()), float(min(0.45, np.abs(values[3:6]).mean()))
                if kind.startswith("ORTHO") and len(values) >= 9:
                    # of isotropic matter of ratio .3, E is .74 of the stiffness with all other strains prevented
                    return float(0.74 * values[[0, 2, 5]].mean()), 0.3
                if kind.startswith("ISO") and len(values) >= 2:
                    return float(values[0]), float(min(values[1], 0.49))
        return None, 0.3


SMOOTH = 0.5  # cosine between normals of faces, up to which edges are none: those of a bore of six facets count as smooth
NAMED = 6  # nodes


def forgotten(faces: list[np.ndarray], own: np.ndarray, ids: np.ndarray, points: np.ndarray, name: str) -> list[str]:
    """A sentence on nodes that seem to be forgotten, or none.

    faces : tables (f, 3, 4, 6 or 8), numbers of nodes of all outer faces, corners first
    own : numbers of the set's nodes
    ids : (n,) ascending, points : (n, 3), all nodes
    name : of the joint
    """
    count = [4 if table.shape[1] in (4, 8) else 3 for table in faces]
    corners = np.concatenate([table[:, np.arange(4) % c] for table, c in zip(faces, count)])  # a triangle's first corner comes twice
    quad = np.repeat([c == 4 for c in count], [len(table) for table in faces])
    inside = np.isin(corners, own)
    out = (~inside).sum(axis=1) - (~quad & ~inside[:, 0])
    whole = np.concatenate([np.isin(table, own).all(axis=1) for table in faces])
    x = points[np.searchsorted(ids, corners)]
    normal = np.cross(x[:, 2] - x[:, 0], np.where(quad[:, None], x[:, 3], x[:, 2]) - x[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    beside = _smooth(corners, quad, normal, np.flatnonzero(~whole & (out <= 1)), np.flatnonzero(whole), 2)
    lacks = np.unique(beside[0])
    single = lacks[out[lacks] == 1]
    missing = corners[single, (~inside[single]).argmax(axis=1)]
    around, others = _smooth(np.where(inside, -1, corners), quad, normal, single, np.flatnonzero(out > 0), 1)
    keep = ~np.isin(single, around[out[others] > 1])  # no face beyond the joint's end
    # where nodes in the middle of edges are missing too, that may be a corner left out on purpose, unless faces are all round it
    alone = np.concatenate([(~np.isin(table, own)).sum(axis=1) for table in faces])[single] == 1
    keep &= alone | (_count(missing, missing) == _count(np.concatenate([table[:, :c].ravel() for table, c in zip(faces, count)]), missing))
    nodes, faces_told = [missing[keep]], int(keep.sum())
    for table, at in zip(faces, np.split(np.arange(len(corners)), np.cumsum([len(table) for table in faces])[:-1])):
        of_edges = table[np.isin(at, lacks[out[lacks] == 0])]
        nodes.append(of_edges[~np.isin(of_edges, own)])
        faces_told += len(of_edges)
    lost = np.unique(np.concatenate(nodes)).tolist()
    if not lost:
        return []
    named = ", ".join(map(str, lost[:NAMED])) + (" …" if len(lost) > NAMED else "")
    return [f"{name}: faces beside its own, {faces_told} of them, have all other nodes in its set, but not {named}: are these forgotten?"]


def _count(among: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """How often each of the nodes is among others."""
    ordered = np.sort(among)
    return np.searchsorted(ordered, nodes, "right") - np.searchsorted(ordered, nodes)


def _smooth(corners: np.ndarray, quad: np.ndarray, normal: np.ndarray, first: np.ndarray, second: np.ndarray,
            least: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces, of the first and the second, that share so many corners (-1: none) at least and no edge is between."""
    place = np.unique(corners, return_inverse=True)[1].reshape(corners.shape)
    valid = corners >= 0
    valid[:, 3] &= quad
    row, column = np.nonzero(valid)
    table = sp.csr_array((np.ones(len(row)), (row, place[row, column])), shape=(len(corners), int(place.max(initial=0)) + 1))
    shared = (table[first] @ table[second].T).tocoo()
    a, b = first[shared.row], second[shared.col]
    good = (shared.data >= least) & (np.einsum("ij,ij->i", normal[a], normal[b]) > SMOOTH)
    return a[good], b[good]
