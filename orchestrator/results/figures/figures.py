"""figures/: what is drawn of one run; each figure is a module of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.nodal import KEPT
from orchestrator.results.figures import codes, deformed, panels
from orchestrator.results.figures.convergence import convergence
from orchestrator.results.figures.copied import Copied
from orchestrator.results.figures.look import Look
from orchestrator.results.figures.plotting import png
from orchestrator.results.figures.probes import probes_over_steps
from orchestrator.results.figures.skin import Shape, anything, shape
from orchestrator.results.figures.stages import time_per_stage
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
    title : of the figures
    shape : of the structure; None where it is cut
    figures : name → PNG
    """

    fields: Fields
    look: Look
    title: str
    shape: Shape | None = None
    figures: Mapping[str, bytes] = field(default_factory=dict)


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


def prepare(fields: Fields, look: Look, title: str, canvas: Canvas | None = None) -> Prepared:
    """Of a structure whose displacements are not known yet."""
    return Prepared(fields, look, title, shape(fields, look) if look.cut is None and anything(fields, look) else None)


def sketch(solved: Solved, canvas: Canvas | None = None, *, prepared: Prepared) -> Prepared:
    """The figures of the structure, once it is solved; nothing is written."""
    fields = replace(prepared.fields, displacement=solved.displacement, sides=solved.sides, interfaces=solved.interfaces,
                     believed=solved.believed, thermal=solved.thermal)
    return _drawn(replace(prepared, fields=fields.on_mesh_of(prepared.fields)), solved.stress, canvas)


def _drawn(prepared: Prepared, stress: Mapping[int, np.ndarray] | None, canvas: Canvas | None) -> Prepared:
    fields, look, title, shape = prepared.fields, prepared.look, prepared.title, prepared.shape
    figures = {}
    if not fields.steps or not len(fields.cells):
        return prepared
    seen = anything(fields, look)
    if fields.interfaces is None and not seen:
        return prepared
    if fields.interfaces is None:
        view = deformed.view(fields, look, shape, stress)
        figures["deformed"] = deformed.compose(view, None if canvas is None else canvas.draw(view), title, look)
    else:
        for name, grid in (("deformed", panels.opened(fields, look, shape, stress) if seen else None), ("interfaces", panels.interfaces(fields, look)),
                           ("jumps", panels.interfaces(fields, look, imposed=True))):
            if grid is not None:
                figures[name] = panels.compose(grid, None if canvas is None else [canvas.draw(view) for view in grid.views], title)
    return replace(prepared, figures={name: png(figure) for name, figure in figures.items()})


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
    charts: dict[str, Callable[[], Figure]] = {}
    if len(history.get("iteration", ())):
        charts["convergence"] = lambda: convergence(summary, history)
    if (summary.get("timing") or {}).get("total"):
        charts["time"] = lambda: time_per_stage(summary)
    if (chart := probes_over_steps(summary)) is not None:
        charts["probes"] = lambda: chart

    def write_charts(names: Sequence[str]) -> None:
        for name in names:
            _write(folder, name, png(charts[name]()))

    # half of what is left to do is done by a copy
    names = list(charts)
    aside, here = ([], names) if canvas is None else (names, []) if prepared is None else (names[:1], names[1:])
    written = Copied(partial(write_charts, aside)) if aside else None
    if prepared is None and fields is not None:
        prepared = _drawn(Prepared(fields, look or look_of(summary), str(summary.get("name") or "")), None, canvas)
    figures = dict(prepared.figures) if prepared is not None else {}
    if "deformed" in figures and (view := codes.view(prepared.fields, summary)) is not None:
        figures["codes"] = png(codes.compose(view, None if canvas is None else canvas.draw(view), summary))
    for name, content in figures.items():
        _write(folder, name, content)
    write_charts(here)
    if written is not None:
        written.finish()
    return [folder / f"figures/{name}.png" for name in (*charts, *figures)]


def _write(folder: ResultsFolder, name: str, content: bytes) -> None:
    folder.write(f"figures/{name}.png", content)


def look_of(summary: Mapping[str, object]) -> Look:
    """As the configuration of a run says."""
    output = (summary.get("config") or {}).get("output") or {}
    return Look.of(output.get("figures"), units_of(summary))
