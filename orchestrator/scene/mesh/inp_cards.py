"""CalculiX's and Abaqus's .inp files: cards, files included, and the nodes, elements and sets that they give.

Read here, not by a library: meshio 5.3 takes no nodes that an *INCLUDE gives before the elements, no *SURFACE and no exponent
D, and tells no line. Beside meshes, decks that are parts are read, which have more cards than a mesh.

Messages tell file and line and never what stands there: an *INCLUDE may name any file of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from orchestrator.errors import InputError, wrong

_DEPTH, _MOST = 20, 1000  # files within each other, and files in all


@dataclass(frozen=True, slots=True)
class Row:
    """A line of numbers or names."""

    text: str
    file: Path
    line: int

    @property
    def words(self) -> list[str]:
        """Entries of the line."""
        return [word.strip() for word in self.text.split(",")]

    def fail(self, found: str, expected: str) -> NoReturn:
        """Raises InputError, with the line's place."""
        raise problem(f"{self.file}:{self.line}: ", found, expected)

    def integer(self, word: str) -> int:
        """A number among its entries."""
        if not word.isdigit():
            self.fail("a word that is no number and names no set", "a whole number, or the name of a set defined before")
        return int(word)


Card = tuple[str, dict[str, str], list[Row]]  # keyword, its options, its lines


def numbers(rows: list[Row]) -> np.ndarray:
    """(…,) float, the entries of lines one after the other; raises InputError for what is no number."""
    text = ",".join(row.text for row in rows)
    try:
        return np.array(text.upper().replace("D", "E").split(","), dtype=float)
    except ValueError:
        if len(rows) == 1:
            rows[0].fail("a word that is no number", "a number")
        for row in rows:
            numbers([row])
        raise


def node_table(options: dict[str, str], rows: list[Row]) -> np.ndarray:
    """(n, 4) float, numbers and coordinates of nodes, a line each: what follows the third coordinate (a normal) is passed over,
    coordinates that are left out are 0.

    Raises InputError: what is no number; coordinates that are not Cartesian
    """
    if options.get("SYSTEM", "R").upper() != "R":
        rows[0].fail(f"nodes in SYSTEM={options['SYSTEM'][:12]}", "Cartesian coordinates")
    full = rows
    if any(row.text.count(",") != 3 or ",," in row.text.replace(" ", "") for row in rows):
        full = [Row(",".join([word or "0" for word in row.words[:4]] + ["0"] * (4 - len(row.words))), row.file, row.line) for row in rows]
    table = numbers(full).reshape(-1, 4)
    bad = np.flatnonzero(~((table[:, 0] >= 1) & (table[:, 0] == np.floor(table[:, 0]))))
    if len(bad):
        rows[bad[0]].fail(f"'{rows[bad[0]].words[0]}' as the number of a node", "a whole number from 1")
    return table


class Model:
    """Nodes, elements and sets of a file.

    cards : of the file
    shape : type of an element, and the line that has it → a name for its shape and its number of nodes; None: passed over
    sets : kinds of sets that are read
    nodes : (n, 4) float, numbers and coordinates; of equal numbers CalculiX takes the last
    blocks : shape → (m, 1 + nodes) int, numbers of elements and of their nodes
    sets : kind → name → members, ascending; names as they are written first, capitals do not count
    """

    def __init__(self, cards: list[Card], shape: Callable[[str, Row], tuple[str, int] | None], sets: Sequence[str] = ("NSET", "ELSET")):
        nodes, blocks, self._parts = [np.empty((0, 4))], {}, {kind: {} for kind in sets}
        for card, options, rows in cards:
            if card == "NODE":
                nodes.append(node_table(options, rows))
                self._put("NSET", options, [nodes[-1][:, 0].astype(int)])
            elif card == "ELEMENT" and (known := shape(options.get("TYPE", "").upper(), rows[0])):
                kind, count = known
                table = numbers(rows).astype(int)
                if len(table) % (count + 1):
                    rows[0].fail(f"{len(table)} numbers for elements of {count} nodes", f"a number and {count} nodes for each")
                blocks.setdefault(kind, []).append(table.reshape(-1, count + 1))
                self._put("ELSET", options, [blocks[kind][-1][:, 0]])
            elif card in self._parts:
                self._put(card, {card: "", **options}, self._members(card, options, rows))
        self.nodes, self.blocks = np.vstack(nodes), {kind: np.vstack(tables) for kind, tables in blocks.items()}
        self.sets = {kind: {name: np.unique(np.concatenate(parts)) for name, parts in sets.items()} for kind, sets in self._parts.items()}

    def named(self, kind: str, name: str) -> np.ndarray | None:
        """Members of the set of a name; None where there is none."""
        return next((members for own, members in self.sets[kind].items() if own.upper() == name.upper()), None)

    def _put(self, kind: str, options: dict[str, str], members: list[np.ndarray]) -> None:
        if kind in options and kind in self._parts:
            sets = self._parts[kind]
            sets.setdefault(next((own for own in sets if own.upper() == options[kind].upper()), options[kind]), []).extend(members)

    def _members(self, kind: str, options: dict[str, str], rows: list[Row]) -> list[np.ndarray]:
        names = {name.upper(): parts for name, parts in self._parts[kind].items()}
        found: list[np.ndarray] = [np.empty(0, dtype=int)]
        for row in rows:
            if "GENERATE" in options:
                first, last, *step = (row.integer(word) for word in row.words)
                found.append(np.arange(first, last + 1, *step))
            else:
                found += [part for word in filter(None, row.words) for part in names.get(word.upper()) or [np.array([row.integer(word)])]]
        return found


