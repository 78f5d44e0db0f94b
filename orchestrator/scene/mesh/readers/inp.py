"""CalculiX's and Abaqus's .inp files: nodes, elements and the sets that have names.

Element sets name volumes and shells, element surfaces (S1 … S6) and node sets name boundary faces:
of a node set those that have all their corners in it. Everything else of a deck (matter, steps,
equations) is left to where it belongs.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import meshio
import numpy as np

from orchestrator.scene.mesh.readers.inp_cards import (
    Card, cards_of_a_model, PER_SCOPE, problem, CardLine)
from orchestrator.scene.mesh.readers.inp_model import InpModel, outer, place
from orchestrator.scene.mesh.readers.splitting import SIDES

# meshio's words of solid elements, by number of nodes
SOLIDS = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15",
          20: "hexahedron20"}
_FLAT = {"3": ("triangle", 3), "6": ("triangle6", 6), "4": ("quad", 4), "8": ("quad8", 8),
         "9": ("quad9", 9)}
_LINES = {"B31": ("line", 2), "T3D2": ("line", 2), "B32": ("line3", 3), "T3D3": ("line3", 3)}
# names of faces that solids have not
_OF_SHELLS = re.compile("SPOS|SNEG|(E|EDGE|END|ENDS)[1-4]?|N")
_NONE = np.empty(0, dtype=int)
_NO_NODE = -1  # fourth node of a triangle


def read_inp(path: Path) -> meshio.Mesh:
    """The mesh as meshio would have it, surfaces as triangles.

    Raises InputError: a line that cannot be read, told with its file and number; a file included
    that is not there
    """
    cards = cards_of_a_model(path)
    for card, _, rows in cards:
        if card in ("SYSTEM", "INSTANCE"):
            rows[0].fail(f"*{card}, which moves nodes",
                         "nodes in one system of coordinates, where they are")
    scopes = [rows[0].scope for *_, rows in cards]
    if any(scope.placed for scope in scopes):  # parts without an instance are not in the model
        cards = [card for card, own in zip(cards, scopes) if own.placed or not own.start]
    return _Mesh(cards).mesh()


class _Mesh(InpModel):
    """A model with its surfaces.

    surfaces : name → (element or set, face, where it says so)
    passed : surfaces with faces of shells, and where the first of them is
    """

    def __init__(self, cards: list[Card]):
        super().__init__(cards, _shape)
        self._cards = cards
        self.surfaces: dict[str, list[tuple[str, int, CardLine]]] = {}
        self.passed: dict[str, str] = {}
        own, serving = _upper(cards, "ELEMENT"), set()
        sections = {key for kind in {card for card, *_ in cards} if kind.endswith("SECTION")
                    for key in _upper(cards, kind)}
        for card, options, rows in cards:
            prefix = rows[0].scope.prefix
            name = options.get("ELSET", "")
            if card == "ELSET" and ("INTERNAL" in options or name.startswith("_")):
                serving.add((prefix + name).upper())
            if card != "SURFACE" or options.get("TYPE", "ELEMENT").upper() != "ELEMENT":
                continue
            name = prefix + options.get("NAME", "")
            faces = self.surfaces.setdefault(name, [])
            for row in rows:
                side = row.words[1].upper() if len(row.words) > 1 else ""
                if _OF_SHELLS.fullmatch(side):
                    self.passed.setdefault(name, f"{row.file}:{row.line}: a face {side}")
                elif side not in ("S1", "S2", "S3", "S4", "S5", "S6"):
                    row.fail("a face that is not named so",
                             "S1 … S4 of a tetrahedron, up to S6 of a hexahedron")
                else:
                    word = row.words[0]
                    if not word.isdigit() and self.named("ELSET", prefix + word) is not None:
                        word = prefix + word
                    faces.append((word, int(side[1]) - 1, row))
                    serving.add(word.upper())
        # sets that serve surfaces or the program that wrote the file
        self.aside = serving - own - sections

    def mesh(self) -> meshio.Mesh:
        """The file as a mesh, with its elements' groups."""
        self._check_once()
        ids, blocks = self.nodes[:, 0].astype(int), {}
        numbers = {kind: table[:, 0] for kind, table in self.blocks.items()}
        for kind, table in self.blocks.items():
            blocks[kind] = place(ids, table[:, 1:])
            if (blocks[kind] < 0).any():
                lost = table[:, 1:][blocks[kind] < 0][0] % PER_SCOPE
                raise problem("", f"an element has node {lost}, which is not there",
                              "the nodes of every element")
        # of each block the places of its elements in each group
        cells: list[tuple[str, np.ndarray, dict[str, np.ndarray]]] = []
        for kind, table in blocks.items():
            scope = numbers[kind] // PER_SCOPE * PER_SCOPE
            cells.append((kind, table, {
                **{own.name: np.flatnonzero(scope == own.start)
                   for own in self.scopes.values() if own.start},
                **{name: np.flatnonzero(np.isin(numbers[kind], members))
                   for name, members in self._volumes().items()}}))
        for name, faces in self._faces(blocks, numbers, ids).items():
            for kind, width in (("triangle", 3), ("quad", 4)):
                of_kind = faces[(faces[:, 3] == _NO_NODE) == (width == 3), :width]
                # A surface that holds nothing is there, empty.
                if len(of_kind) or (kind == "triangle" and not len(faces)):
                    cells.append((kind, of_kind, {name: np.arange(len(of_kind))}))
        prefixes = [scope.prefix for scope in self.scopes.values() if scope.start]
        short = {name: next((name[len(p):] for p in prefixes if name.startswith(p)), name)
                 for *_, groups in cells for name in groups}
        count = Counter(name.upper() for name in short.values())  # of several with their instance
        named = {brief if count[brief.upper()] == 1 else name:
                 [groups.get(name, _NONE) for *_, groups in cells]
                 for name, brief in short.items()}
        return meshio.Mesh(self.nodes[:, 1:], [(kind, table) for kind, table, _ in cells],
                           cell_sets=named, info={"remarks": [
            f"surface '{name}' is passed over: {where}, of shells or beams"
            for name, where in self.passed.items()]})

    def _faces(self, blocks: dict[str, np.ndarray], numbers: dict[str, np.ndarray],
               node_ids: np.ndarray) -> dict[str, np.ndarray]:
        """Corners (f, 4) of the faces of each surface and node set, of triangles with _NO_NODE as
        the fourth.
        """
        solids = [(kind, shape) for kind in blocks for shape in SIDES
                  if kind.rstrip("0123456789") == shape]
        if not solids:
            return {}
        ids = np.concatenate([numbers[kind] for kind, _ in solids])
        table, start = np.full((len(ids), 6, 4), _NO_NODE), 0
        for kind, shape in solids:
            rows = slice(start, start := start + len(blocks[kind]))
            for side, corners in enumerate(SIDES[shape]):
                table[rows, side, : len(corners)] = blocks[kind][:, corners]
        there, found = table[:, :, 0] != _NO_NODE, {}
        table = _without_repeats(table)
        for name, entries in self.surfaces.items():
            if name in self.passed:
                continue
            chosen = [np.empty((0, 4), dtype=int)]
            for word, side, row in entries:
                members = self.named("ELSET", word)
                if members is None:
                    members = np.array([int(word) + row.scope.start]) if word.isdigit() else _NONE
                at = place(ids, members)
                at = at[at >= 0]
                if not there[at, side].all():
                    row.fail(f"a face S{side + 1} of an element that has fewer",
                             "S1 … S4 of a tetrahedron, … S5 of a prism, … S6 of a hexahedron")
                chosen.append(table[at, side])
            found[name] = np.concatenate(chosen)
            found[name] = found[name][found[name][:, 0] != _NO_NODE]
        skin = outer(table[table[:, :, 0] != _NO_NODE])
        inside = np.zeros(len(node_ids) + 1, dtype=bool)
        for name, members in self.sets["NSET"].items():
            if name and name not in found and not self._is_volume(name):
                at = place(node_ids, members)
                inside[:] = False
                inside[at[at >= 0]] = True
                inside[_NO_NODE] = True
                chosen = skin[inside[skin].all(axis=1)]
                if len(chosen):
                    found[name] = chosen
        return found

    def _volumes(self) -> dict[str, np.ndarray]:
        """Return the element sets that name volumes: not those that serve surfaces, nor the
        elements beside a node set of the same name."""
        return {name: members for name, members in self.sets["ELSET"].items()
                if name and name.upper() not in self.aside
                and (self.named("NSET", name) is None or self._is_volume(name))}

    def _is_volume(self, name: str) -> bool:
        """Return whether an element set of this name has no nodes but those of a node set that is
        called so: both stand for a body; else for a face and the elements beside it."""
        elements, nodes = self.named("ELSET", name), self.named("NSET", name)
        return elements is not None and nodes is not None and all(
            np.isin(table[np.isin(table[:, 0], elements), 1:], nodes).all()
            for table in self.blocks.values())

    def _check_once(self) -> None:
        """Raises InputError for two nodes at different places, or two elements, of one number."""
        nodes = self.nodes[np.argsort(self.nodes[:, 0], kind="stable")]
        elements = np.concatenate([_NONE, *(table[:, 0] for table in self.blocks.values())])
        step = np.diff(nodes, axis=0)
        same = (step[:, 0] == 0) & (step[:, 1:] != 0).any(axis=1)
        numbers, count = np.unique(elements, return_counts=True)
        for card, twice in (("NODE", nodes[1:][same, 0]), ("ELEMENT", numbers[count > 1])):
            lines = [row for own, _, rows in self._cards if own == card for row in rows]
            for row in reversed(lines if len(twice) else []):
                if row.words[0] == str(int(twice[0]) - row.scope.start):
                    row.fail(f"{card.lower()} {row.words[0]} a second time",
                             "each once; *PART and *INSTANCE have numbers of their own")


