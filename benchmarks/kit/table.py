"""The table and the targets that a study prints when it is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

# two lines at most, so that tables fit in a terminal; all count linear stages after set-up
HEADINGS = {
    "stages_to_eta": "η<1e-5\nafter", "true_error_at_eta": "error\nthere", "stages_to_true_error": "err<1e-6\nafter",
    "error_bound": "bound", "effectivity": "bound/\nerror", "true_error": "error\nat end", "stop_reason": "ended",
    "iterations": "stages", "seconds": "s", "displacement_jump": "jump", "force_imbalance": "imbal.",
    "modulus_ratio": "E_S/E", "subdomains": "parts",
}


@dataclass(frozen=True)
class Target:
    """A figure to reach: what, how much is wanted, what was measured, and whether that is enough."""

    what: str
    wanted: str
    measured: str
    met: bool


def print_table(console: Console, title: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Rows of a study; ``columns`` in their order, all if empty."""
    if not rows:
        return
    columns = columns or list(dict.fromkeys(key for row in rows for key in row))
    table = _table(title)
    for name in columns:
        number = any(isinstance(row.get(name), (int, float)) for row in rows)
        table.add_column(HEADINGS.get(name, name.replace("_", " ")), justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(_text(row.get(name)) for name in columns))
    _print(console, table)


def print_targets(console: Console, targets: Sequence[Target]) -> None:
    """Targets beside what was measured."""
    table = _table("Targets")
    for heading in ("", "wanted", "measured", "met"):
        table.add_column(heading)
    for t in targets:
        table.add_row(t.what, t.wanted, t.measured, "[green]yes[/]" if t.met else "[bold red]NO[/]")
    _print(console, table)


def _print(console: Console, table: Table) -> None:
    """Prints a table wider than the terminal rather than with digits cut off."""
    wide = console.options.update(width=1000)
    needed = Measurement.get(console, wide, table).maximum
    Console(width=max(console.width, needed), highlight=False).print(table)


def _table(title: str) -> Table:
    return Table(title=title, title_style="bold", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.2g}" if value and not 0.01 <= abs(value) < 1000 else f"{value:.3g}"
    return str(value)
