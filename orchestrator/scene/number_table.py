"""Tables of numbers in text files, as spreadsheets, solvers and people write them.

A line of words above the numbers is a heading or a row of units. Whatever has a number in its first
field, or numbers in half of its fields, is meant as data: it is read whole or refused by its line.
"""

from __future__ import annotations

import codecs
import re
from pathlib import Path

import numpy as np

from orchestrator.errors import KeyPath, wrong

# Marks at the beginning of a file, the longer ones first: UTF-32's begins as UTF-16's does.
_MARKS = ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
          (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?", re.ASCII)
_NAMES = ("nan", "inf", "infinity")


class NumberTable:
    """Lines with numbers of a file.

    lines : number of each line in the file
    rows : numbers of each line

    Parameters: the file, the key of the YAML that names it, and what a line has, for messages.

    Raises InputError, with file and line: no text, no numbers, words or empty fields amid numbers,
    numbers that are not finite, decimal commas that cannot be told from separators
    """

    def __init__(self, file: Path | str, path: KeyPath, what: str):
        self._file, self._path, self._what = file, path, what
        self.lines: list[int] = []
        self.rows: list[list[float]] = []
        text = self._text()
        separator = next((mark for mark in ";," if mark in text), None)
        seen: set[str] = set()  # decimal marks
        for number, line in enumerate(text.split("\n"), 1):
            fields = self._fields(line, separator, number)
            if fields and (row := self._row(fields, separator == ";", seen, number)):
                self.lines.append(number)
                self.rows.append(row)
        if not self.rows:
            raise wrong(path, f"{file}: no numbers", f"lines of {what}",
                        "export the table again, or take the entry out")

    def fail(self, line: int, found: str, expected: str = "", cure: str = "mend the line") -> None:
        """Raise InputError for a line of the file."""
        raise wrong(self._path, f"{self._file}:{line}: {found}", expected or self._what, cure)

    def array(self) -> np.ndarray:
        """Return the (rows, columns) numbers. Raises InputError: a line of another length."""
        width = len(self.rows[0])
        for line, row in zip(self.lines, self.rows):
            if len(row) != width:
                self.fail(line, f"{len(row)} numbers, where line {self.lines[0]} has {width}")
        return np.array(self.rows)

    def _text(self) -> str:
        """Return the file's text without comments, lines ended by a line feed."""
        try:
            data = Path(self._file).read_bytes()
        except OSError as error:
            raise wrong(self._path, f"{self._file}: {error.strerror}",
                        "a file that is there",
                        "write its path as seen from the YAML file") from error
        code = next((code for mark, code in _MARKS if data.startswith(mark)), "utf-8-sig")
        text = data.decode(code, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        if "\0" in text:
            raise wrong(self._path, f"{self._file}: no text", f"lines of {self._what}",
                        "save it as text, comma separated, UTF-8")
        return re.sub("#[^\n]*", "", text)

    def _fields(self, line: str, separator: str | None, number: int) -> list[str]:
        """Return the fields of a line without quotation marks; none of an empty line."""
        if separator is None:
            return [word.strip("\"'") for word in line.split()]
        if separator == "," and any("," in quoted for quoted in line.split('"')[1::2]):
            self.fail(number, "a comma within quotation marks", "numbers with a decimal point",
                      "write decimal points, or semicolons between the fields")
        fields = [field.strip().strip("\"'").strip() for field in line.split(separator)]
        while fields and not fields[-1]:
            fields.pop()
        return fields

    def _row(self, fields: list[str], commas: bool, seen: set[str], number: int) -> list[float]:
        """Return the numbers of a line; none of a heading."""
        if commas:
            seen.update(mark for mark in ".," for field in fields
                        if mark in field and _NUMBER.fullmatch(field.replace(",", ".")))
            if len(seen) > 1:
                self.fail(number, "decimal commas beside decimal points", "one of them in a file",
                          "write decimal points throughout")
            fields = [field.replace(",", ".") for field in fields]
        known = [bool(_NUMBER.fullmatch(field)) for field in fields]
        if all(known):
            row = [float(re.sub("[dD]", "e", field)) for field in fields]
            if np.isfinite(row).all():
                return row
        odd = next((i for i, (field, good) in enumerate(zip(fields, known), 1) if not good), 0)
        if not odd or fields[odd - 1].lower().lstrip("+-") in _NAMES:
            self.fail(number, "a number that is not finite", "finite numbers")
        begins = any(_NUMBER.fullmatch(word) for word in fields[0].split()[:1])
        if self.rows or begins or 2 * sum(known) >= len(known):
            found = f"field {odd} is " + ("no number" if fields[odd - 1] else "empty")
            self.fail(number, f"{found}, in a line of numbers", "",
                      "mend the line; headings stand above the numbers, notes behind a #")
        return []
