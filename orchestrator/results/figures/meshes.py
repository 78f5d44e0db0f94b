"""Meshes that an accuracy was asked of: errors over elements, accuracy.png; sizes and errors on the first and the last, mesh.png."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.written import read_arrays, write_arrays
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.plotting import COLOURS, GREY, new_figure, tidy
from orchestrator.results.figures.sheet import Scale, Sheet
from orchestrator.results.figures.surface import outer_faces
from orchestrator.results.figures.view import Camera, View, colour_limits
from orchestrator.results.manifest import OWN
from orchestrator.results.summary.summary import units_of
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.mesh.size_map import edge_lengths

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIRST = f"{OWN}/first_mesh.npz"


def keep_first(folder: Path, nodes: np.ndarray, cells: np.ndarray, error: np.ndarray) -> None:
    """Write the first mesh into a results folder, whole or not at all.

    nodes : (n, 3); cells : (m, 4 or 10) int; error : (m,) of each
    """
    write_arrays(folder / FIRST, nodes=nodes, cells=cells[:, :4], error=error)


def errors_over_elements(summary: Mapping[str, object]) -> Figure | None:
    """Curves of the energy norm's error and of quantities', with what is asked; None where there are not two meshes."""
    found = summary.get("accuracy")
    if not found or len(found["meshes"]) < 2:
        return None
    meshes, figure = found["meshes"], new_figure(7.2, 4.0)
    axes, elements = figure.add_axes((0.11, 0.14, 0.85, 0.76)), [one["elements"] for one in meshes]
    curves = [("energy norm", [one["error"] for one in meshes], found["asked"]),
              *((name, [one["quantities"][name]["error"] for one in meshes], told["asked"])
                for name, told in meshes[-1]["quantities"].items())]
    for k, (name, errors, asked) in enumerate(curves):
        colour = COLOURS[k % len(COLOURS)]
        axes.loglog(elements, np.array(errors, dtype=float), color=colour, marker="o", markersize=4, label=name)
        if asked:
            axes.axhline(asked, color=colour, linestyle="--", linewidth=1)
    spent = [one["iterations_error"] for one in meshes]
    axes.loglog(elements, np.array(spent, dtype=float), color=GREY, marker=".", linewidth=1, label="iterations' part of it")
    axes.set(xlabel="elements", ylabel="relative error, estimated; dashed: asked")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda x, _: f"{x:,.0f}" if x >= 1 else f"{x:.4g}")
        axis.set_minor_formatter("")
    axes.set_title(f"{summary.get('name') or ''}: {len(meshes)} meshes", fontsize=11)
    tidy(axes)
    axes.legend(fontsize=8.5, frameon=False)
    return figure


def first_and_last(folder: Path, fields: Fields, summary: Mapping[str, object]) -> Sheet | None:
    """Sizes above, errors below, of the first mesh and the last; None where there was one, or no error is known."""
    if fields.discretisation_error is None or not (folder / FIRST).is_file() or len((summary.get("accuracy") or {}).get("meshes", ())) < 2:
        return None
    first, errors = read_arrays(folder / FIRST), fields.discretisation_error.max(axis=0)
    both = [_skin(first["nodes"], first["cells"], first["error"]), _skin(fields.nodes, fields.cells[:, :4], errors)]
    camera, views = Camera.framing(np.concatenate([points for points, *_ in both])), []
    for k in (0, 1):
        ends, extremes = colour_limits(np.concatenate([values[k] for _, values, _ in both]))
        views += [View(points, np.arange(len(points)).reshape(-1, 3), np.repeat(values[k], 3), camera, ends, extremes, lines, closed=True)
                  for points, values, lines in both]
    length = units_of(summary)["length"]
    counts = [f"{len(cells):,} elements" for cells in (first["cells"], fields.cells)]
    return Sheet(views, [f"first mesh, {counts[0]}", f"last mesh, {counts[1]}", "", ""], 2,
                 [Scale(views[0], "element size" + (length and "," + length)), Scale(views[2], "error of the element, of the whole energy norm")],
                 ["above: sizes", "below: errors", "not deformed"])


def _skin(nodes: np.ndarray, cells: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Corners (3k, 3) of the outer faces, sizes and errors (k,) of the tets behind, and all edges (e, 2, 3)."""
    faces, cell = outer_faces(nodes, cells)
    return nodes[faces].reshape(-1, 3), (edge_lengths(nodes, cells)[cell], error[cell]), nodes[edges_of(faces, TRIANGLE_EDGES)[0]]
