"""A summary on screen: what most look for in a few lines, or all of it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from orchestrator.parallel.team import watched
from orchestrator.results.summary.words import summary_rows

LINES = 23  # at most, so that with what stands before them they are no more than 25
# label → lines at most; what is not here is shown on request and in the report
BRIEF = {"run": 1, "verdict": 4, "result": 2, "peak stress": 2, "peak displ.": 2, "reactions": 4, "loads": 3, "probes": 5,
         "certified": 4, "what to do": 6, "iterations": 1, "error bound": 1, "own errors": 2, "law residual": 1, "no balance": 2,
         "mesh's error": 2, "accuracy": 2, "off by": 3, "interfaces": 2, "bolts": 4, "tools": 3,
         "not held": 2, "warning": 6, "size": 1, "time": 1}
LABEL = 16  # columns, with what is left free beside both
UNTIL = {"time": ":", "iterations": " (", "mesh's error": ";"}  # where a text ends that is told briefly
STYLES = {"warning": "yellow", "what to do": "yellow"}
MORE = "orchestrator report {directory} writes a report of all; run --verbose prints it"


def print_summary(summary: Mapping[str, object], directory: str | os.PathLike[str] | None = None, console: object | None = None,
                  verbose: bool = True) -> None:
    """Prints a summary as a compact table.

    summary : as for ``write_summary``
    directory : the results folder, to say where the figures are
    console : a rich Console; default: standard output
    verbose : all of it; else what most look for, in at most ``LINES`` lines
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = console or Console(highlight=False, emoji=False, force_terminal=None if watched() else False)
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    rows = summary_rows(summary)
    ends = [] if directory is None else [("results", str(directory))]
    if directory is not None and verbose:
        ends.append(("figures", "\n".join(map(str, sorted(Path(directory).glob("figures/*.png"))))))
    elif directory is not None and any(Path(directory).glob("figures/*.png")):
        ends = [("results", f"{directory}, figures in {Path(directory) / 'figures'}")]
    if not verbose:
        width = console.width - LABEL
        rows = brief(rows, width, LINES - sum(len(_folded(text, width)) for _, text in ends), str(directory or "DIR"))
    style = STYLES | {"result": "green" if summary.get("converged") else "red"}
    for label, text in [*rows, *ends]:
        if text:
            table.add_row(label, Text(text, style=style.get(label, "")))
    console.print(table)


def brief(rows: Sequence[tuple[str, str]], width: int, room: int, directory: str) -> list[tuple[str, str]]:
    """Rows of ``BRIEF`` alone, in at most ``room`` lines of a width; where something is left out the last one says so."""
    kept = [(label, _folded(text.partition(UNTIL.get(label, "\n\n"))[0], width)) for label, text in rows if label in BRIEF]
    known = {label for label, _ in kept}
    kept = [(label, lines) for label, lines in kept if not (label == "law residual" and "error bound" in known)]
    shares, more = [min(len(lines), BRIEF[label]) for label, lines in kept], MORE.format(directory=directory)
    while sum(shares) > room - len(_folded(more, width)) and max(shares) > 1:
        longest = max(range(len(shares)), key=lambda k: (shares[k], k))
        shares[longest] -= 1
    shown = [(label, _cut(lines, share, width)) for (label, lines), share in zip(kept, shares)]
    left_out = any(label not in BRIEF for label, _ in rows) or any(share < len(lines) for (_, lines), share in zip(kept, shares))
    return shown + [("more", more)] * left_out


def _folded(text: str, width: int) -> list[str]:
    """The lines that a text takes."""
    from textwrap import wrap

    return [line for part in text.split("\n") for line in wrap(part, max(width, 20), break_on_hyphens=False) or [""]]


def _cut(lines: list[str], count: int, width: int) -> str:
    """So many lines; the last one ends with … where some are left out."""
    if len(lines) <= count:
        return "\n".join(lines)
    return "\n".join([*lines[: count - 1], lines[count - 1][: width - 2] + " …"])
