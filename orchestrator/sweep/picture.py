"""The figure of a sweep: what most look for, over the values that vary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from orchestrator.config.paths import is_number, shown
from orchestrator.results.figures.plotting import COLOURS, new_figure, png, tidy
from orchestrator.sweep.table import heading, more

PANELS = 6
LINES = 8  # curves in one panel; more are not told apart
USUAL = ("peak_stress", "peak_displacement", "pairs.slip", "energy", "iterations")
SAME = 1e-9  # relative: a number that varies by less says nothing
_UNITS = {"peak_stress": "stress", "peak_displacement": "length", "energy": "energy", "bolt_force_min": "force", "bolt_force_max": "force"}

Found = Sequence[tuple[Mapping[str, Any], Mapping[str, float]]]


def drawn(found: Found, units: Mapping[str, str]) -> bytes | None:
    """The figure as PNG; None where fewer than two variants have numbers, or no number varies.

    found : values and numbers of each variant
    units : as ``units_of`` gives them
    """
    found = [(values, numbers) for values, numbers in found if numbers]
    if len(found) < 2 or not (names := _chosen([numbers for _, numbers in found])):
        return None
    keys = list(found[0][0])
    across = next((key for key in keys if all(is_number(values[key]) for values, _ in found)), keys[0])
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure = new_figure(3.6 * columns, 2.9 * rows)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names):
        _panel(axes, name, across, found)
        unit = next((units.get(kind, "") for end, kind in _UNITS.items() if name.endswith(end)), "")
        axes.set_title(heading(name) + (unit and "," + unit), fontsize=9.5)
        tidy(axes)
    for axes in panels[len(names):]:
        axes.set_visible(False)
    if len(panels[0].lines) > 1:
        panels[0].legend(fontsize=7.5, frameon=False)
    return png(figure)


def _chosen(numbers: Sequence[Mapping[str, float]]) -> list[str]:
    """Names of the numbers to draw: all variants have them, and they vary."""
    return [name for name in dict.fromkeys([*more(numbers[0]), *USUAL]) if all(name in one for one in numbers)
            and np.ptp(column := [one[name] for one in numbers]) > SAME * np.abs(column).max()][:PANELS]


def _curves(name: str, across: str, found: Found) -> dict[str, list[tuple[Any, float]]]:
    """Curves: values of the other keys → value of the key ``across``, and the number."""
    curves: dict[str, list[tuple[Any, float]]] = {}
    for values, numbers in found:
        others = ", ".join(f"{key.rpartition('.')[2]} = {shown(value)}" for key, value in values.items() if key != across)
        curves.setdefault(others, []).append((values[across], numbers[name]))
    # of keys that are varied together each set of values has one point: they are one curve
    return {"": [point for curve in curves.values() for point in curve]} if all(len(c) == 1 for c in curves.values()) else curves


def _panel(axes: Any, name: str, across: str, found: Found) -> None:
    for (others, points), colour in zip(list(_curves(name, across, found).items())[:LINES], COLOURS):
        places, values = zip(*points)
        if all(map(is_number, places)):
            places, values = zip(*sorted(points))
            axes.plot(places, values, color=colour, marker="o", markersize=4, linewidth=1.3, label=others)
        else:
            axes.plot([shown(place) for place in places], values, color=colour, marker="o", linestyle="none", label=others)
    axes.set_xlabel(across, fontsize=8.5)
    axes.tick_params(labelsize=8)
