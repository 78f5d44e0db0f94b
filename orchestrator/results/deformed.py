"""figures/deformed.png: the deformed surface with von Mises stress, and the undeformed outline.

VTK draws it (see ``offscreen``); where VTK cannot, matplotlib does, and the caption says so.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from orchestrator.results import stress as recovery
from orchestrator.results import surface
from orchestrator.results.fields import Fields

_LARGEST = 0.1  # largest drawn displacement over the structure's size
_WIDTH, _DPI = 9.0, 160  # of the picture, inches and dots per inch
_FLATTEST, _TALLEST = 0.22, 0.75  # height of the drawing over its width
_PATIENCE = 120.0  # seconds after which the drawing process is given up
# every 16th colour of viridis: readable in grey and by the colour-blind
_COLOURS = ["#440154", "#481b6d", "#46327e", "#3f4788", "#365c8d", "#2e6e8e", "#277f8e", "#21918c", "#1fa187",
            "#2db27d", "#4ac16d", "#73d056", "#a0da39", "#d0e11c", "#fde725"]


@dataclass(frozen=True)
class View:
    """What is drawn: a coloured surface, lines, a camera and a caption.

    Parameters
    ----------
    points : (p, 3) deformed; triangles : (k, 3) int; stress : (p,) von Mises
    lines, outline : (e, 2, 3) deformed edges and subdomain borders, undeformed edges
    limits : of the colour scale; beyond : whether values lie below and above it
    caption : one line
    """

    points: np.ndarray
    triangles: np.ndarray
    stress: np.ndarray
    lines: np.ndarray
    outline: np.ndarray
    camera: surface.Camera
    limits: tuple[float, float]
    beyond: tuple[bool, bool]
    caption: str


def view(fields: Fields, step: int | None = None) -> View:
    """Prepares the picture of one load step; by default the one with the largest displacement."""
    if step is None:
        step = int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))
    step %= fields.steps
    moved = fields.displacement[step]
    largest = float(np.linalg.norm(moved, axis=1).max())
    size = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    factor = float(f"{_LARGEST * size / largest:.1e}") if largest > 0 else 1.0
    deformed = fields.nodes + factor * moved

    faces, cell, local = surface.outer_faces(fields.cells)
    average, node, corner = recovery.nodal_average(
        fields.cells, fields.von_mises(step), fields.volumes, fields.material)
    used, triangles = np.unique(corner[cell[:, None], local], return_inverse=True)
    stress = average[used]
    triangles = triangles.reshape(-1, 3)

    pairs, neighbours = surface.edges(faces)
    owner = fields.subdomain[cell]
    borders = pairs[owner[neighbours[:, 0]] != owner[neighbours[:, 1]]]
    sharp = surface.sharp_edges(fields.nodes, faces)
    outline = fields.nodes[sharp] if len(sharp) else surface.box_edges(fields.nodes)
    shown = np.concatenate([deformed[node[used]], outline.reshape(-1, 3)])
    limits, beyond = _limits(stress)
    load_step = f"   ·   load step {step + 1} of {fields.steps}" if fields.steps > 1 else ""
    caption = (f"displacements drawn × {factor:g}   ·   largest displacement {largest:.3g}   ·   "
               f"largest von Mises stress {stress.max():.3g}{load_step}")
    return View(deformed[node[used]], triangles, stress, deformed[np.concatenate([borders, sharp])], outline,
                _shaped(surface.Camera.framing(shown)), limits, beyond, caption)


def _limits(stress: np.ndarray) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Colour limits that a singular corner does not stretch, and whether values lie beyond them."""
    low, high = (float(q) for q in np.percentile(stress, [0.5, 99.5]))
    span = stress.max() - stress.min()
    if high - low > 0.6 * span:
        low, high = float(stress.min()), float(stress.max())
    if high - low <= 1e-6 * abs(high):  # uniform stress: rounding is no pattern
        low, high = (0.0, 2.0 * high) if high > 0 else (0.0, 1.0)
    return (low, high), (bool(stress.min() < low), bool(stress.max() > high))


def _shaped(camera: surface.Camera) -> surface.Camera:
    ratio = min(max(camera.height / camera.width, _FLATTEST), _TALLEST)
    return replace(camera, width=max(camera.width, camera.height / ratio),
                   height=max(camera.height, camera.width * ratio))


