"""The little all figures share: matplotlib without its global state, one look, PNG in memory.

Factor by which displacements are drawn larger: visible, and no body distorted by it.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COMPRESSION = 4  # of 9: a twentieth to a third larger than with the usual 6, in half the time
DPI = 160  # dots per inch, of figures and of the pictures in them
GREY = "0.35"
# Okabe and Ito's palette: told apart by the colour-blind
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9")
BROWN, OLIVE = "#7A4B2A", "#8A8A2A"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BROWN, OLIVE)


def new_figure(width: float, height: float) -> Figure:
    """A figure of the given inches that draws with Agg, whatever backend the user has chosen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    _without_strangers_settings()
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


@cache
def _without_strangers_settings() -> None:
    """matplotlib obeys a matplotlibrc of the current folder, whoever's it is: it may have texts set
    by LaTeX. Not here.
    """
    import matplotlib

    if Path(matplotlib.matplotlib_fname()).absolute().parent == Path.cwd():
        matplotlib.rcdefaults()


def short(value: float) -> str:
    """Three digits, without powers of ten where engineers write none: 1,250, 0.0214, 3.1e-07."""
    text = f"{value:.3g}"
    return f"{float(text):,.0f}" if 1e3 <= abs(value) < 1e7 else text


def tidy(axes: object) -> None:
    """Takes away the frame's upper and right sides and lays a light grid below the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, which="major", color="0.9", linewidth=0.7)
    axes.set_axisbelow(True)


def png(figure: Figure) -> bytes:
    """The figure as PNG. In memory: Pillow, writing to a full disk, loses the error's number."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, pil_kwargs={"compress_level": _COMPRESSION})
    return buffer.getvalue()


LARGEST = 0.1  # largest drawn displacement over the structure's size
# how far a body is drawn stretched, an open or tightened interface parted, over the (smaller) body
DISTORTED = 0.2
TOUCHING = 0.01  # over the structure's size, how far faces that touch may be drawn apart


def exaggeration(fields: Fields, kept: np.ndarray, steps: Sequence[int]) -> float:
    """Return the factor for cells (k,) int at some load steps; 1 where nothing moves."""
    largest = largest_displacement(fields, kept, steps)
    if largest == 0:
        return 1.0
    whole = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    size, stretched = _bodies(fields, kept, steps)
    most, moved = [np.array([LARGEST * whole]), DISTORTED * size], [np.array([largest]), stretched]
    if (i := fields.interfaces) is not None:
        parted = np.isin(i.status[steps], i.kinds[i.kind_names == COUNTED[0]]) | np.array(
            [law in LAWS and LAWS[law].as_one for law in i.laws])[i.interface_of_node]
        smaller = size[i.subdomains].min(axis=1)[i.interface_of_node]
        most.append(np.where(parted, DISTORTED * smaller, TOUCHING * whole).ravel())
        moved.append(np.abs(i.gap - i.initial_gap)[steps].ravel())
    most, moved = np.concatenate(most), np.concatenate(moved)
    known = (most > 0) & (moved > 0)
    return float(f"{(most[known] / moved[known]).min():.1e}")


def largest_displacement(fields: Fields, kept: np.ndarray, steps: Sequence[int]) -> float:
    """Return the largest displacement of cells (k,) int at some load steps."""
    u = fields.opened.displacement[steps][:, np.unique(fields.opened.cells[kept])]
    return float(np.linalg.norm(u, axis=2).max())


def _bodies(fields: Fields, kept: np.ndarray,
            steps: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (E,) size of each subdomain's box, and of its displacements'; 0 without ``kept``
    cells.
    """
    split, own = fields.numbering, np.zeros(int(fields.subdomain.max()) + 1)
    own[fields.subdomain[kept]] = 1.0
    u = np.concatenate(fields.sides, axis=1) if fields.sides else fields.displacement[
        :, split.nodes]

    def extent(values: np.ndarray) -> np.ndarray:
        low, high = (find.reduceat(values, split.offsets[:-1])
                     for find in (np.minimum, np.maximum))
        return own * np.linalg.norm(high - low, axis=1)

    return extent(fields.nodes[split.nodes]), np.max([extent(u[step]) for step in steps], axis=0)
