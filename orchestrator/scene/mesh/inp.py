"""CalculiX's and Abaqus's .inp files: nodes, elements and the sets that have names.

Element sets name volumes and shells, element surfaces (S1 … S6) and node sets name boundary faces: of a node set
those that have all their corners in it. Everything else of a deck (matter, steps, equations) is left to where it belongs.
"""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np

from orchestrator.scene.mesh.inp_cards import Row, cards_of_a_model, node_table, numbers, problem

# type of element → meshio's word, nodes
_SHAPES = {4: ("tetra", 4), 10: ("tetra10", 10), 5: ("pyramid", 5), 6: ("wedge", 6), 15: ("wedge15", 15), 8: ("hexahedron", 8), 20: ("hexahedron20", 20)}
_FLAT = {"3": ("triangle", 3), "6": ("triangle6", 6), "4": ("quad", 4), "8": ("quad8", 8), "9": ("quad9", 9)}
_LINES = {"B31": ("line", 2), "T3D2": ("line", 2), "B32": ("line3", 3), "T3D3": ("line3", 3)}
# S1, S2, … of each shape
_FACES = {"tetra": [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]],
          "hexahedron": [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]],
          "wedge": [[0, 1, 2], [3, 5, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]],
          "pyramid": [[0, 1, 2, 3], [0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]]}
_OF_SHELLS = re.compile("SPOS|SNEG|(E|EDGE|END|ENDS)[1-4]?|N")  # names of faces that solids have not
_NONE = np.empty(0, dtype=int)
_NO_NODE = -1  # fourth node of a triangle


def read_inp(path: Path) -> meshio.Mesh:
    """The mesh as meshio would have it, surfaces as triangles.

    Raises
    ------
    InputError : a line that cannot be read, told with its file and number; a file included that is not there
    """
    deck = _Deck()
    for card, options, rows in cards_of_a_model(path):
        deck.take(card, options, rows)
    return deck.mesh()


