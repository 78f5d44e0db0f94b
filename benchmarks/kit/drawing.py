"""Figures of studies: one look, and panels of convergence curves, the picture most of them need."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

GREY = "0.35"
# Okabe and Ito's palette: told apart by the colour-blind
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
BROWN, OLIVE = "#7A4B2A", "#8A8A2A"
PALETTE = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BROWN, OLIVE)


@dataclass(frozen=True)
class Curve:
    """One history in a panel.

    Parameters
    ----------
    history : columns of history.csv
    colour : of matplotlib; style : "-", "--" …; label : in the legend, "" for none
    """

    history: Mapping[str, np.ndarray]
    colour: Any
    label: str = ""
    style: str = "-"


def panels(rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.4, 4.0), **shared: Any) -> tuple[Any, np.ndarray]:
    """A figure of so many inches, whatever backend the user has chosen, and its (rows, columns) axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=160, facecolor="white")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def grid(rows: int, columns: int, width: float = 11.0, row_height: float = 3.3) -> tuple[Any, np.ndarray]:
    """Panels of curves: a row shares its ordinate, all share the abscissa."""
    return panels(rows, columns, (width, rows * row_height + 0.9), sharex=True, sharey="row")


def finished(figure: Any, plain: bool = False) -> bytes:
    """The figure as PNG, with light grids and with legends where something is labelled; ``plain``: as it is."""
    for axes in () if plain else figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(True, which="major", color="0.9", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8.5)
        if axes.get_legend() is None and axes.get_legend_handles_labels()[1]:
            axes.legend(fontsize=8.5, frameon=False)
    if not plain:
        figure.tight_layout()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def shades(count: int, palette: str = "viridis") -> list[Any]:
    """Colours for an ordered family of curves, from dark to light; the palest are left out."""
    from matplotlib import colormaps

    return [colormaps[palette](x) for x in np.linspace(0.0, 0.88, count)]


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
        y = np.asarray(curve.history[quantity], float)
        known = np.isfinite(y) & (y > 0)
        solid, few = curve.style == "-", len(y) <= 30
        axes.semilogy(sweeps * np.asarray(curve.history["iteration"])[known], y[known], curve.style, color=curve.colour,
                      linewidth=1.3, label=curve.label or "_", marker=("." if solid else "o") if few else "",
                      markerfacecolor=curve.colour if solid else "none", markersize=4)
    if mark is not None:
        level(axes, *mark)
    axes.set(ylim=limits, xlim=(0, last), yscale="log")
    axes.xaxis.get_major_locator().set_params(integer=True)


def level(axes: Any, value: float, name: str = "") -> None:
    """A dotted line at a level to reach, and its name."""
    axes.axhline(value, color=GREY, linestyle=":", linewidth=1)
    axes.annotate(name, (0, value), xycoords=("axes fraction", "data"), xytext=(3, 3), textcoords="offset points", fontsize=8,
                  color=GREY)


def label_rows(axes: np.ndarray, names: Sequence[str], abscissa: str = "iteration (linear stages after set-up)") -> None:
    """Names of the ordinates at the left, of the abscissa at the bottom."""
    for row, name in zip(axes, names):
        row[0].set_ylabel(name, fontsize=9.5)
    for bottom in axes[-1]:
        bottom.set_xlabel(abscissa, fontsize=9)


def between_lines(axes: Any, factor: float, limits: tuple[float, float]) -> None:
    """Bound over true error: the line of equality, and that of ``factor`` times."""
    line = np.array(limits) * [0.1, 10]
    axes.loglog(line, line, color=GREY, linewidth=1)
    axes.loglog(line, factor * line, color=GREY, linewidth=1, linestyle="--")
    axes.set(xlim=limits, ylim=limits, xlabel="true relative energy error", ylabel="guaranteed bound")
