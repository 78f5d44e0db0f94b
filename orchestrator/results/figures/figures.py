"""figures/: what is drawn of one run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.npz import read_npz
from orchestrator.results.figures.charts import along_paths, convergence, probes_over_steps, time_per_stage
from orchestrator.results.figures.meshes import errors_over_elements, first_and_last
from orchestrator.results.figures.pictures import codes, deformed, interfaces
from orchestrator.results.figures.plotting import new_figure, png
from orchestrator.results.figures.sheet import compose, draw
from orchestrator.results.figures.surface import edges, outer_faces
from orchestrator.results.figures.view import Camera, Look, View
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import units_of


def write_figures(folder: ResultsFolder, summary: Mapping[str, object], history: Mapping[str, np.ndarray],
                  fields: Fields | Path | None = None, look: Look | None = None) -> list[Path]:
    """Draw charts and pictures of a run, of what is known; pictures in a process apart (see ``artist``).

    summary : as in summary.json; history : as from ``read_history``
    fields : for deformed.png, interfaces.png, jumps.png, codes.png and mesh.png, or the folder whose fields.npz has them; None: charts alone
    look : of the structure; None: as the configuration says
    Returns paths of the figures written
    """
    if isinstance(fields, Path):
        fields = read_npz(fields)
    made = {"convergence": convergence(summary, history) if len(history.get("iteration", ())) else None,
            "time": time_per_stage(summary) if (summary.get("timing") or {}).get("total") else None, "probes": probes_over_steps(summary),
            "paths": along_paths(summary), "accuracy": errors_over_elements(summary)}
    if fields is not None and fields.steps and len(fields.cells):
        look, title = look or look_of(summary), str(summary.get("name") or "")
        sheets = {"deformed": deformed(fields, look), "interfaces": interfaces(fields, look),
                  "jumps": interfaces(fields, look, imposed=True), "codes": codes(fields, summary),
                  "mesh": first_and_last(folder.path, fields, summary)}
        made |= {name: sheet and compose(sheet, title) for name, sheet in sheets.items()}
    return [folder.write(f"figures/{name}.png", png(figure)) for name, figure in made.items() if figure is not None]


def look_of(summary: Mapping[str, object]) -> Look:
    """The look that the configuration of a run asks for."""
    output = (summary.get("config") or {}).get("output") or {}
    return Look.of(output.get("figures"), units_of(summary))


def warm_up() -> None:
    """Have loaded what the first figure waits for: fonts, VTK's filters and shaders."""
    nodes = np.eye(4)[:, :3]
    faces, _ = outer_faces(nodes, np.arange(4)[None])
    lines = nodes[edges(nodes, faces)]
    draw(View(nodes, faces, nodes[:, 0], Camera.framing(nodes), (0.0, 1.0), lines=lines, outline=lines), inches=0.1)
    figure = new_figure(1, 1)
    figure.text(0, 0, "1")
    png(figure)
