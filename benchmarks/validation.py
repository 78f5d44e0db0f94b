"""``python -m benchmarks.validation > docs/validation.md``: every benchmark beside its reference, its deviation, and its command.

Figures are those of the page of measurements, which studies and tests have found: none is
written here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
HEAD = """# Validation

This page lists every benchmark that has a reference: the result's deviation, and the command that repeats it in a clone. Bold figures miss
their aim. [Contact beside books](contact_benchmarks.md) has belts, wedges, arches, Hertz, Mindlin and NAFEMS. *Written by
`python -m benchmarks.validation` from [measured](measured.md).*
"""


@dataclass(frozen=True)
class Line:
    """A benchmark: a row of the page of measurements.

    begins : how its first cell begins
    against : what it is compared with
    command : where the row has none
    column : of the figure
    """

    begins: str
    against: str
    command: str = ""
    column: str = "measured"


BOOKS = [
    Line("Hertz, h/a", "Hertz: half-width and largest pressure of a cylinder on a block"),
    Line("ball on block, eight", "Hertz: largest pressure and radius", "orchestrator study meshed_apart"),
    Line("the same with elements of one size", "Hertz, elements as large on either side", "orchestrator study meshed_apart"),
    Line("ring shrunk on a shaft", "Lamé", "orchestrator study meshed_apart"),
    Line("the same ring's stress", "Lamé", "orchestrator study meshed_apart"),
    Line("estimate over true discretisation error, exact", "exact solutions: estimate over true error of the mesh"),
    Line("slip load by hand", "μ times what is left of the pretension", "orchestrator study lap_joint"),
]
LIMITS = [Line(begins, "", "orchestrator study limit_loads", "shares") for begins in
          ("thin belt", "wedge, 10°", "shaft pulled", "semicircular arch", "light box", "five loose boxes that slide", "five loose boxes that tip")]
PIPES = "displacements against FreeFEM through pipes (aim: 1e-8)"
CODES = [
    Line("slip load by the line", "CalculiX, the same mesh", "orchestrator study lap_joint"),
    Line("forces of either bolt", "CalculiX, the same mesh", "orchestrator study lap_joint"),
    Line("preload shortening", "CalculiX, the same mesh", "orchestrator study lap_joint"),
    Line("the same with 6,468 dofs", "CalculiX, the same mesh: preload shortening", "orchestrator study lap_joint"),
    Line("FreeFEM through files", "FreeFEM through pipes", column=PIPES),
    Line("scikit-fem through pipes", "FreeFEM through pipes", column=PIPES),
    Line("three blocks meshed apart", "FreeFEM alone", column=PIPES),
    Line("a punch pressed", "FreeFEM on FreeFEM", column=PIPES),
]
WHOLE = [
    Line("beam in tension, 8 slices", "FreeFEM, undecomposed: true error, bound 1e-6 asked for", column="true error at the end"),
    Line("bracket with a hole", "FreeFEM, undecomposed", column="true error at the end"),
    Line("CAD assembly, 18 solids", "FreeFEM, undecomposed", column="true error at the end"),
    Line("3 cases × 5 tolerances", "FreeFEM, undecomposed: bound over true error", column="bound / error"),
    Line("monolithic semismooth Newton", "a Newton in one piece that shares no code with the method"),
    Line("against the same operators", "a Newton in one piece that shares no code with the method", "pytest tests/test_nonmatching.py"),
    Line("*guaranteed* without friction", "solutions in one piece: error told over true error, least, median, largest",
         "orchestrator study certified", "ratio: least, median, largest"),
    Line("*guaranteed* with Coulomb", "the same", "orchestrator study certified", "ratio: least, median, largest"),
    Line("*estimated* (Coulomb", "the same", "orchestrator study certified", "ratio: least, median, largest"),
]


def tables(name: str) -> Iterator[dict[str, str]]:
    """Rows of all tables of a page: column → cell, and ``first``, the first cell; "same" is the command of the row above."""
    heads: list[str] = []
    command = ""
    for line in (DOCS / name).read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            heads = []
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not heads:
            heads = cells
        elif not set(line) <= set("|-"):
            row = dict(zip(heads, cells))
            command = row["command"] if row.get("command") not in (None, "", "same") else command
            yield row | {"first": cells[0]} | ({"command": command} if "command" in row else {})


def found(line: Line, rows: list[dict[str, str]]) -> list[str]:
    """Cells of the page; raises LookupError where the measurements have no such row, or more than one."""
    chosen = [row for row in rows if row["first"].startswith(line.begins) and line.column in row]
    if len(chosen) != 1:
        raise LookupError(f"{len(chosen)} rows begin with {line.begins!r} and have a column {line.column!r}")
    row = chosen[0]
    command = row.get("command") or f"`{line.command}`"
    return [row["first"], line.against or row["theory"], row[line.column], command]


def page() -> str:
    """The page."""
    rows = list(tables("measured.md"))
    parts = [HEAD]
    for title, told, lines in [
            ("Formulas", ("benchmark", "reference", "off by, or found", "command"), [found(line, rows) for line in BOOKS]),
            ("Limit loads", ("scene", "reference", "loads over the limit: carried; told", "command"), [found(line, rows) for line in LIMITS]),
            ("Other codes", ("benchmark", "reference", "off by", "command"), [found(line, rows) for line in CODES]),
            ("The same scene in one piece", ("benchmark", "reference", "off by, or ratio", "command"), [found(line, rows) for line in WHOLE])]:
        parts.append("\n".join([f"## {title}", "", f"| {' | '.join(told)} |", "|---|---|---|---|", *(f"| {' | '.join(row)} |" for row in lines), ""]))
    return "\n".join(parts)


if __name__ == "__main__":
    print(page(), end="")
