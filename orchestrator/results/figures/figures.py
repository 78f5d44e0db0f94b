"""figures/: what is drawn of one run; each figure is a module of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.nodal import KEPT
from orchestrator.results.figures import codes, deformed, panels
from orchestrator.results.figures.convergence import convergence
from orchestrator.results.figures.copied import Copied
from orchestrator.results.figures.look import Look
from orchestrator.results.figures.panels import Panels
from orchestrator.results.figures.plotting import png
from orchestrator.results.figures.probes import probes_over_steps
from orchestrator.results.figures.skin import Shape, shape
from orchestrator.results.figures.stages import time_per_stage
from orchestrator.results.figures.view import View
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.units import units_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from orchestrator.method.delivery.interface_fields import InterfaceFields
    from orchestrator.results.figures.canvas import Canvas


@dataclass(frozen=True)
class Prepared:
    """What has been prepared for figures of the structure.

    Parameters
    ----------
    fields : without displacements as long as these are not known
    shape : of the structure; None where it is cut
    pictures : name of a figure → what it is made of, with its pictures (None where nobody has drawn them)
    """

    fields: Fields
    look: Look
    shape: Shape | None = None
    pictures: Mapping[str, tuple[View | Panels, list[np.ndarray | None]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Solved:
    """What becomes known of a structure that has been prepared: parameters as for ``Fields``.

    Parameters
    ----------
    stress : step → ``Nodal.von_mises``; None: computed where it is drawn, as nobody keeps that of many steps
    """

    displacement: np.ndarray
    sides: list[np.ndarray] | None
    interfaces: InterfaceFields | None
    believed: np.ndarray | None
    thermal: np.ndarray | None
    stress: Mapping[int, np.ndarray] | None

    @classmethod
    def of(cls, fields: Fields, stress: bool = True) -> Solved:
        """Of a solution; ``stress``: whether it is computed here rather than where it is drawn."""
        if not fields.steps or not len(fields.cells):
            steps = []
        else:
            steps = [deformed.most_deformed(fields)] if fields.interfaces is None else panels.shown_steps(fields)
        known = None if not stress or len(steps) > KEPT else {step: fields.nodal.von_mises(step) for step in steps}
        return cls(fields.displacement, fields.sides, fields.interfaces, fields.believed, fields.thermal, known)


def prepare(fields: Fields, look: Look, canvas: Canvas | None = None) -> Prepared:
    """Of a structure whose displacements are not known yet; for the same of others see ``write_figures``."""
    return Prepared(fields, look, shape(fields, look) if look.cut is None and len(fields.cells) else None)


def sketch(solved: Solved, canvas: Canvas | None = None, *, prepared: Prepared) -> Prepared:
    """The pictures of the structure, once it is solved."""
    fields = replace(prepared.fields, displacement=solved.displacement, sides=solved.sides, interfaces=solved.interfaces,
                     believed=solved.believed, thermal=solved.thermal)
    return _drawn(fields.on_mesh_of(prepared.fields), prepared.look, prepared.shape, solved.stress, canvas)


def _drawn(fields: Fields, look: Look, shape: Shape | None, stress: Mapping[int, np.ndarray] | None,
           canvas: Canvas | None) -> Prepared:
    pictures = {}

    def draw(view: View) -> np.ndarray | None:
        return None if canvas is None else canvas.draw(view)

    if fields.steps and len(fields.cells):
        if fields.interfaces is None:
            view = deformed.view(fields, look, shape, stress)
            pictures["deformed"] = view, [draw(view)]
        else:
            for name, grid in (("deformed", panels.opened(fields, look, shape, stress)), ("interfaces", panels.interfaces(fields, look)),
                               ("jumps", panels.interfaces(fields, look, imposed=True))):
                if grid is not None:
                    pictures[name] = grid, [draw(view) for view in grid.views]
    return Prepared(fields, look, shape, pictures)


def write_figures(folder: ResultsFolder, summary: Mapping[str, object], history: Mapping[str, np.ndarray],
                  fields: Fields | None = None, look: Look | None = None, canvas: Canvas | None = None,
                  prepared: Prepared | None = None) -> list[Path]:
    """Draws the figures of a run.

    Parameters
    ----------
    summary : as in summary.json; history : as from ``read_history``
    fields : for deformed.png (the step with the largest displacement; all of them where interfaces open),
        interfaces.png (where they do) and codes.png (where there are several), which are left out without them
    look : of the structure; None: as the configuration says
    canvas : draws the surfaces; without, matplotlib does
    prepared : by ``sketch``, instead of fields and look

    Returns
    -------
    paths of the figures written

    Raises
    ------
    InputError : disk full or folder not writable
    """
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
    if prepared is None and fields is not None:
        prepared = _drawn(fields, look or look_of(summary), None, None, canvas)
    if prepared is not None:
        for name, (made, pictures) in prepared.pictures.items():
            figures[name] = deformed.compose(made, pictures[0], title, prepared.look) if isinstance(made, View) else \
                panels.compose(made, None if pictures[0] is None else pictures, title)
        if prepared.pictures and (view := codes.view(prepared.fields, summary)) is not None:
            figures["codes"] = codes.compose(view, None if canvas is None else canvas.draw(view), summary)
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
