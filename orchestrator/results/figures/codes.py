"""figures/codes.png: the structure coloured by the code that solves it, where there are several."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.deformed import DPI, WIDTH, View, show, shaped, views
from orchestrator.results.summary.codes import code_label

# blue, orange, green, purple, sky, red: told apart by the colour-blind
PALETTE = np.array([[0.35, 0.55, 0.75], [0.93, 0.62, 0.25], [0.35, 0.65, 0.45], [0.62, 0.45, 0.68],
                    [0.55, 0.78, 0.90], [0.80, 0.35, 0.30]])


def code_view(fields: Fields, summary: Mapping[str, object]) -> View | None:
    """The deformed surface at the step of the largest displacement, coloured by code; None where there is one code."""
    codes = summary.get("codes") or []
    if len(codes) < 2:
        return None
    drawn = fields.opened
    step = int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))
    base = views(fields, [step])[0]
    of_subdomain = np.zeros(int(fields.subdomain.max()) + 1)
    for number, entry in enumerate(codes):
        of_subdomain[entry["subdomains"]] = number
    faces, cell, _ = surface.outer_faces(drawn.cells)
    moved = drawn.nodes + base.magnified * drawn.displacement[step]
    points = moved[faces].reshape(-1, 3)  # none shared: no colours between those of the codes
    value = np.repeat(of_subdomain[fields.subdomain[cell]], 3)
    palette = PALETTE[np.arange(len(codes)) % len(PALETTE)]
    camera = shaped(surface.Camera.framing(points))
    return View(points, np.arange(len(points)).reshape(-1, 3), value, base.lines, np.empty((0, 2, 3)), camera,
                (-0.5, len(codes) - 0.5), (False, False), f"displacements drawn × {base.magnified:g}", palette)


def compose(view: View, picture: np.ndarray | None, summary: Mapping[str, object]) -> bytes:
    """PNG of the picture with the codes' names."""
    from matplotlib.patches import Patch

    from orchestrator.results.figures.plotting import new_figure, png

    drawing = WIDTH * view.camera.height / view.camera.width
    total = drawing + 0.8
    figure = new_figure(WIDTH, total)
    show(figure.add_axes((0, 0.45 / total, 1, drawing / total)), view, picture)
    names = [Patch(color=colour, label=code_label(entry)) for colour, entry in zip(view.palette, summary["codes"])]
    figure.legend(handles=names, loc="lower center", ncols=min(len(names), 4), frameon=False, fontsize=9.5)
    title = f"{summary.get('name') or ''}: which code solves what"
    figure.text(0.5, 1 - 0.1 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.99, 1 - 0.1 / total, view.caption, ha="right", va="top", fontsize=8.5, color="0.3")
    return png(figure, DPI)
