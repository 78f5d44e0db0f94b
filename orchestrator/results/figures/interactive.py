"""Pages that turn: a model or a result as one HTML file that needs no network. Plotly draws, WebGL in the browser.

Parts are shown and hidden in the legend; what is under the pointer is told. Plotly is loaded here alone, when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.errors import wrong
from orchestrator.optional import need
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.exaggeration import exaggeration
from orchestrator.results.figures.pictures import limits_at, most_deformed
from orchestrator.results.figures.plotting import COLOURS
from orchestrator.results.figures.surface import drawn_cells, skin
from orchestrator.results.figures.view import Look, toward_eye

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST = 600_000  # triangles: more than browsers turn smoothly


def result_page(fields: Fields, title: str, look: Look) -> bytes:
    """The deformed structure at the load step of its largest displacement, or the last of those asked for, a surface for each part, by von Mises
    stress.

    Raises InputError: Plotly is not installed, the surface is too large for a browser, or there is none
    """
    step = (look.of_steps(fields.steps) or [most_deformed(fields)])[-1]
    if not len(drawn_cells(fields, look)):
        raise wrong((), "no part to draw that has a mesh of ours", "a part other than decks, matrices and programs",
                    "open fields/fields.pvd in ParaView: decks are there with their own mesh")
    seen = skin(fields, [step], look, toward_eye(fields.nodes) if look.direction is None else look.direction)
    _check(len(seen.triangles))
    u, stress = seen.displacement[step], seen.stress[step]
    factor, (limits, _) = exaggeration(fields, [step]), limits_at(seen, seen.stress, [step], look.scale)[step]
    moved = seen.points + factor * u
    part = np.zeros(len(seen.cell), dtype=int) if fields.part is None else fields.part[seen.cell]
    length, unit = look.units["length"], look.units["stress"]
    graph, figure = _figure(f"{title}: displacements drawn × {factor:g}, load step {step + 1} of {fields.steps}")
    for p in np.unique(part):
        used, corners = np.unique(seen.triangles[part == p], return_inverse=True)
        told = np.column_stack([seen.points[used], u[used], stress[used]])
        figure.add_trace(graph.Mesh3d(**_mesh(moved[used], corners.reshape(-1, 3)), intensity=stress[used], cmin=limits[0], cmax=limits[1],
            colorscale="Viridis", showscale=bool(p == part.min()),
            colorbar={"title": {"text": "von Mises" + (unit and "," + unit)}, "x": 0.0, "xanchor": "right"},
            name=fields.parts[p] if fields.parts else "structure", showlegend=True, customdata=told,
            hovertemplate="(%{customdata[0]:.4g}, %{customdata[1]:.4g}, %{customdata[2]:.4g})" + length
            + "<br>u (%{customdata[3]:.4g}, %{customdata[4]:.4g}, %{customdata[5]:.4g})" + length
            + "<br>von Mises %{customdata[6]:.4g}" + unit))
    ends = np.full((len(seen.lines), 3, 3), np.nan, dtype=np.float32)
    ends[:, :2] = moved[seen.lines]
    x, y, z = ends.reshape(-1, 3).T
    figure.add_trace(graph.Scatter3d(x=x, y=y, z=z, mode="lines", line={"color": "#333333", "width": 1}, hoverinfo="skip", name="edges"))
    if (peak := seen.peaks[step]) is not None:
        at = peak[0][0] + factor * peak[0][1]
        figure.add_trace(graph.Scatter3d(x=at[:1], y=at[1:2], z=at[2:], mode="markers+text", text=[f"peak {peak[1]:.4g}{unit}"],
                                         marker={"size": 5, "color": "#D55E00", "symbol": "circle-open"}, name="peak"))
    return _page(figure)


def model_page(nodes: np.ndarray, groups: Sequence[tuple[str, np.ndarray]], title: str) -> bytes:
    """A model's named surfaces, each in its colour and with its name in the legend and under the pointer.

    groups : name and triangles (k, 3) int of each
    Raises InputError: as for ``result_page``
    """
    _check(sum(len(triangles) for _, triangles in groups))
    graph, figure = _figure(title)
    for k, (name, triangles) in enumerate(groups):
        used, corners = np.unique(triangles[:, :3], return_inverse=True)
        figure.add_trace(graph.Mesh3d(**_mesh(nodes[used], corners.reshape(-1, 3)), color=COLOURS[k % len(COLOURS)], name=name,
                                      showlegend=True, hovertemplate=f"{name}<br>(%{{x:.4g}}, %{{y:.4g}}, %{{z:.4g}})<extra></extra>"))
    return _page(figure)


def _check(count: int) -> None:
    if count > MOST:
        raise wrong((), f"a surface of {count:,} triangles", f"at most {MOST:,}, which a browser can turn",
                    "draw some parts alone: --parts NAME, or a coarser mesh; fields/ is for ParaView")


def _figure(title: str) -> tuple[object, Figure]:
    graph = need("plotly", "graph_objects")
    axis = {"showbackground": False, "gridcolor": "#dddddd", "zeroline": False}
    figure = graph.Figure(layout={"title": {"text": title}, "scene": {"aspectmode": "data", "xaxis": axis, "yaxis": axis, "zaxis": axis,
                                            "camera": {"projection": {"type": "orthographic"}}},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0}, "legend": {"itemsizing": "constant"}})
    return graph, figure


def _mesh(points: np.ndarray, triangles: np.ndarray) -> dict[str, object]:
    """The mesh in single precision: a page is looked at."""
    (x, y, z), (i, j, k) = points.T.astype(np.float32), triangles.T.astype(np.int32)
    return {"x": x, "y": y, "z": z, "i": i, "j": j, "k": k, "flatshading": True,
            "lighting": {"ambient": 0.65, "diffuse": 0.5, "specular": 0.05}}


def _page(figure: Figure) -> bytes:
    return figure.to_html(include_plotlyjs=True, full_html=True, config={"displaylogo": False}).encode()
