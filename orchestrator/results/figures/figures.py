"""figures/: what is drawn of one run; each figure is a module of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import codes, deformed, panels
from orchestrator.results.figures.convergence import convergence
from orchestrator.results.figures.copied import Copied
from orchestrator.results.figures.look import Look
from orchestrator.results.figures.plotting import png
from orchestrator.results.figures.probes import probes_over_steps
from orchestrator.results.figures.stages import time_per_stage
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.units import units_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from orchestrator.results.figures.canvas import Canvas


def write_figures(folder: ResultsFolder, summary: Mapping[str, object], history: Mapping[str, np.ndarray],
                  fields: Fields | None = None, look: Look | None = None, canvas: Canvas | None = None) -> list[Path]:
    """Draws the figures of a run.

    Parameters
    ----------
    summary : as in summary.json; history : as from ``read_history``
    fields : for deformed.png (the step with the largest displacement; all of them where interfaces open),
        interfaces.png (where they do) and codes.png (where there are several), which are left out without them
    look : of the structure; None: as the configuration says
    canvas : draws the surfaces; without, matplotlib does

    Returns
    -------
    paths of the figures written

    Raises
    ------
    InputError : disk full or folder not writable
    """
    def draw(view):
        return None if canvas is None else canvas.draw(view)

    title, figures = str(summary.get("name") or ""), {}
    charts: dict[str, Callable[[], Figure]] = {}
    if len(history.get("iteration", ())):
        charts["convergence"] = lambda: convergence(summary, history)
    if (summary.get("timing") or {}).get("total"):
        charts["time"] = lambda: time_per_stage(summary)
    if (chart := probes_over_steps(summary)) is not None:
        charts["probes"] = lambda: chart

    def write_charts() -> None:
        _write(folder, {name: made() for name, made in charts.items()})

    written = None if canvas is None else Copied(write_charts)
    if fields is not None and fields.steps and len(fields.cells):
        look = look or look_of(summary)
        if fields.interfaces is None:
            view = deformed.view(fields, look)
            figures["deformed"] = deformed.compose(view, draw(view), title, look)
        else:
            for name, grid in (("deformed", panels.opened(fields, look)), ("interfaces", panels.interfaces(fields, look)),
                               ("jumps", panels.interfaces(fields, look, imposed=True))):
                if grid is not None:
                    figures[name] = panels.compose(grid, [draw(view) for view in grid.views], title)
        if (view := codes.view(fields, summary)) is not None:
            figures["codes"] = codes.compose(view, draw(view), summary)
    _write(folder, figures)
    if written is None:
        write_charts()
    else:
        written.finish()
    return [folder / f"figures/{name}.png" for name in (*charts, *figures)]


def _write(folder: ResultsFolder, figures: Mapping[str, Figure]) -> None:
    for name, figure in figures.items():
        folder.write(f"figures/{name}.png", png(figure))


def look_of(summary: Mapping[str, object]) -> Look:
    """As the configuration of a run says."""
    output = (summary.get("config") or {}).get("output") or {}
    return Look.of(output.get("figures"), units_of(summary))
