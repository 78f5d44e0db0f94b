"""Several codes in one run: what each has spent, in words, and figures/codes.png, the structure coloured by code."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orchestrator.results.figures import surface
from orchestrator.results.figures.deformed import DPI, WIDTH, View, show, shaped, views
from orchestrator.results.fields.fields import Fields

# blue, orange, green, purple, sky, red: told apart by the colour-blind
PALETTE = np.array([[0.35, 0.55, 0.75], [0.93, 0.62, 0.25], [0.35, 0.65, 0.45], [0.62, 0.45, 0.68],
                    [0.55, 0.78, 0.90], [0.80, 0.35, 0.30]])

CODE_HEAD = ("code", "subdomains", "start", "assemble", "factorise", "solve", "seconds", "unit loads")


def label(entry: Mapping[str, object]) -> str:
    """Name of a code with its transport."""
    return f"{entry['code']} ({entry['transport']})"


def codes_text(summary: Mapping[str, object]) -> str | None:
    """Seconds in each code and in the orchestrator; None for a single code that was asked for no compliance."""
    codes = summary.get("codes") or []
    if len(codes) < 2 and not any(entry["compliances"] for entry in codes):
        return None
    rows = []
    for entry in codes:
        count, asked = len(entry["subdomains"]), entry["compliances"]
        row = (f"{label(entry)}: {entry['seconds']['total']:.2f} s of CPU for {count} "
               f"subdomain{'s' if count != 1 else ''}")
        if asked:
            loads, seconds = sum(note["unit_loads"] for note in asked), sum(note["seconds"] for note in asked)
            row += (f"; asked once for the interface compliance of {len(asked)} of them ({loads:,} unit loads, "
                    f"{seconds:.2f} s), cheaper than a run per iteration")
        rows.append(row)
    own = summary.get("orchestrator_seconds")
    return "\n".join(rows + ([f"orchestrator: {own:.2f} s of wall clock, between requests"] if own is not None else []))


def code_rows(summary: Mapping[str, object]) -> list[tuple[str, ...]]:
    """As ``CODE_HEAD``: CPU seconds of each code by kind of work, and the orchestrator's seconds of wall clock."""
    if codes_text(summary) is None:
        return []
    rows = [(label(entry), str(len(entry["subdomains"])),
             *(f"{entry['seconds'][kind]:.2f}" for kind in ("start", "assemble", "factorise", "solve", "total")),
             f"{sum(note['unit_loads'] for note in entry['compliances']):,}") for entry in summary["codes"]]
    own = summary.get("orchestrator_seconds")
    return rows + ([("orchestrator", "", "", "", "", "", f"{own:.2f}", "")] if own is not None else [])


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
    names = [Patch(color=colour, label=label(entry)) for colour, entry in zip(view.palette, summary["codes"])]
    figure.legend(handles=names, loc="lower center", ncols=min(len(names), 4), frameon=False, fontsize=9.5)
    title = f"{summary.get('name') or ''}: which code solves what"
    figure.text(0.5, 1 - 0.1 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.99, 1 - 0.1 / total, view.caption, ha="right", va="top", fontsize=8.5, color="0.3")
    return png(figure, DPI)
