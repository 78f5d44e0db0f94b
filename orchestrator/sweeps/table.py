"""Table of a sweep: all numbers, on screen the few that most look for, and a figure
over the values that vary.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.config.paths import is_number, shown
from orchestrator.errors import CONVERGED, visible
from orchestrator.results.figures.plotting import COLOURS, new_figure, png, tidy
from orchestrator.sweeps.variants import Variant

NAME = "sweep.csv"
RESULT = {0: "converged", 1: "NOT converged", 2: "bad input", 3: "failed"}
# on screen: rows of variants, and of those after them the ones that have failed
ROWS, FAILED = 14, 5
USUAL = ("iterations", "seconds", "error_bound", "slip_load", "friction_used", "peak_stress",
         "peak_displacement")
MORE = 3  # columns of probes and bolts
PANELS = 6  # of the picture, two rows of three
LINES = 8  # curves in one panel; more are not told apart
DRAWN_FIRST = ("slip_load", "friction_used", "peak_stress", "peak_displacement", "pairs.slip",
               "energy", "iterations")
COUNTED = ("iterations", "pairs.")  # of which no error is told
SAME = 1e-9  # relative: a number that varies by less says nothing
_UNITS = {"peak_stress": "stress", "peak_displacement": "length", "energy": "energy",
          "bolt_force_min": "force", "bolt_force_max": "force"}

Found = Sequence[tuple[Mapping[str, Any], Mapping[str, float]]]


def rows_of(variants: Sequence[Variant], outcomes: Mapping[str, Any]) -> list[list[Any]]:
    """Return the head, and a row per variant: its values, its exit code, which variants it began
    with, and all numbers that any variant has, None where one has none.
    """
    keys = list(dict.fromkeys(key for variant in variants for key in variant.values))
    names = list(dict.fromkeys(name for variant in variants
                               for name in outcomes[variant.name].numbers))
    rows = []
    for variant in variants:
        outcome = outcomes[variant.name]
        values = [value if is_number(value) else json.dumps(value)
                  for value in (variant.values[key] for key in keys)]
        code = outcome.exit_code if outcome.exit_code in RESULT else None
        rows.append([variant.name, *values, code, outcome.why, outcome.started_from,
                     *map(outcome.numbers.get, names)])
    return [["variant", *keys, "exit_code", "why", "started_from", *names], *rows]


class Screen:
    """Prints a row of each variant as soon as it is there; nothing where it is ``quiet``.

    variants : all of them, which decide how wide columns are
    """

    def __init__(self, variants: Sequence[Variant], quiet: bool):
        self.quiet, self.variants = quiet, variants
        self._columns: list[str] | None = None
        self._shown = self._failed = 0
        self._since = time.perf_counter()
        keys = list(variants[0].values)
        self._widths = {key: max(len(key), *(len(shown(v.values[key])) for v in variants))
                        for key in keys}
        if not quiet:
            print(f"{len(variants)} variants of {', '.join(keys)}", flush=True)

    def row(self, variant: Variant, outcome: Any) -> None:
        """A line of one that has ended; of many variants the first ones, and then some of those
        that fail.
        """
        bad = outcome.exit_code != CONVERGED
        if self.quiet or self._shown >= ROWS and not (bad and self._failed < FAILED):
            return
        if self._columns is None and outcome.numbers:
            self._columns = [*(name for name in USUAL if name in outcome.numbers),
                             *more(outcome.numbers)[:MORE]]
            print(
                "  ".join([*(key.rjust(width) for key, width in self._widths.items()),
                           "result".ljust(13),
                           *(heading(name).rjust(width_of(name)) for name in self._columns)]),
                flush=True)
        numbers = [_text(outcome.numbers.get(name)).rjust(width_of(name)) for name in self._columns
                   or ()] if outcome.numbers else []
        result = RESULT[outcome.exit_code].ljust(13) + (" (kept)" if outcome.kept else "")
        why = [f"({outcome.why})"] if outcome.why else []
        values = [shown(variant.values[key]).rjust(width) for key, width in self._widths.items()]
        print(visible("  ".join([*values, result, *numbers, *why])), flush=True)
        if self._shown < ROWS:
            self._shown += 1
        else:
            self._failed += 1

    def end(self, folder: Path, outcomes: Sequence[Any]) -> None:
        """Say how all have ended, and where the rest is."""
        if self.quiet:
            return
        good = sum(outcome.exit_code == CONVERGED for outcome in outcomes)
        if len(outcomes) > self._shown + self._failed:
            print(f"… and {len(outcomes) - self._shown - self._failed} more in {folder / NAME}")
        print(
            f"{good} of {len(outcomes)} converged, in {time.perf_counter() - self._since:.1f} s; "
            f"{folder / NAME}, "
              + "sweep.png beside it, " * (folder / "sweep.png").is_file()
            + "and a folder for each variant", flush=True)


def more(numbers: Mapping[str, float]) -> list[str]:
    """Names of what was asked for beyond the usual: bolts' forces, and probes."""
    bolts = [name for name in numbers if name.startswith("bolt_force_")]
    return bolts + [name for name in numbers if "." in name
                    and not name.startswith(("reaction.", "pairs.", "bolt."))]


