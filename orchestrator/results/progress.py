"""Progress of a run: a line that changes on a terminal, elsewhere a line from time to time."""

from __future__ import annotations

import math
import shutil
import sys
import threading
import time
from typing import TextIO

from orchestrator.blackbox.usage import Usage
from orchestrator.compiled import Compiled
from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.parallel.team import watched
from orchestrator.scene.model import Scene

ERASE = "\r\x1b[2K"


class Progress(Subscriber):
    """A line on the terminal: what is done, for how long, and the error. Elsewhere one each
    ``every`` seconds.

    quiet : no output at all
    stream : default: standard output
    label : what the run is of several, put first
    """

    every, often = 10.0, 0.5  # seconds between lines, on a terminal between states of one

    def __init__(self, quiet: bool = False, stream: TextIO | None = None, label: str = ""):
        self._stream, self._quiet, self._label = stream or sys.stdout, quiet, label
        # isatty, not a guess: FORCE_COLOR in a CI log must not bring control characters
        self._live = not quiet and self._stream.isatty() and watched()
        self._usage, self._begun = None, time.monotonic()
        self._stage, self._text = "starting", ""
        self._closed, self._one = threading.Event(), threading.Lock()
        self._clock = threading.Thread(target=self._tick, name="progress", daemon=True)
        if not quiet:
            self._clock.start()

    def stage(self, name: str, text: str = "") -> None:
        self._stage, self._text = name, text
        if self._live:
            self._tell()

    def made(self, scene: Scene) -> None:
        """The scene is made that is solved."""
        self._usage = None
        self.stage("set-up")

    def working(self, usage: Usage) -> None:
        self._usage = usage

    def iteration(self, event: Iteration) -> None:
        name, target = event.target
        value, label = float(getattr(event, name, math.nan)), name.replace("_", " ")
        shown = (f"{label} {value:.1e}" if math.isfinite(value)
                 else f"indicator {event.indicator:.1e}, {label}")
        self._usage = None
        self.stage(f"iteration {event.iteration}", f"{shown} → {target:.0e}")

    def finished(self, event: Finished) -> None:
        self._usage = None
        self.stage(f"{event.stop_reason} after {event.iterations} iterations, writing results")

    def warned(self, sentence: str) -> None:
        if not self._quiet:
            with self._one:
                print(f"{ERASE * self._live}warning: {sentence}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Take the line off the terminal, for what is printed next."""
        self._closed.set()
        if self._clock.is_alive():
            self._clock.join()
        if self._live:
            print(ERASE, end="", file=self._stream, flush=True)
            self._live = False

    def line(self, width: int = 1000) -> str:
        """Return what is told now, in so many columns: what matters least is left out first."""
        stage = str(self._usage and self._usage.doing or self._stage)
        parts = [self._label, stage + ", compiling its loops" * Compiled.compiling,
                 f"{time.monotonic() - self._begun:.0f} s" * self._live, self._text]
        parts = list(filter(None, parts))
        while len(parts) > 1 and len(" · ".join(parts)) > width:
            parts.pop()
        return " · ".join(parts)[:width]

    def _tick(self) -> None:
        waited = 0.0
        while not self._closed.wait(self.often):
            waited += self.often
            if self._live or waited % self.every < self.often:
                self._tell()

    def _tell(self) -> None:
        with self._one:
            text = (ERASE + self.line(shutil.get_terminal_size().columns - 1) if self._live
                    else f"{time.monotonic() - self._begun:.0f} s: {self.line()}\n")
            print(text, end="", file=self._stream, flush=True)
