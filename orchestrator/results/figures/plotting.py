"""The little all figures share: matplotlib without its global state, one look, PNG in memory."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COMPRESSION = 4  # of 9: a twentieth to a third larger than with the usual 6, in half the time
DPI = 160  # dots per inch, of figures and of the pictures in them
GREY = "0.35"
# Okabe and Ito's palette: told apart by the colour-blind
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
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
    """matplotlib obeys a matplotlibrc of the current folder, whoever's it is: it may have texts set by LaTeX. Not here."""
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
