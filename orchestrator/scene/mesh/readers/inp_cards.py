"""CalculiX's and Abaqus's .inp files: cards, and files included.

Read here, not by a library: meshio 5.3 takes no nodes that an *INCLUDE gives before the elements,
no *SURFACE and no exponent D, and tells no line. Beside meshes, decks that are parts are read,
which have more cards than a mesh.

Messages tell file and line and never what stands there: an *INCLUDE may name any file of the
machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from orchestrator.errors import InputError, wrong

_DEPTH, _MOST = 20, 1000  # files within each other, and files in all


@dataclass(slots=True, eq=False)
class Scope:
    """Where numbers and names of cards mean something: a part with its instance, or all the rest.

    start : added to numbers, so that those of different scopes differ
    name : of the instance, or of a part that has none; empty: the assembly, a file without parts
    placed : whether an instance is there
    """

    start: int = 0
    name: str = ""
    placed: bool = False

    @property
    def prefix(self) -> str:
        """Return what stands before names where others than its own cards use them."""
        return self.name and self.name + "."


_WHOLE = Scope()
PER_SCOPE = 1 << 32  # numbers of nodes and elements stay below


@dataclass(frozen=True, slots=True)
class CardLine:
    """A line of numbers or names."""

    text: str
    file: Path
    line: int
    scope: Scope = _WHOLE

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
            self.fail("a word that is no number and names no set",
                      "a whole number, or the name of a set defined before")
        if int(word) >= PER_SCOPE:
            self.fail(f"the number {word}", f"numbers below {PER_SCOPE}")
        return int(word)


Card = tuple[str, dict[str, str], list[CardLine]]  # keyword, its options, its lines


def numbers(rows: list[CardLine]) -> np.ndarray:
    """(…,) float, the entries of lines one after the other; raises InputError for what is no
    number.
    """
    text = ",".join(row.text for row in rows)
    try:
        return np.array(text.upper().replace("D", "E").split(","), dtype=float)
    except ValueError:
        if len(rows) == 1:
            rows[0].fail("a word that is no number", "a number")
        for row in rows:
            numbers([row])
        raise


class Inclusion:
    """A deck and the files that it includes, as far as they have been opened.

    path : of the file; where : of the line that includes it, for messages
    above : that file's
    """

    def __init__(self, path: Path, where: str = "", above: Inclusion | None = None):
        self.path, self.stack = path, [*(above.stack if above else []), path.resolve()]
        self.opened = above.opened if above else []
        self.opened.append(path)
        if path.resolve() in self.stack[:-1] or len(self.stack) > _DEPTH or len(
            self.opened) > _MOST:
            raise problem(where, "files that include each other without end", "a deck that ends")

    def include(self, options: dict[str, str], line: int) -> Inclusion:
        """The file that a line includes: beside the including file, or beside the deck, where
        CalculiX looks; raises InputError
        for two different ones."""
        where, name = f"{self.path}:{line}: ", options.get("INPUT", "").strip("\"'")
        beside, main = self.path.parent / name, self.opened[0].parent / name
        if main.is_file() and beside.is_file() and not main.samefile(beside):
            raise problem(where, f"two files of this name, {beside} and {main}",
                          "one: CalculiX reads the latter")
        return Inclusion(main if main.is_file() else beside, where, self)

    def spliced(self) -> Iterator[tuple[str, Path, int]]:
        """Lines that say something, with file and number; those of an included file stand where
        *INCLUDE stood, as CalculiX
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
    return " ".join(head.upper().split()), {key.strip().upper(): value.strip()
                                            for key, _, value in (
                                                part.partition("=") for part in rest)}


def cards(path: Path) -> Iterator[Card]:
    """The cards that have lines, up to the first *STEP; the keyword is empty for data above the
    first card.

    Raises InputError: two instances of a part, which would be at one place: those that are moved
    are refused by ``inp``
    """
    card, options, rows, scope = "", {}, [], _WHOLE
    parts: dict[str, Scope] = {}
    for text, file, number in Inclusion(path).spliced():
        if not text.startswith("*"):
            rows.append(CardLine(text.rstrip(", "), file, number, scope))
            continue
        if rows:
            yield card, options, rows
        (card, options), rows = heading(text), []
        if card == "STEP":
            return
        if card == "PART":
            scope = parts[options.get("NAME", "").upper()] = Scope(
                (len(parts) + 1) * PER_SCOPE, options.get("NAME", ""))
        elif card == "INSTANCE":
            part = options.get("PART", "").upper()
            scope = parts.setdefault(part, Scope((len(parts) + 1) * PER_SCOPE))
            if scope.placed:
                raise problem(f"{file}:{number}: ", "a second instance of a part",
                              "one instance of each part")
            scope.name, scope.placed = options.get("NAME", ""), True
        elif card in ("END PART", "ASSEMBLY", "END INSTANCE", "END ASSEMBLY"):
            scope = _WHOLE
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
    return wrong(("mesh", "file"), where + found, expected,
                 "mend the file, or save it again as gmsh's .msh")
