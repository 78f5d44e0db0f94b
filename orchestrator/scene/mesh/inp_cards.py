"""The cards of CalculiX's and Abaqus's .inp files: keyword, options, lines; files included are read too."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np

from orchestrator.errors import InputError, Problem

_DEPTH = 20  # files that include each other


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
            self.fail(f"'{word}'", "a whole number, or the name of a set defined before")
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
                    row.fail(f"'{word}'", "a number")
        raise


def node_table(options: dict[str, str], rows: list[Row]) -> np.ndarray:
    """(n, 4) float, numbers and coordinates of nodes, a line each: what follows the third coordinate (a normal) is passed over,
    coordinates that are left out are 0.

    Raises
    ------
    InputError : what is no number; coordinates that are not Cartesian
    """
    if options.get("SYSTEM", "R").upper() != "R":
        rows[0].fail(f"nodes in SYSTEM={options['SYSTEM']}", "Cartesian coordinates")
    if all(row.text.count(",") == 3 for row in rows) and not any(",," in row.text.replace(" ", "") for row in rows):
        table = numbers(rows).reshape(-1, 4)
    else:
        full = [Row(",".join([word or "0" for word in row.words[:4]] + ["0"] * (4 - len(row.words))), row.file, row.line) for row in rows]
        table = numbers(full).reshape(-1, 4)
    bad = np.flatnonzero(~((table[:, 0] >= 1) & (table[:, 0] == np.floor(table[:, 0]))))
    if len(bad):
        rows[bad[0]].fail(f"'{rows[bad[0]].words[0]}' as the number of a node", "a whole number from 1")
    return table


def cards(path: Path, depth: int = 0) -> Iterator[tuple[str, dict[str, str], list[Row]]]:
    """Keyword, its options, its lines; of files that are included too."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise problem("", f"{path}: {error.strerror}", "a file that is there") from error
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
        if card == "INCLUDE":
            if depth >= _DEPTH:
                raise problem(f"{path}:{number}: ", "files that include each other without end", "a deck that ends")
            yield from cards(path.parent / options.get("INPUT", ""), depth + 1)
            card = ""
    if card and rows:
        yield card, options, rows


def problem(where: str, found: str, expected: str) -> InputError:
    """Of a file; ``where`` in it."""
    return InputError(Problem(("mesh", "file"), where + found, expected, "mend the file, or save it again as gmsh's .msh"))