def _without_repeats(faces: np.ndarray) -> np.ndarray:
    """Return faces (m, 6, 4) of collapsed elements by their corners: quads with one given twice
    are triangles, and what has two corners none."""
    again = np.stack([(faces[..., :k] == faces[..., k, None]).any(axis=-1) for k in range(4)], -1)
    first = np.argsort(again, axis=-1, kind="stable")
    kept = np.take_along_axis(np.where(again, _NO_NODE, faces), first, axis=-1)
    return np.where((kept[..., 2] == _NO_NODE)[..., None], _NO_NODE, kept)


def _upper(cards: list[Card], card: str) -> set[str]:
    """Names of the element sets that cards of a keyword have, in capitals."""
    return {(rows[0].scope.prefix + options.get("ELSET", "")).upper()
            for own, options, rows in cards if own == card}


def _shape(kind: str, row: CardLine) -> tuple[str, int]:
    if (count := solid_nodes(kind)) in SOLIDS:
        return SOLIDS[count], count
    if kind in _LINES:
        return _LINES[kind]
    for head in ("STRI", "CPS", "CPE", "CAX", "M3D", "S"):
        if kind.startswith(head) and kind[len(head):len(head) + 1] in _FLAT:
            return _FLAT[kind[len(head)]]
    row.fail(f"elements of type {kind[:12] or '(none)'}",
             "C3D4, C3D10 or others of 5, 6, 8, 15 or 20 nodes, and shells or beams that are "
             "passed over")


def solid_nodes(kind: str) -> int:
    """Number of nodes of an element type by its name, C3D8R or the like; 0: they are no solids."""
    return int("".join(c for c in kind[3:] if c.isdigit()) or 0) if kind.startswith("C3D") else 0