class _Deck:
    """What has been read so far."""

    def __init__(self) -> None:
        self.nodes: list[np.ndarray] = []
        self.blocks: dict[str, list[np.ndarray]] = {}
        self.numbers: dict[str, list[np.ndarray]] = {}
        self.elements: dict[str, list[np.ndarray]] = {}  # sets, by name
        self.points: dict[str, list[np.ndarray]] = {}
        self.passed: dict[str, str] = {}  # surfaces with faces of shells, and where the first of them is
        self.surfaces: dict[str, list[tuple[str, int, Row]]] = {}  # (element or set, face, where it says so)

    def take(self, card: str, options: dict[str, str], rows: list[Row]) -> None:
        """One card with its lines."""
        if card == "NODE":
            table = node_table(options, rows)
            self.nodes.append(table)
            if "NSET" in options:
                self.points.setdefault(options["NSET"], []).append(table[:, 0].astype(int))
        elif card == "ELEMENT":
            self._elements(options, rows)
        elif card in ("ELSET", "NSET"):
            sets = self.elements if card == "ELSET" else self.points
            sets.setdefault(options.get(card, ""), []).append(self._members(sets, options, rows))
        elif card in ("SYSTEM", "INSTANCE"):
            rows[0].fail(f"*{card}, which moves nodes", "nodes in one system of coordinates, where they are")
        elif card == "SURFACE" and options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
            faces = self.surfaces.setdefault(options.get("NAME", ""), [])
            for row in rows:
                side = row.words[1].upper() if len(row.words) > 1 else ""
                if _OF_SHELLS.fullmatch(side):
                    self.passed.setdefault(options.get("NAME", ""), f"{row.file}:{row.line}: a face {side}")
                    continue
                if side not in ("S1", "S2", "S3", "S4", "S5", "S6"):
                    row.fail("a face that is not named so", "S1 … S4 of a tetrahedron, up to S6 of a hexahedron")
                faces.append((row.words[0], int(side[1]) - 1, row))

    def _elements(self, options: dict[str, str], rows: list[Row]) -> None:
        kind, count = _shape(options.get("TYPE", ""), rows)
        table = numbers(rows).astype(int)
        if len(table) % (count + 1):
            rows[0].fail(f"{len(table)} numbers for elements of {count} nodes", f"a number and {count} nodes for each")
        table = table.reshape(-1, count + 1)
        self.blocks.setdefault(kind, []).append(table[:, 1:])
        self.numbers.setdefault(kind, []).append(table[:, 0])
        if "ELSET" in options:
            self.elements.setdefault(options["ELSET"], []).append(table[:, 0])

    @staticmethod
    def _members(sets: dict[str, list[np.ndarray]], options: dict[str, str], rows: list[Row]) -> np.ndarray:
        found: list[np.ndarray] = [np.empty(0, dtype=int)]
        for row in rows:
            if "GENERATE" in options:
                first, last, *step = row.integers()
                found.append(np.arange(first, last + 1, *step))
                continue
            for word in row.words:
                name = next((n for n in sets if n.upper() == word.upper()), None)
                found += sets[name] if name else [np.array([row.integer(word)])]
        return np.concatenate(found)

    def mesh(self) -> meshio.Mesh:
        """All of it."""
        nodes = np.vstack([np.empty((0, 4)), *self.nodes])
        ids = nodes[:, 0].astype(int)
        place = np.full(int(ids.max(initial=0)) + 2, -1)
        place[ids] = np.arange(len(ids))
        blocks = {kind: np.vstack(tables) for kind, tables in self.blocks.items()}
        for kind, table in blocks.items():
            unknown = table[(place[np.clip(table, 0, len(place) - 1)] < 0)]
            if len(unknown):
                raise problem("", f"an element has node {unknown[0]}, which is not there", "the nodes of every element")
            blocks[kind] = place[table]
        numbers = {kind: np.concatenate(parts) for kind, parts in self.numbers.items()}
        sets = {name: np.unique(np.concatenate(parts)) for name, parts in self.elements.items() if name}
        cells = [meshio.CellBlock(kind, table) for kind, table in blocks.items()]
        named = {name: [np.flatnonzero(np.isin(numbers[kind], members)) for kind in blocks] for name, members in sets.items()}
        for name, faces in self._faces(blocks, numbers, sets, place).items():
            for kind, width in (("triangle", 3), ("quad", 4)):
                of_kind = faces[(faces[:, 3] == _NO_NODE) == (width == 3), :width]
                # A surface that holds nothing is there, empty.
                if len(of_kind) or (kind == "triangle" and not len(faces)):
                    cells.append(meshio.CellBlock(kind, of_kind))
                    named.setdefault(name, []).extend([_NONE] * (len(cells) - 1 - len(named.get(name, []))))
                    named[name].append(np.arange(len(of_kind)))
        for members in named.values():
            members += [_NONE] * (len(cells) - len(members))
        return meshio.Mesh(nodes[:, 1:], cells, cell_sets=named, info={"remarks": [
            f"surface '{name}' is passed over: {where}, of shells or beams" for name, where in self.passed.items()]})

    def _faces(self, blocks: dict[str, np.ndarray], numbers: dict[str, np.ndarray], sets: dict[str, np.ndarray],
               place: np.ndarray) -> dict[str, np.ndarray]:
        """Corners (f, 4) of the faces of each surface and node set, of triangles with _NO_NODE as the fourth."""
        solids = [(kind, shape) for kind in blocks for shape in _FACES if kind.rstrip("0123456789") == shape]
        if not solids:
            return {}
        table, ids = np.full((sum(len(blocks[k]) for k, _ in solids), 6, 4), _NO_NODE), np.concatenate([numbers[k] for k, _ in solids])
        there, start = np.zeros(table.shape[:2], dtype=bool), 0
        for kind, shape in solids:
            rows = slice(start, start := start + len(blocks[kind]))
            for side, corners in enumerate(_FACES[shape]):
                table[rows, side, : len(corners)] = blocks[kind][:, corners]
                there[rows, side] = True
        order = np.argsort(ids)
        upper, found = {name.upper(): members for name, members in sets.items()}, {}
        for name, entries in self.surfaces.items():
            if name in self.passed:
                continue
            chosen = [np.empty((0, 4), dtype=int)]
            for word, side, row in entries:
                members = upper.get(word.upper(), np.array([int(word)]) if word.isdigit() else np.empty(0, dtype=int))
                at = order[np.clip(np.searchsorted(ids[order], members), 0, len(ids) - 1)]
                at = at[ids[at] == members]
                if not there[at, side].all():
                    row.fail(f"a face S{side + 1} of an element that has fewer", "S1 … S4 of a tetrahedron, … S5 of a prism, … S6 of a hexahedron")
                chosen.append(table[at, side])
            found[name] = np.concatenate(chosen)
        every = table[there]
        _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
        outer = every[first[count == 1]]
        for name, parts in self.points.items():
            if not name or name in found or name in sets:
                continue
            inside = np.zeros(int(place.max(initial=0)) + 2, dtype=bool)
            inside[_NO_NODE] = True
            members = np.unique(np.concatenate(parts))
            members = place[members[(members >= 0) & (members < len(place))]]
            inside[members[members >= 0]] = True
            chosen = outer[inside[outer].all(axis=1)]
            if len(chosen):
                found[name] = chosen
        return found


def _shape(word: str, rows: list[Row]) -> tuple[str, int]:
    kind = word.upper()
    digits = "".join(c for c in kind[3:] if c.isdigit()) if kind.startswith("C3D") else ""
    if digits and int(digits) in _SHAPES:
        return _SHAPES[int(digits)]
    if kind in _LINES:
        return _LINES[kind]
    for head in ("STRI", "CPS", "CPE", "CAX", "M3D", "S"):
        if kind.startswith(head) and kind[len(head):len(head) + 1] in _FLAT:
            return _FLAT[kind[len(head)]]
    rows[0].fail(f"elements of type {word[:12] or '(none)'}", "C3D4, C3D10 or others of 5, 6, 8, 15 or 20 nodes, and shells or beams that are passed over")
