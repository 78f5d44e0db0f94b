"""Progress of a run: on a terminal a line that changes, elsewhere a line of plain text from time to time."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import TextIO

from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.parallel.team import watched

EVERY = 10.0  # seconds between two lines where the stream is no terminal


class Progress(Subscriber):
    """A line on the terminal: iteration, what is waited for, sweeps, time left. Elsewhere one each ``EVERY`` seconds.

    quiet : no output at all
    stream : default: standard output
    """

    def __init__(self, quiet: bool = False, stream: TextIO | None = None):
        stream = sys.stdout if stream is None else stream
        self._live, self._quiet, self._stream = None, quiet, stream
        self._values: list[float] = []
        self._begun = self._told = time.monotonic()
        # isatty, not rich's own guess: FORCE_COLOR in a CI log must not bring control characters
        if quiet or not stream.isatty() or not watched():
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Live

        # Refreshed by events alone: no second thread beside the worker pool.
        self._live = Live(TextColumn("{task.description}"), BarColumn(bar_width=24),
                          TextColumn("{task.fields[text]}"), TimeRemainingColumn(), TextColumn("left"),
                          auto_refresh=False, console=Console(file=stream, force_terminal=True))
        self._task = self._live.add_task("starting", total=1.0, text="")
        self._live.start()

    def stage(self, name: str) -> None:
        self._show(name, "", 0.0)

    def finished(self, event: Finished) -> None:
        self._show(f"{event.stop_reason} after {event.iterations} iterations", None, 1.0 if event.converged else None)
        self.close()

    def warned(self, sentence: str) -> None:
        if self._live is not None:
            self._live.console.print(f"warning: {sentence}", highlight=False, markup=False)
        elif not self._quiet:
            print(f"warning: {sentence}", file=sys.stderr, flush=True)

    def iteration(self, event: Iteration) -> None:
        if self._quiet:
            return
        name, target = event.target
        value, label = float(getattr(event, name, math.nan)), name.replace("_", " ")
        self._values.append(value)
        shown = f"{label} {value:.1e}" if math.isfinite(value) else f"indicator {event.indicator:.1e}, {label}"
        self._show(f"iteration {event.iteration}", f"{shown} → {target:.0e} · {event.sweeps:g} sweeps", fraction_done(self._values, target))

    def _show(self, description: str, text: str | None, fraction: float | None) -> None:
        if self._live is not None:
            self._live.update(self._task, description=description, completed=fraction, **({} if text is None else {"text": text}))
            self._live.refresh()
        elif not self._quiet and text and (now := time.monotonic()) - self._told >= EVERY:
            self._told = now
            print(f"{now - self._begun:.0f} s: {description}, {text}", file=self._stream, flush=True)

    def close(self) -> None:
        """Leaves the last line on the terminal and gives the terminal back."""
        if self._live is not None:
            self._live.stop()
            self._live = None


def fraction_done(values: Sequence[float], target: float) -> float:
    """Share of the orders of magnitude between the first value and the target already gained, in [0, 1]."""
    y = [v for v in values if math.isfinite(v) and v > 0]
    if not y:
        return 0.0
    if y[-1] <= target:
        return 1.0
    # 1 as the start of a relative quantity whose first values were not evaluated
    start = max(y[0], 1.0)
    return min(1.0, max(0.0, math.log(start / y[-1]) / math.log(start / target)))
