"""The progress line on a terminal: iteration, what is waited for, sweeps, time left."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TextIO

import numpy as np

from orchestrator.method.events import Finished, Iteration, Subscriber

_WINDOW = 8  # iterations the convergence rate is fitted on: recent enough to notice a change of pace


class Progress(Subscriber):
    """A line on the terminal; silent when ``quiet`` or, but for warnings, when the stream is no terminal.

    Parameters
    ----------
    quiet : no output at all
    stream : default: standard output
    """

    def __init__(self, quiet: bool = False, stream: TextIO | None = None):
        stream = sys.stdout if stream is None else stream
        self._live, self._quiet = None, quiet
        self._seconds: list[float] = []
        self._values: list[float] = []
        # isatty, not rich's own guess: FORCE_COLOR in a CI log must not bring control characters
        if quiet or not stream.isatty():
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Live

        # Refreshed by events alone: no second thread beside the worker pool.
        self._live = Live(TextColumn("{task.description}"), BarColumn(bar_width=24),
                          TextColumn("{task.fields[text]}"), auto_refresh=False,
                          console=Console(file=stream, force_terminal=True))
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
        if self._live is None:
            return
        name, target = event.target
        value = float(getattr(event, name, math.nan))
        self._seconds.append(event.seconds)
        self._values.append(value)
        left = seconds_left(self._seconds, self._values, target)
        shown = f"{_label(name)} {value:.1e} → {target:.0e}"
        if not math.isfinite(value):
            shown = f"indicator {event.indicator:.1e}, {_label(name)} → {target:.0e}"
        time = f" · {_duration(left)} left" if math.isfinite(left) else ""
        self._show(f"iteration {event.iteration}", f"{shown} · {event.sweeps:g} sweeps{time}",
                   fraction_done(self._values, target))

    def _show(self, description: str, text: str | None, fraction: float | None) -> None:
        if self._live is None:
            return
        update: dict[str, object] = {"description": description}
        if text is not None:
            update["text"] = text
        if fraction is not None:
            update["completed"] = fraction
        self._live.update(self._task, **update)
        self._live.refresh()

    def close(self) -> None:
        """Leaves the last line on the terminal and gives the terminal back."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def seconds_left(seconds: Sequence[float], values: Sequence[float], target: float) -> float:
    """Time until ``values`` reach ``target`` if they go on falling at their recent log-linear rate.

    Parameters
    ----------
    seconds, values : one per iteration; values that are nan or not positive are skipped
    target : positive

    Returns
    -------
    seconds, 0 when reached, nan when fewer than two values are known or they do not fall
    """
    x, y = np.array(seconds[-_WINDOW:], float), np.array(values[-_WINDOW:], float)
    known = np.isfinite(y) & (y > 0)
    x, y = x[known], y[known]
    if len(y) and y[-1] <= target:
        return 0.0
    if len(y) < 2 or np.ptp(x) == 0:
        return math.nan
    slope = np.polyfit(x - x[0], np.log(y), 1)[0]
    return math.log(y[-1] / target) / -slope if slope < 0 else math.nan


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


def _label(name: str) -> str:
    return name.replace("_", " ")


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes, hours = seconds / 60, seconds / 3600
    return f"{minutes:.0f} min" if minutes < 100 else f"{hours:.1f} h"
