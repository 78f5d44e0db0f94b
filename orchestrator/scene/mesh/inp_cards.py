"""The cards of CalculiX's and Abaqus's .inp files: keyword, options, lines; files included are read too.

Messages tell file and line and never what stands there: an *INCLUDE may name any file of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np

from orchestrator.errors import InputError, Problem

_DEPTH, _MOST = 20, 1000  # files within each other, and files in all


class Row:
    """A line of numbers or names."""

    __slots__ = ("text", "file", "line")

    def __init__(self, text: str, file: Path, line: int):
        self.text, self.file, self.line = text, file, line

    @property
    def words(self) -> list[str]:
        """Its entries."""
        return [word.strip() for word in self.text.split(",")]

    def fail(self, found: str, expected: str) -> NoReturn:
        """Raises InputError, with the line's place."""
        raise problem(f"{self.file}:{self.line}: ", found, expected)

    def integer(self, word: str) -> int:
        """A number among its entries."""
        if not word.isdigit():
            self.fail("a word that is no number and names no set", "a whole number, or the name of a set defined before")
        return int(word)

    def integers(self) -> list[int]:
        """All of its entries."""
        return [self.integer(word) for word in self.words]


def numbers(rows: list[Row]) -> np.ndarray:
    """(…,) float, the entries of lines one after the other; raises InputError for what is no number."""
    words = ",".join(row.text for row in rows).upper().replace("D", "E").split(",")
    try:
        return np.array(words, dtype=float)
    except ValueError:
        for row in rows:
            for word in row.words:
                try:
                    float(word.upper().replace("D", "E"))
                except ValueError:
                    row.fail("a word that is no number", "a number")
        raise


def node_table(options: dict[str, str], rows: list[Row]) -> np.ndarray:
    """(n, 4) float, numbers and coordinates of nodes, a line each: what follows the third coordinate (a normal) is passed over,
    coordinates that are left out are 0.

    Raises
    ------
    InputError : what is no number; coordinates that are not Cartesian
    """
    if options.get("SYSTEM", "R").upper() != "R":
        rows[0].fail(f"nodes in SYSTEM={options['SYSTEM'][:12]}", "Cartesian coordinates")
    if all(row.text.count(",") == 3 for row in rows) and not any(",," in row.text.replace(" ", "") for row in rows):
        table = numbers(rows).reshape(-1, 4)
    else:
        full = [Row(",".join([word or "0" for word in row.words[:4]] + ["0"] * (4 - len(row.words))), row.file, row.line) for row in rows]
        table = numbers(full).reshape(-1, 4)
    bad = np.flatnonzero(~((table[:, 0] >= 1) & (table[:, 0] == np.floor(table[:, 0]))))
    if len(bad):
        rows[bad[0]].fail(f"'{rows[bad[0]].words[0]}' as the number of a node", "a whole number from 1")
    return table


class Inclusion:
    """A deck and the files that it includes, as far as they have been opened.

    Parameters
    ----------
    path : of the file; where : of the line that includes it, for messages
    above : that file's
    """

    def __init__(self, path: Path, where: str = "", above: Inclusion | None = None):
        self.path, self.stack = path, [*(above.stack if above else []), path.resolve()]
        self.opened = above.opened if above else []
        self.opened.append(path)
        if path.resolve() in self.stack[:-1] or len(self.stack) > _DEPTH or len(self.opened) > _MOST:
            raise problem(where, "files that include each other without end", "a deck that ends")

    def lines(self) -> list[str]:
        """The file's; raises InputError where there is none. Devices and pipes are none: they have no end."""
        try:
            if not self.path.is_file():
                raise problem("", f"{self.path}: no such file", "a file that is there")
            return self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise problem("", f"{self.path}: {error.strerror}", "a file that is there") from error

    def include(self, options: dict[str, str], line: int) -> Inclusion:
        """The file that a line includes."""
        return Inclusion(self.path.parent / options.get("INPUT", ""), f"{self.path}:{line}: ", self)


def includes(card: str) -> bool:
    """Whether a card is *INCLUDE, as CalculiX reads it: blanks do not count."""
    return card.replace(" ", "") == "INCLUDE"


def cards(path: Path | Inclusion) -> Iterator[tuple[str, dict[str, str], list[Row]]]:
    """Keyword, its options, its lines; of files that are included too."""
    deck = path if isinstance(path, Inclusion) else Inclusion(path)
    path, lines = deck.path, deck.lines()
    card, options, rows = "", {}, []
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        if not text.startswith("*"):
            rows.append(Row(text.rstrip(", "), path, number))
            continue
        if card and rows:
            yield card, options, rows
        head, *rest = (part.strip() for part in text[1:].split(","))
        card, rows = " ".join(head.upper().split()), []
        options = {key.strip().upper(): value.strip() for key, _, value in (part.partition("=") for part in rest)}
        if card == "STEP":
            return
        if includes(card):
            yield from cards(deck.include(options, number))
            card = ""
    if card and rows:
        yield card, options, rows


def problem(where: str, found: str, expected: str) -> InputError:
    """Of a file; ``where`` in it."""
    return InputError(Problem(("mesh", "file"), where + found, expected, "mend the file, or save it again as gmsh's .msh"))
