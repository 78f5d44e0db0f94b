"""figures/: four pictures of one run, and its charts, convergence.png and time.png."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.artist import CannotDraw, drawn
from orchestrator.results.figures.pictures import compose, deformed, interfaces
from orchestrator.results.figures.plotting import (
    BLUE, GREEN, GREY, new_figure, ORANGE, png, PURPLE, RED, SKY, tidy)
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import BLACKBOX_STAGES, View


def write_figures(folder: ResultsFolder, summary: Mapping[str, object],
                  history: Mapping[str, np.ndarray], fields: Fields | None = None) -> list[Path]:
    """Draw a run, as far as it is known; the structure in a process apart (see ``artist``).

    summary : as in summary.json; history : as from ``read_history``
    fields : of the structure; None: charts alone
    Returns paths of the figures written
    """
    s = View(summary)
    made = {"convergence": convergence(s, history) if len(history.get("iteration", ())) else None,
            "time": time_per_stage(s) if s.timing.get("total") else None}
    if fields is not None and fields.steps and len(fields.cells):
        for draw in (deformed, interfaces):
            picture = draw(fields, s)
            made[draw.__name__] = picture and compose(picture, str(s.name or ""))
    return [folder.write(f"figures/{name}.png", png(figure))
            for name, figure in made.items() if figure is not None]


def figures_apart(folder: ResultsFolder, *job: object) -> list[Path]:
    """Draw as ``write_figures`` does, in a process apart; where that cannot draw, charts alone and
    a warning.
    """
    try:
        return drawn(write_figures, folder, *job)
    except CannotDraw as error:
        print(f"warning: no pictures of the structure: {error}", file=sys.stderr)
        return write_figures(folder, *job[:2])


def warm_up() -> None:
    """Load what the first figure waits for: fonts, VTK's filters and shaders."""
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    still = Fields(corners[0], np.arange(4)[None], np.zeros(1, int), np.ones((1, 2)), 0 * corners)
    png(compose(deformed(still, View({})), "1"))


if TYPE_CHECKING:
    from matplotlib.figure import Figure

# column, label, colour, marker
_MAIN = {"error_bound", "law_residual"}
_FLOOR = 1e-17  # rounding: values below only stretch the axis
_CURVES = [("error_bound", "error bound", "black", "o"),
           ("law_residual", "law residual, the largest", SKY, "P"),
           ("true_error", "true error", RED, "*"),
           ("residual", "residual ‖Δs‖", PURPLE, "v"),
           ("displacement_jump", "displacement jump ‖B w‖", BLUE, "s"),
           ("force_imbalance", "force imbalance ‖A f‖", GREEN, "^"),
           ("indicator", "indicator η, a squared ratio", ORANGE, "D")]


def convergence(s: View, history: Mapping[str, np.ndarray]) -> Figure:
    """Return the history's relative quantities over the iterations, with the tolerance."""
    laws = np.isfinite(history.get("law_residual", np.nan)).any()
    figure, x = new_figure(7.2, 4.6), np.asarray(history["iteration"])
    axes = figure.add_axes((0.1, 0.12, 0.86, 0.78))
    for column, label, colour, marker in _CURVES:
        y = np.array(history.get(column, np.full(len(x), np.nan)), float)
        known, main = np.isfinite(y) & (y > _FLOOR), column in _MAIN
        # interfaces that open are meant to jump
        if known.any() and not (laws and column == "displacement_jump"):
            axes.semilogy(x[known], y[known], color=colour, label=label, marker=marker,
                          markevery=max(1, len(x) // 12), markersize=5 if main else 4,
                          linewidth=1.8 if main else 1.1, zorder=4 if main else 3)
    if (target := tolerance(s)) is not None:
        name, value = target
        axes.axhline(value, color=GREY, linestyle="--", linewidth=1)
        axes.annotate(f"tolerance on the {name}: {value:g}", (0, value),
                      xycoords=("axes fraction", "data"),
                      xytext=(4, 3), textcoords="offset points", fontsize=8.5, color=GREY, zorder=5,
                      bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1})
    axes.set(xlabel="iteration (linear stages after set-up)", ylabel="relative quantity",
             yscale="log")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title(f"{s.name or ''}: {'' if s.converged else 'not '}converged after {int(x[-1])} "
                   "iterations", fontsize=11)
    tidy(axes)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8.5, frameon=True, framealpha=0.9, edgecolor="none", loc="best")
    else:  # one subdomain, say
        axes.text(0.5, 0.7, "all of it is zero, or rounding", transform=axes.transAxes, ha="center",
                  color=GREY)
    return figure


def tolerance(s: View) -> tuple[str, float] | None:
    """Return name and value of the configured tolerance, e.g. ("error bound", 1e-6); None if not in
    the summary.
    """
    given = (s.config.get("method") or {}).get("tolerance")
    for key, value in (given or {}).items():
        if value:
            told = "law residual" if s.status_counts and not s.error_kind else "error bound"
            value = s.tolerance if value == "auto" else value
            name = {"error": told, "law": "law residual", "indicator": "indicator η"}.get(key, key)
            return None if value is None else (name, float(value))
    return None


def time_per_stage(s: View) -> Figure:
    """Return bars: wall-clock seconds of each stage, and the black box's own seconds by kind of
    work.
    """
    total, wall = s.timing["total"], s.stages
    sections = [(f"wall clock: {total:.2f} s", wall if wall[-1][1] > 0.005 * total else wall[:-1],
                 BLUE)]
    for entry in s.codes or [{"code": "the black box", "seconds": s.blackbox}]:
        own = [(stage, float(entry["seconds"].get(stage) or 0.0)) for stage in BLACKBOX_STAGES]
        if spent := sum(seconds for _, seconds in own):
            name = entry["code"] + (f" ({entry['transport']})" if len(s.codes) > 1 else "")
            sections.append((f"{name}, on its own clock: {spent:.2f} s, summed over its workers",
                             own, ORANGE))

    height = 0.27 * sum(len(bars) + 1 for _, bars, _ in sections) + 0.9
    figure = new_figure(7.2, height)
    axes = figure.add_axes((0.26, 0.5 / height, 0.70, 1 - 0.95 / height))
    y, ticks, longest = 0.0, {}, 0.0
    for heading, bars, colour in sections:
        axes.text(0, y, heading, fontsize=9, fontweight="bold", va="center")
        labels, seconds = zip(*bars)
        places = y + 1.0 + np.arange(len(bars))
        drawn = axes.barh(places, seconds, height=0.72, color=colour)
        axes.bar_label(drawn, fmt="%.2f", padding=3, fontsize=8, color=GREY)
        ticks |= dict(zip(places, labels))
        y, longest = y + len(bars) + 1.2, max(longest, *seconds)
    axes.set_yticks(list(ticks), list(ticks.values()), fontsize=8.5)
    axes.set(ylim=(y - 0.5, -0.7), xlim=(0, 1.1 * longest), xlabel="seconds")
    axes.set_title(f"{s.name or ''}: time per stage", fontsize=11)
    tidy(axes)
    axes.grid(False, axis="y")
    return figure
