"""figures/convergence.png: the relative quantities of history.csv over the iterations, with the tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import HISTORY_COLUMNS
from orchestrator.registry import LAWS
from orchestrator.results.figures.plotting import (
    BLUE,
    BROWN,
    GREEN,
    GREY,
    OLIVE,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    new_figure,
    powers_of_ten,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# column, label, colour, marker
_MAIN = {"error_bound", "law_residual"}
_FLOOR = 1e-17  # rounding: values below only stretch the axis
_OF_LAWS = [(SKY, "<"), ("0.5", ">"), (BROWN, "P"), (OLIVE, "X")]  # colours and markers of the laws' measures, in turn
_CURVES = [("error_bound", "error bound (guaranteed)", "black", "o"),
           ("law_residual", "law residual (the largest)", "black", "o"),
           ("true_error", "true error", RED, "*"),
           ("residual", "residual ‖Δs‖", PURPLE, "v"),
           ("displacement_jump", "displacement jump ‖B w‖", BLUE, "s"),
           ("force_imbalance", "force imbalance ‖A f‖", GREEN, "^"),
           ("indicator", "indicator η (a squared ratio)", ORANGE, "D")]


def convergence(summary: Mapping[str, object], history: Mapping[str, np.ndarray]) -> Figure:
    """The history's relative quantities over the iterations, with the tolerance."""
    laws = np.isfinite(history.get("law_residual", np.nan)).any()  # more curves: their names beside them
    figure = new_figure(9.2 if laws else 7.2, 4.6)
    axes = figure.add_axes((0.08, 0.12, 0.66, 0.78) if laws else (0.1, 0.12, 0.86, 0.78))
    x = np.asarray(history["iteration"])
    every = max(1, len(x) // 12)
    for column, label, colour, marker in [*_CURVES[:3], *_of_laws(history), *_CURVES[3:]]:
        y = np.array(history.get(column, np.full(len(x), np.nan)), float)
        known = np.isfinite(y) & (y > _FLOOR)
        if laws and column == "displacement_jump":  # interfaces that open are meant to jump
            continue
        if known.any():
            main = column in _MAIN
            axes.semilogy(x[known], y[known], color=colour, label=label, marker=marker, markevery=every,
                          markersize=5 if main else 4, linewidth=1.8 if main else 1.1, zorder=4 if main else 3)
    true = summary.get("true_error")
    if true and math.isfinite(true) and not np.isfinite(history.get("true_error", np.nan)).any():
        axes.semilogy(x[-1], true, color=RED, marker="*", markersize=13, linestyle="none", zorder=5,
                      label=f"true error {true:.1e}")
    target = tolerance(summary)
    if target is not None:
        name, value = target
        axes.axhline(value, color=GREY, linestyle="--", linewidth=1)
        axes.annotate(f"tolerance on the {name}: {value:g}", (0, value), xycoords=("axes fraction", "data"),
                      xytext=(4, 3), textcoords="offset points", fontsize=8.5, color=GREY)
    axes.set(xlabel="iteration (linear stages after set-up)", ylabel="relative quantity")
    axes.xaxis.get_major_locator().set_params(integer=True)
    powers_of_ten(axes.yaxis)
    title = f"{summary.get('name') or ''}: " + ("converged" if summary.get("converged") else "not converged")
    axes.set_title(f"{title} after {int(x[-1])} iterations", fontsize=11)
    tidy(axes)
    place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)} if laws else {"loc": "best"}
    axes.legend(fontsize=8.5, frameon=True, framealpha=0.9, edgecolor="none", **place)
    return figure


def _of_laws(history: Mapping[str, np.ndarray]) -> list[tuple[str, str, str, str]]:
    """Column, label, colour and marker of the measures that the laws of the scene have."""
    found = [name for name in history if name not in HISTORY_COLUMNS and history[name].dtype.kind == "f"]
    labels = {measure.name: measure.label for law in LAWS.values() for measure in law.measures} if found else {}
    return [(name, labels.get(name, name.replace("_", " ")), *_OF_LAWS[k % len(_OF_LAWS)]) for k, name in enumerate(found)]


def tolerance(summary: Mapping[str, object]) -> tuple[str, float] | None:
    """Name and value of the configured tolerance, e.g. ("error bound", 1e-6); None if not in the summary."""
    config = summary.get("config") or {}
    method = config.get("method") if isinstance(config, Mapping) else None
    given = (method or {}).get("tolerance")
    for key, value in (given.items() if isinstance(given, Mapping) else ()):
        if value:
            laws = summary.get("status_counts") is not None
            names = {"error": "law residual" if laws else "error bound", "indicator": "indicator η"}
            value = summary.get("tolerance") if value == "auto" else value
            return None if value is None else (names.get(key, key), float(value))
    return None
