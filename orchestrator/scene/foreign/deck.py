"""The joints of a CalculiX deck: node sets, and the elements' faces whose nodes are all in one of them.

Nothing else of the deck is looked at but where it is supported, its first moduli, and its cards, see ``deck_cards``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from orchestrator.config.mesh import DeckPart
from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.scene.foreign.deck_cards import check_cards, check_kept
from orchestrator.scene.foreign.flat import forgotten
from orchestrator.scene.foreign.joints import Joints, cut_in_triangles, supports_left
from orchestrator.scene.mesh.inp import SOLIDS, solid_nodes
from orchestrator.scene.mesh.inp_cards import Model, Row, cards, cards_of_a_model, numbers, outer
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
        check_cards(Path(file), (*path, "loads", i), part.nonlinear, loads=True)
    check_kept([Path(file) for file in part.loads or []], (*path, "loads"))
    members = [deck.nodes_of(joint, (*path, "joints", i)) for i, joint in enumerate(part.joints)]
    ids = np.unique(np.concatenate(members))
    points = deck.places(ids)
    faces, joint, remarks = [], [], []
    for i, own in enumerate(members):
        tables = [outer[np.isin(outer, own).all(axis=1)] for outer in deck.outer_faces]
        if not any(len(table) for table in tables):
            raise wrong((*path, "joints", i), f"the node set {part.joints[i]} of '{name}' holds no face of an element",
                        "all nodes of the faces that the part meets others on, those in the middle of edges too",
                        "put every node of those faces in the set")
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
    """Contents of a deck, as far as they are read.

    file : the deck
    path : of its key in the YAML
    nonlinear : whether its matter may flow
    """

    def __init__(self, file: Path, path: KeyPath, nonlinear: bool = False):
        self.path, self.file = path, file
        check_cards(file, path, nonlinear)
        self.cards = cards_of_a_model(file)
        super().__init__(self.cards, _solid, ["NSET"])
        if not len(self.nodes):
            raise wrong(path, f"{file}: no nodes", "*NODE with number, x, y, z", "name the file that has the nodes, or that includes it")
        ids = self.nodes[::-1, 0].astype(int)
        self.ids, last = np.unique(ids, return_index=True)  # CalculiX takes the last
        self.points = self.nodes[::-1][last, 1:]

    def nodes_of(self, name: str, path: KeyPath) -> np.ndarray:
        """Numbers of a node set's nodes, ascending."""
        if (members := self.named("NSET", name)) is None:
            raise wrong(path, f"{self.file}: no node set {name}", "a set of *NSET: " + (", ".join(self.sets["NSET"]) or "there is none"),
                        f"add *NSET, NSET={name} with the nodes of the joint")
        return members

    def places(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where nodes are."""
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        if (self.ids[at] != ids).any():
            raise wrong(self.path, f"{self.file}: node {ids[self.ids[at] != ids][0]} of a joint is not there", "nodes that "
                        "*NODE gives", "mend the node set")
        return self.points[at]

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
