"""CalculiX's and Abaqus's .inp files: nodes, elements and the sets that have names.

Element sets name volumes and shells, element surfaces (S1 … S6) and node sets name boundary faces: of a node set
those that have all their corners in it. Everything else of a deck (matter, steps, equations) is left to where it belongs.
"""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np

from orchestrator.scene.mesh.inp_cards import Card, Model, Row, cards_of_a_model, outer, problem
from orchestrator.scene.mesh.splitting import SIDES

# meshio's words of solid elements, by number of nodes
SOLIDS = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"}
_FLAT = {"3": ("triangle", 3), "6": ("triangle6", 6), "4": ("quad", 4), "8": ("quad8", 8), "9": ("quad9", 9)}
_LINES = {"B31": ("line", 2), "T3D2": ("line", 2), "B32": ("line3", 3), "T3D3": ("line3", 3)}
_OF_SHELLS = re.compile("SPOS|SNEG|(E|EDGE|END|ENDS)[1-4]?|N")  # names of faces that solids have not
_NONE = np.empty(0, dtype=int)
_NO_NODE = -1  # fourth node of a triangle


def read_inp(path: Path) -> meshio.Mesh:
    """The mesh as meshio would have it, surfaces as triangles.

    Raises InputError: a line that cannot be read, told with its file and number; a file included that is not there
    """
    cards = cards_of_a_model(path)
    for card, _, rows in cards:
        if card in ("SYSTEM", "INSTANCE"):
            rows[0].fail(f"*{card}, which moves nodes", "nodes in one system of coordinates, where they are")
    return _Mesh(cards).mesh()


class _Mesh(Model):
    """A model with its surfaces.

    surfaces : name → (element or set, face, where it says so)
    passed : surfaces with faces of shells, and where the first of them is
    """

    def __init__(self, cards: list[Card]):
        super().__init__(cards, _shape)
        self.surfaces: dict[str, list[tuple[str, int, Row]]] = {}
        self.passed: dict[str, str] = {}
        for card, options, rows in cards:
            if card != "SURFACE" or options.get("TYPE", "ELEMENT").upper() != "ELEMENT":
                continue
            name = options.get("NAME", "")
            faces = self.surfaces.setdefault(name, [])
            for row in rows:
                side = row.words[1].upper() if len(row.words) > 1 else ""
                if _OF_SHELLS.fullmatch(side):
                    self.passed.setdefault(name, f"{row.file}:{row.line}: a face {side}")
                elif side not in ("S1", "S2", "S3", "S4", "S5", "S6"):
                    row.fail("a face that is not named so", "S1 … S4 of a tetrahedron, up to S6 of a hexahedron")
                else:
                    faces.append((row.words[0], int(side[1]) - 1, row))

    def mesh(self) -> meshio.Mesh:
        """The file as a mesh, with its elements' groups."""
        ids = self.nodes[:, 0].astype(int)
        place = np.full(int(ids.max(initial=0)) + 2, -1)
        place[ids] = np.arange(len(ids))
        blocks, numbers = {}, {kind: table[:, 0] for kind, table in self.blocks.items()}
        for kind, table in self.blocks.items():
            blocks[kind] = place[np.clip(table[:, 1:], 0, len(place) - 1)]
            if (blocks[kind] < 0).any():
                raise problem("", f"an element has node {table[:, 1:][blocks[kind] < 0][0]}, which is not there",
                              "the nodes of every element")
        cells = [meshio.CellBlock(kind, table) for kind, table in blocks.items()]
        named = {name: [np.flatnonzero(np.isin(numbers[kind], members)) for kind in blocks] for name, members in self.sets["ELSET"].items()
                 if name}
        for name, faces in self._faces(blocks, numbers, place).items():
            for kind, width in (("triangle", 3), ("quad", 4)):
                of_kind = faces[(faces[:, 3] == _NO_NODE) == (width == 3), :width]
                # A surface that holds nothing is there, empty.
                if len(of_kind) or (kind == "triangle" and not len(faces)):
                    cells.append(meshio.CellBlock(kind, of_kind))
                    named.setdefault(name, []).extend([_NONE] * (len(cells) - 1 - len(named.get(name, []))))
                    named[name].append(np.arange(len(of_kind)))
        for members in named.values():
            members += [_NONE] * (len(cells) - len(members))
        return meshio.Mesh(self.nodes[:, 1:], cells, cell_sets=named, info={"remarks": [
            f"surface '{name}' is passed over: {where}, of shells or beams" for name, where in self.passed.items()]})

    def _faces(self, blocks: dict[str, np.ndarray], numbers: dict[str, np.ndarray], place: np.ndarray) -> dict[str, np.ndarray]:
        """Corners (f, 4) of the faces of each surface and node set, of triangles with _NO_NODE as the fourth."""
        solids = [(kind, shape) for kind in blocks for shape in SIDES if kind.rstrip("0123456789") == shape]
        if not solids:
            return {}
        ids = np.concatenate([numbers[kind] for kind, _ in solids])
        table, start = np.full((len(ids), 6, 4), _NO_NODE), 0
        for kind, shape in solids:
            rows = slice(start, start := start + len(blocks[kind]))
            for side, corners in enumerate(SIDES[shape]):
                table[rows, side, : len(corners)] = blocks[kind][:, corners]
        there, order, found = table[:, :, 0] != _NO_NODE, np.argsort(ids), {}
        for name, entries in self.surfaces.items():
            if name in self.passed:
                continue
            chosen = [np.empty((0, 4), dtype=int)]
            for word, side, row in entries:
                members = self.named("ELSET", word)
                members = (np.array([int(word)]) if word.isdigit() else _NONE) if members is None else members
                at = order[np.clip(np.searchsorted(ids[order], members), 0, len(ids) - 1)]
                at = at[ids[at] == members]
                if not there[at, side].all():
                    row.fail(f"a face S{side + 1} of an element that has fewer",
                             "S1 … S4 of a tetrahedron, … S5 of a prism, … S6 of a hexahedron")
                chosen.append(table[at, side])
            found[name] = np.concatenate(chosen)
        skin = outer(table[there])
        inside = np.zeros(len(self.nodes) + 1, dtype=bool)
        for name, members in self.sets["NSET"].items():
            if name and name not in found and name not in self.sets["ELSET"]:
                inside[:] = False
                inside[place[members[(members >= 0) & (members < len(place))]]] = True
                inside[_NO_NODE] = True
                chosen = skin[inside[skin].all(axis=1)]
                if len(chosen):
                    found[name] = chosen
        return found


def _shape(kind: str, row: Row) -> tuple[str, int]:
    if (count := solid_nodes(kind)) in SOLIDS:
        return SOLIDS[count], count
    if kind in _LINES:
        return _LINES[kind]
    for head in ("STRI", "CPS", "CPE", "CAX", "M3D", "S"):
        if kind.startswith(head) and kind[len(head):len(head) + 1] in _FLAT:
            return _FLAT[kind[len(head)]]
    row.fail(f"elements of type {kind[:12] or '(none)'}",
             "C3D4, C3D10 or others of 5, 6, 8, 15 or 20 nodes, and shells or beams that are passed over")


def solid_nodes(kind: str) -> int:
    """Number of nodes of an element type by its name, C3D8R or the like; 0: they are no solids."""
    return int("".join(c for c in kind[3:] if c.isdigit()) or 0) if kind.startswith("C3D") else 0
