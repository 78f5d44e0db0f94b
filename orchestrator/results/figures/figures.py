"""figures/: four pictures of one run."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.artist import CannotDraw, drawn
from orchestrator.results.figures.charts import convergence, time_per_stage
from orchestrator.results.figures.pictures import compose, deformed, interfaces
from orchestrator.results.figures.plotting import png
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import View


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