def heading(name: str) -> str:
    """Heading of a number; names of probes stay as they are."""
    return name if "." in name else name.replace("_", " ")


def width_of(name: str) -> int:
    return max(len(name), 9)


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else f"{value:,}"


def drawn(found: Found, units: Mapping[str, str]) -> bytes | None:
    """The figure as PNG; None where fewer than two variants have numbers, or no number varies.

    found : values and numbers of each variant
    units : as ``View.unit``
    """
    found = [(values, numbers) for values, numbers in found if numbers]
    if len(found) < 2 or not (names := _chosen([numbers for _, numbers in found])):
        return None
    keys = list(found[0][0])
    across = next((key for key in keys if all(is_number(values[key]) for values, _ in found)),
                  keys[0])
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    width, height = 3.6 * columns, 2.9 * rows  # inches, of which labels need .8 beside a panel
    figure = new_figure(width, height)
    figure.subplots_adjust(0.75 / width, 0.5 / height, 1 - 0.12 / width, 1 - 0.35 / height,
                           wspace=0.8 / 2.8, hspace=0.85 / 2.05)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names):
        _panel(axes, name, across, found)
        unit = next((units.get(kind, "") for end, kind in _UNITS.items() if name.endswith(end)), "")
        axes.set_title(heading(name) + (unit and "," + unit), fontsize=9.5)
        tidy(axes)
    for axes in panels[len(names):]:
        axes.set_visible(False)
    if len(panels[0].get_legend_handles_labels()[1]) > 1:
        panels[0].legend(fontsize=7.5, frameon=False)
    return png(figure)


def _chosen(numbers: Sequence[Mapping[str, float]]) -> list[str]:
    """Names of the numbers to draw: all variants have them, and they vary."""
    return [name for name in dict.fromkeys([*more(numbers[0]), *DRAWN_FIRST])
            if all(name in one for one in numbers)
            and np.ptp(column := [one[name] for one in numbers]) > SAME
            * np.abs(column).max()][:PANELS]


def _curves(name: str, across: str, found: Found) -> dict[str, list[tuple[Any, float, float]]]:
    """Curves: values of the other keys → value of the key ``across``, the number, and its error, as
    ``compare`` has it: the energy error of the run, relative to the largest number.
    """
    curves: dict[str, list[tuple[Any, float, float]]] = {}
    largest = 0.0 if name.startswith(COUNTED) else max(abs(numbers[name]) for _, numbers in found)
    for values, numbers in found:
        others = ", ".join(f"{key.rpartition('.')[2]} = {shown(value)}"
                           for key, value in values.items() if key != across)
        curves.setdefault(others, []).append(
            (values[across], numbers[name], largest * numbers.get("error_bound", 0.0)))
    # of keys that are varied together each set of values has one point: they are one curve
    return {"": [point for curve in curves.values() for point in curve]} if all(
        len(c) == 1 for c in curves.values()) else curves


def _panel(axes: Any, name: str, across: str, found: Found) -> None:
    for (others, points), colour in zip(list(_curves(name, across, found).items())[:LINES],
                                        COLOURS):
        ordered = all(is_number(place) for place, *_ in points)
        places, values, errors = zip(*(sorted(points) if ordered else points))
        axes.errorbar(places if ordered else [*map(shown, places)], values, errors, color=colour,
                      marker="o", markersize=4, linewidth=1.3, capsize=2,
                      linestyle="-" if ordered else "none", label=others)
    axes.set_xlabel(across, fontsize=8.5)
    axes.tick_params(labelsize=8)
