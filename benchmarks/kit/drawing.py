"""Panels of convergence curves, the picture most studies need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.method.events import Iteration
from orchestrator.results.figures.plotting import GREY, new_figure, tidy


@dataclass(frozen=True)
class Curve:
    """One history in a panel.

    Parameters
    ----------
    history : iterations
    colour : of matplotlib; style : "-", "--" …; label : in the legend, "" for none
    """

    history: Sequence[Iteration]
    colour: Any
    label: str = ""
    style: str = "-"


def shades(count: int, palette: str = "viridis") -> list[Any]:
    """Colours for an ordered family of curves, from dark to light; the palest are left out."""
    from matplotlib import colormaps

    return [colormaps[palette](x) for x in np.linspace(0.0, 0.88, count)]


def grid(rows: int, columns: int, width: float = 11.0, row_height: float = 3.3) -> tuple[Any, np.ndarray]:
    """A figure and its (rows, columns) axes; a row shares its ordinate, all share the abscissa."""
    figure = new_figure(width, rows * row_height + 0.9)
    axes = figure.subplots(rows, columns, sharex=True, sharey="row", squeeze=False)
    return figure, axes


def plain_ticks(axes: Any) -> None:
    """1, 2, 5, 10 … on both logarithmic axes, as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def draw(axes: Any, curves: Sequence[Curve], quantity: str, *, limits: tuple[float, float], last: int,
         mark: tuple[float, str] | None = None, sweeps: int = 1) -> None:
    """Curves of one quantity over the iterations, on a logarithmic ordinate.

    Parameters
    ----------
    limits : of the ordinate; last : of the abscissa
    mark : a level to reach and its name
    sweeps : units of the abscissa per iteration
    """
    for curve in curves:
        x = sweeps * np.array([event.iteration for event in curve.history])
        y = np.array([getattr(event, quantity) for event in curve.history], float)
        known = np.isfinite(y) & (y > 0)
        axes.semilogy(x[known], y[known], curve.style, color=curve.colour, linewidth=1.3,
                      label=curve.label or "_", marker="" if len(x) > 30 else "." if curve.style == "-" else "o",
                      markerfacecolor=curve.colour if curve.style == "-" else "none", markersize=4)
    if mark is not None:
        axes.axhline(mark[0], color=GREY, linestyle=":", linewidth=1)
        axes.annotate(mark[1], (0, mark[0]), xycoords=("axes fraction", "data"), xytext=(3, 3),
                      textcoords="offset points", fontsize=8, color=GREY)
    axes.set(ylim=limits, xlim=(0, last))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.tick_params(labelsize=8.5)
    tidy(axes)


def label_rows(axes: np.ndarray, names: Sequence[str],
               abscissa: str = "iteration (linear stages after set-up)") -> None:
    """Names of the ordinates at the left, of the abscissa at the bottom."""
    for row, name in zip(axes, names):
        row[0].set_ylabel(name, fontsize=9.5)
    for bottom in axes[-1]:
        bottom.set_xlabel(abscissa, fontsize=9)
