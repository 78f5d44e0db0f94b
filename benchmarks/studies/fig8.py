"""Figures 8 and 9: the axial stress after one and two iterations, 32 slices in tension.

The paper does not say which k⁺ and α its pictures were made with: two likely choices are shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, ORANGE
from benchmarks.kit.elasticity import moduli, strain, stress
from benchmarks.kit.meshes import simplices
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import NEVER, beam, defaults, paper, with_method
from orchestrator import Scene, Solution

ITERATIONS, STRATEGIES = (1, 2), ("equilibrium", "continuity")
SETTINGS = {  # name: method, style of its curve
    "paper, full k⁺, α = .8": (paper, "-"),
    "paper, exchange, α = .5": (partial(paper, kplus="exchange", relaxation=0.5), "-."),
    "defaults": (defaults, "--"),
}
APPLIED = 10.0  # traction, MPa
MAGNIFIED = 600.0  # displacements in the picture


@dataclass(frozen=True)
class Seen:
    """Axial stress of one case.

    Parameters
    ----------
    stress : (m,) σxx per tet, in MPa
    parts : per subdomain its nodes' displacements (n_E, 3), torn at the interfaces
    """

    stress: np.ndarray
    parts: list[np.ndarray]


def run(study: Study) -> None:
    """Both strategies, with the paper's settings and with the defaults, stopped after one and two iterations."""
    study.columns = ("strategy", "settings", "after", "max_deviation", "rms_deviation", "true_error", "seconds")
    seen: dict[tuple[str, str, int], Seen] = {}
    scene = None
    for strategy in STRATEGIES:
        for settings in SETTINGS:
            for count in ITERATIONS:
                method = SETTINGS[settings][0](strategy) | {"tolerance": NEVER, "max_iterations": count}
                solved = study.solve(
                    Case(with_method(beam(32), method), {"strategy": strategy, "settings": settings, "after": count}),
                    _deviation)
                scene = solved.scene
                seen[strategy, settings, count] = Seen(_axial(solved), [u[0] for u in solved.parts])
    rms = {tuple(row[k] for k in ("strategy", "settings", "after")): row["rms_deviation"] for row in study.rows}
    for settings in SETTINGS:
        for count in ITERATIONS:
            ours, other = rms["equilibrium", settings, count], rms["continuity", settings, count]
            study.target(f"{settings}, iteration {count}: equilibrium nearer to the solution than continuity",
                         "smaller rms deviation of σxx", f"{ours:.2g} against {other:.2g}", ours < other)
    study.figure(_picture(scene, seen), plain=True)


def _axial(solved: Solution) -> np.ndarray:
    """(m,) σxx of the subdomains' own displacements."""
    scene, (lam, mu) = solved.scene, moduli(solved.scene)
    result = np.empty(len(scene.mesh.cells))
    for part, displacement in zip(scene.subdomains, solved.parts):
        found = strain(scene.mesh.nodes[part.nodes], part.connectivity, displacement[0])
        result[part.cells] = stress(found, lam[part.cells], mu[part.cells])[:, 0, 0]
    return result


def _deviation(solved: Solution) -> dict[str, float]:
    """Largest and root mean square deviation of σxx from the undecomposed solution, over the traction."""
    mesh = solved.scene.mesh
    exact = stress(strain(mesh.nodes, mesh.cells, solved.reference.displacement[0]), *moduli(solved.scene))[:, 0, 0]
    gap = np.abs(_axial(solved) - exact) / APPLIED  # all tets are of one volume
    return {"max_deviation": float(gap.max()), "rms_deviation": float(np.sqrt((gap**2).mean()))}