def outer(faces: np.ndarray) -> np.ndarray:
    """Outer faces: those of faces (f, n) of elements that only one has."""
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


class Inclusion:
    """A deck and the files that it includes, as far as they have been opened.

    path : of the file; where : of the line that includes it, for messages
    above : that file's
    """

    def __init__(self, path: Path, where: str = "", above: Inclusion | None = None):
        self.path, self.stack = path, [*(above.stack if above else []), path.resolve()]
        self.opened = above.opened if above else []
        self.opened.append(path)
        if path.resolve() in self.stack[:-1] or len(self.stack) > _DEPTH or len(self.opened) > _MOST:
            raise problem(where, "files that include each other without end", "a deck that ends")

    def include(self, options: dict[str, str], line: int) -> Inclusion:
        """The file that a line includes: beside the including file, or beside the deck, where CalculiX looks; raises InputError
        for two different ones."""
        where, name = f"{self.path}:{line}: ", options.get("INPUT", "").strip("\"'")
        beside, main = self.path.parent / name, self.opened[0].parent / name
        if main.is_file() and beside.is_file() and not main.samefile(beside):
            raise problem(where, f"two files of this name, {beside} and {main}", "one: CalculiX reads the latter")
        return Inclusion(main if main.is_file() else beside, where, self)

    def spliced(self) -> Iterator[tuple[str, Path, int]]:
        """Lines that say something, with file and number; those of an included file stand where *INCLUDE stood, as CalculiX
        reads them: data there continues the card above, and a card there takes the data below."""
        try:
            if not self.path.is_file():  # devices and pipes are none: they have no end
                raise problem("", f"{self.path}: no such file", "a file that is there")
            lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise problem("", f"{self.path}: {error.strerror}", "a file that is there") from error
        for number, line in enumerate(lines, 1):
            text = line.strip()
            if not text or text.startswith("**"):
                continue
            if text.startswith("*"):
                card, options = heading(text)
                if card.replace(" ", "") == "INCLUDE":  # blanks do not count
                    yield from self.include(options, number).spliced()
                    continue
            yield text, self.path, number


def heading(text: str) -> tuple[str, dict[str, str]]:
    """Keyword of a card's line, and its options."""
    head, *rest = (part.strip() for part in text[1:].split(","))
    return " ".join(head.upper().split()), {key.strip().upper(): value.strip() for key, _, value in (part.partition("=") for part in rest)}


def cards(path: Path) -> Iterator[Card]:
    """The cards that have lines, up to the first *STEP; the keyword is empty for data above the first card."""
    card, options, rows = "", {}, []
    for text, file, number in Inclusion(path).spliced():
        if not text.startswith("*"):
            rows.append(Row(text.rstrip(", "), file, number))
            continue
        if rows:
            yield card, options, rows
        (card, options), rows = heading(text), []
        if card == "STEP":
            return
    if rows:
        yield card, options, rows


def cards_of_a_model(path: Path) -> list[Card]:
    """Cards of a file that may not begin with data; raises InputError where it does."""
    found = list(cards(path))
    if found and not found[0][0]:
        found[0][2][0].fail("data above the first card", "a card first, such as *NODE")
    return found


def problem(where: str, found: str, expected: str) -> InputError:
    """Problem of a file, ``where`` in it."""
    return wrong(("mesh", "file"), where + found, expected, "mend the file, or save it again as gmsh's .msh")
