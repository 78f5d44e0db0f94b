"""The load steps as an animated GIF, which browsers, mails and slides show without anything else: one frame each, none between them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.errors import wrong
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.pictures import deformed, most_deformed, spread
from orchestrator.results.figures.sheet import Sheet, compose
from orchestrator.results.figures.view import Look
from orchestrator.results.folder import ResultsFolder

if TYPE_CHECKING:
    from PIL.Image import Image

NAME = "steps.gif"
MOST = 60  # frames; of more load steps, evenly many
_PIXELS = 960  # columns
_SHOWN, _LAST = 800, 2000  # milliseconds of a frame, of the last


def write_animation(folder: ResultsFolder, fields: Fields, look: Look, title: str) -> None:
    """figures/steps.gif: the deformed structure at its load steps, or those of ``look``; one camera, one exaggeration, one scale.

    Raises InputError: a single load step, or nothing to draw
    """
    steps = look.of_steps(fields.steps) or spread(fields.steps, MOST, most_deformed(fields))
    if len(steps) < 2:
        raise wrong((), "one load step", "two or more, which an animation shows one after another", "leave out --animate")
    sheet = deformed(fields, replace(look, steps=tuple(steps)))
    if sheet is None:
        raise wrong((), "no part to draw that has a mesh of ours", "a part other than decks, matrices and programs", "leave out --animate")
    first, *others = _frames(sheet, title)
    buffer = io.BytesIO()
    first.save(buffer, format="GIF", save_all=True, append_images=others, loop=0, duration=[_SHOWN] * len(others) + [_LAST])
    folder.write(f"figures/{NAME}", buffer.getvalue())


def _frames(sheet: Sheet, title: str) -> Iterator[Image]:
    """A picture of each load step with its scale and caption, in 256 colours."""
    from PIL import Image

    for k, (view, heading) in enumerate(zip(sheet.views, sheet.headings)):
        scales = sheet.scales[k:k + 1] or sheet.scales[:1]
        figure = compose(replace(sheet, views=[view], headings=[heading], columns=1, scales=scales), title)
        figure.canvas.draw()
        shown = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[:, :, :3])
        shown = shown.resize((_PIXELS, round(_PIXELS * shown.height / shown.width)), Image.Resampling.LANCZOS)
        yield shown.quantize(256, Image.Quantize.MAXCOVERAGE)  # keeps the few dots of a mark's colour too
