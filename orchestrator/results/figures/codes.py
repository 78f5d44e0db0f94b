"""figures/codes.png: the deformed structure coloured by the code that solves each part, where there are several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import deformed, surface
from orchestrator.results.figures.painting import show
from orchestrator.results.figures.plotting import new_figure
from orchestrator.results.figures.view import WIDTH, Camera, View
from orchestrator.results.summary.codes import code_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# blue, orange, green, purple, sky, red: told apart by the colour-blind
PALETTE = ["#598cbf", "#ed9e40", "#59a673", "#9e73ad", "#8cc7e6", "#cc594d"]


def view(fields: Fields, summary: Mapping[str, object]) -> View | None:
    """The deformed surface at the step of the largest displacement, coloured by code; None where there is one code."""
    from matplotlib.colors import ListedColormap

    codes = summary.get("codes") or []
    if len(codes) < 2:
        return None
    base, drawn = deformed.view(fields), fields.opened
    of_subdomain = np.zeros(int(fields.subdomain.max()) + 1)
    for number, entry in enumerate(codes):
        of_subdomain[entry["subdomains"]] = number
    faces, cell = surface.outer_faces(drawn.nodes, drawn.cells)
    moved = drawn.nodes + base.magnified * drawn.displacement[deformed.most_deformed(fields)]
    points = moved[faces].reshape(-1, 3)  # none shared: no colours between those of the codes
    palette = ListedColormap([PALETTE[k % len(PALETTE)] for k in range(len(codes))])
    return View(points, np.arange(len(points)).reshape(-1, 3), np.repeat(of_subdomain[fields.subdomain[cell]], 3),
                base.lines, np.empty((0, 2, 3)), Camera.framing(points).shaped(), (-0.5, len(codes) - 0.5),
                caption=f"displacements drawn × {base.magnified:g}", palette=palette)


def compose(view: View, picture: np.ndarray | None, summary: Mapping[str, object]) -> Figure:
    """The picture with the codes' names."""
    from matplotlib.patches import Patch

    drawing = WIDTH * view.camera.height / view.camera.width
    total = drawing + 0.8
    figure = new_figure(WIDTH, total)
    show(figure.add_axes((0, 0.45 / total, 1, drawing / total)), view, picture)
    names = [Patch(color=colour, label=code_label(entry)) for colour, entry in zip(view.palette.colors, summary["codes"])]
    figure.legend(handles=names, loc="lower center", ncols=min(len(names), 4), frameon=False, fontsize=9.5)
    title = f"{summary.get('name') or ''}: which code solves what"
    figure.text(0.5, 1 - 0.1 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.99, 1 - 0.1 / total, view.caption, ha="right", va="top", fontsize=8.5, color="0.3")
    return figure