def _palette() -> np.ndarray:
    colours = np.array([[int(c[i:i + 2], 16) for i in (1, 3, 5)] for c in _COLOURS]) / 255
    at = np.linspace(0, len(colours) - 1, 256)
    return np.stack([np.interp(at, np.arange(len(colours)), colours[:, i]) for i in range(3)], axis=1)


class Drawing:
    """A picture being drawn by VTK in another process, while this one does something else."""

    def __init__(self, view: View):
        camera, (low, high) = view.camera, view.limits
        columns = int(_WIDTH * _DPI)
        self._process: subprocess.Popen[bytes] | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="orchestrator-")
        job, self._picture = (Path(self._folder.name) / name for name in ("job.npz", "picture.npy"))
        environment = dict(os.environ)
        if not environment.get("DISPLAY"):  # otherwise VTK tries X first and complains
            environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        program = Path(__file__).with_name("offscreen.py")
        try:
            np.savez(job, points=view.points, triangles=view.triangles, palette=_palette(),
                     value=np.clip((view.stress - low) / (high - low), 0, 1), lines=view.lines,
                     outline=view.outline, focus=camera.focus, toward=camera.toward, up=camera.up,
                     height=camera.height, pixels=np.array([columns, round(columns * camera.height / camera.width)]))
            # in the temporary folder, where a core dump would go away with it
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(program), str(job), str(self._picture)], env=environment,
                cwd=self._folder.name, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        except OSError:  # a full /tmp is no reason to lose the picture: matplotlib needs no room there
            pass

    def finish(self) -> np.ndarray | None:
        """(rows, columns, 3) uint8, or None when VTK could not draw here."""
        try:
            if self._process is None or self._process.wait(_PATIENCE) != 0:
                return None
            return np.load(self._picture)
        except (subprocess.TimeoutExpired, OSError, ValueError):
            return None
        finally:
            self.close()

    def close(self) -> None:
        """Ends the process if it still runs and removes its files."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()


def compose(view: View, picture: np.ndarray | None, title: str) -> bytes:
    """PNG of the picture with colour scale and caption; matplotlib draws the surface if there is no picture."""
    from orchestrator.results.plotting import new_figure, png

    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    camera = view.camera
    drawing = _WIDTH * camera.height / camera.width
    below, above = 1.0, 0.4
    total = drawing + below + above
    figure = new_figure(_WIDTH, total)
    axes = figure.add_axes((0, below / total, 1, drawing / total))
    axes.set_axis_off()
    colours = ScalarMappable(Normalize(*view.limits), ListedColormap(_palette()))
    caption = view.caption
    extent = (-camera.width / 2, camera.width / 2, -camera.height / 2, camera.height / 2)
    if picture is not None:
        axes.imshow(picture, extent=extent, aspect="auto", interpolation="none")
    else:
        _paint(axes, view, colours)
        caption += "\n(drawn by matplotlib: VTK cannot draw on this machine)"
    axes.set(xlim=extent[:2], ylim=extent[2:])
    bar = figure.colorbar(colours, cax=figure.add_axes((0.25, (below - 0.2) / total, 0.5, 0.13 / total)),
                          orientation="horizontal",
                          extend=("neither", "max", "min", "both")[2 * view.beyond[0] + view.beyond[1]])
    bar.set_label("von Mises stress", fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8.5)
    bar.outline.set_linewidth(0.5)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return png(figure, _DPI)


def _paint(axes: object, view: View, colours: object) -> None:
    """The painter's algorithm: faces turned to the eye, farthest first."""
    from matplotlib.collections import LineCollection, PolyCollection

    facing = surface.normals(view.points, view.triangles) @ view.camera.toward
    front = np.flatnonzero(facing > 0)
    corners = view.camera.project(view.points)[view.triangles[front]]
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    rgb = colours.to_rgba(view.stress[view.triangles[front]].mean(axis=1))[:, :3]
    rgb = np.clip(rgb * (0.65 + 0.38 * facing[front])[:, None], 0, 1)[order]
    axes.add_collection(LineCollection(view.camera.project(view.outline)[..., :2], colors="0.45", linewidths=0.8))
    axes.add_collection(PolyCollection(corners[order, :, :2], facecolors=rgb, edgecolors=rgb, linewidths=0.2))