def _picture(scene: Scene, seen: dict[tuple[str, str, int], Seen]):
    """Per iteration a column: torn side views, then σxx along the beam."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 7.8), dpi=160, facecolor="white")
    views = [(strategy, settings) for strategy in STRATEGIES for settings in SETTINGS]
    grid = figure.add_gridspec(len(views) + 2, 2, height_ratios=[1] * len(views) + [1.3, 4.2], left=0.06, right=0.98, top=0.9, bottom=0.08,
                               hspace=0.65, wspace=0.1)
    colours = ScalarMappable(Normalize(0, 2 * APPLIED), "coolwarm")
    for column, count in enumerate(ITERATIONS):
        for row, (strategy, settings) in enumerate(views):
            axes = figure.add_subplot(grid[row, column])
            _side_view(axes, scene, seen[strategy, settings, count], colours)
            title = axes.set_title(f"{strategy}: {settings}", fontsize=9.5, loc="left", pad=1)
            if row == 0:
                axes.annotate(f"after iteration {count}", (0, 1), xycoords=title, xytext=(0, 10),
                              textcoords="offset points", fontsize=12, fontweight="bold")
        along = figure.add_subplot(grid[-1, column])
        _along(along, scene, seen, count)
        if column == 0:
            along.legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
            along.set_ylabel("mean σxx of a layer, MPa", fontsize=8.5)
    room = grid[-2, 0].get_position(figure)
    bar = figure.colorbar(colours, cax=figure.add_axes((0.3, room.y0 + 0.75 * room.height, 0.4, 0.012)),
                          orientation="horizontal", extend="both")
    bar.set_label(f"axial stress of the tets, MPa (applied: {APPLIED:g}); displacements × {MAGNIFIED:g}", fontsize=8.5,
                  labelpad=1)
    bar.ax.tick_params(labelsize=8)
    return figure


def _side_view(axes: Any, scene: Scene, seen: Seen, colours: Any) -> None:
    """The face y = 0, every subdomain displaced on its own."""
    from matplotlib.collections import PolyCollection

    polygons, values = [], []
    for part, displacement in zip(scene.subdomains, seen.parts):
        nodes = scene.mesh.nodes[part.nodes]
        triangles, which, count = simplices(part.connectivity, 3)
        outer = np.flatnonzero(count[which.ravel()] == 1)
        triangles, cell = triangles[which.ravel()[outer]], outer // 4
        front = np.all(nodes[triangles, 1] < 1e-9, axis=1)
        moved = (nodes + MAGNIFIED * displacement)[:, [0, 2]]
        polygons.append(moved[triangles[front]])
        values.append(seen.stress[part.cells[cell[front]]])
    rgb = colours.to_rgba(np.concatenate(values))
    axes.add_collection(PolyCollection(np.concatenate(polygons), facecolors=rgb, edgecolors=rgb, linewidths=0.1))
    axes.set(xlim=(0, 166), ylim=(-0.5, 10.5), aspect="equal", anchor="W")
    axes.set_axis_off()


def _along(axes: Any, scene: Scene, seen: dict[tuple[str, str, int], Seen], count: int) -> None:
    """Mean σxx over each layer of elements."""
    centre = scene.mesh.nodes[scene.mesh.cells].mean(axis=1)[:, 0]
    length = scene.mesh.nodes[:, 0].max()
    layers = len(np.unique(scene.mesh.nodes[:, 0].round(6))) - 1
    layer = np.minimum((centre / length * layers).astype(int), layers - 1)
    x = (np.arange(layers) + 0.5) * length / layers
    for strategy, colour in zip(STRATEGIES, (BLUE, ORANGE)):
        for settings, (_, style) in SETTINGS.items():
            mean = np.bincount(layer, seen[strategy, settings, count].stress) / np.bincount(layer)
            axes.plot(x, mean, style, color=colour, linewidth=1.2, label=f"{strategy}: {settings}")
    axes.axhline(APPLIED, color="0.35", linestyle=":", linewidth=1)
    axes.set(xlim=(0, length), ylim=(-1, 1.9 * APPLIED))
    axes.set_xlabel("x, mm", fontsize=9)
    axes.tick_params(labelsize=8.5)
    axes.spines[["top", "right"]].set_visible(False)
