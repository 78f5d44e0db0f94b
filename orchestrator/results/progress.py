"""Progress of a run: a line that changes on a terminal, elsewhere a line from time to time.

What is left is estimated from what is done. A run assembles its bodies, solves for the fields of
its coarse problems, iterates, and writes. Of what has begun, the pieces that are done tell how long
the others take; of what has not, what came before: assembling and factorising costs as much as
``LOADING`` back-substitutions. Iterations are told by the fall of what they wait for. Seconds that
nothing of the run tells are those of a core of one's own, times what this program had to wait.
"""

from __future__ import annotations

import math
import shutil
import sys
import threading
import time
from typing import TextIO

from orchestrator.blackbox.shared import LOADING
from orchestrator.blackbox.usage import Usage
from orchestrator.compiled import Compiled
from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.parallel.team import watched
from orchestrator.scene.model import Scene
from orchestrator.timing import LATEST, SLOW, STAGES, Doing, duration, pace_of, seconds_since_launch

ERASE = "\r\x1b[2K"
RATE = 2.5e-7  # seconds of one worker for a unit of predicted cost, measured with FreeFEM
FIELDS = {True: 80, False: 16}  # right-hand sides of set-up per subdomain: bonded, with contact
# an iteration's seconds over those of its back-substitutions, before one is measured
BESIDE = 5.0
TRUSTED = 6  # iterations from which on their pace counts for more than experience
LOADED = 2.3  # seconds that the process that draws takes to load what it needs
START, EACH = 1.2, 5e-5  # seconds of what is written, and of it per node and load step
AFTER = 10.0  # iterations whose time the last error bound and the delivery take
# seconds per node of the scene, before anything is known; a fifth more per load step
FIRST = {True: 2e-4, False: 6e-4}


class Progress(Subscriber):
    """A line on the terminal: what is done, the share of the run, the time left. Elsewhere one each
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
        self._remaining, self._usage, self._begun = Remaining(), None, time.monotonic()
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
        self._remaining = Remaining(len(scene.mesh.nodes), scene.steps, scene.bonded)
        self._usage = None
        self.stage("set-up")

    def working(self, usage: Usage) -> None:
        self._usage = usage

    def iteration(self, event: Iteration) -> None:
        name, target = event.target
        value, label = float(getattr(event, name, math.nan)), name.replace("_", " ")
        shown = (f"{label} {value:.1e}" if math.isfinite(value)
                 else f"indicator {event.indicator:.1e}, {label}")
        self._remaining.iterated(event, time.monotonic())
        self.stage(f"iteration {event.iteration}", f"{shown} → {target:.0e}")

    def finished(self, event: Finished) -> None:
        self._remaining.ended = time.monotonic() + ready()
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
        now, doing = time.monotonic(), self._usage and self._usage.doing
        left, spent = self._remaining.left(doing, now), now - self._begun
        stage = str(doing) if doing and not self._remaining.ends else self._stage
        parts = [self._label, stage + ", compiling its loops" * Compiled.compiling]
        if math.isfinite(left):
            parts += [f"{min(spent / (spent + left), 0.99):.0%}", f"{duration(left)} left"]
        elif self._live:
            parts.append(duration(spent))
        parts = [part for part in (*parts, self._text) if part]
        while len(parts) > 1 and len(" · ".join(parts)) > width:
            parts.pop()
        return " · ".join(parts)[:width]

    def _tick(self) -> None:
        waited = 0.0
        while not self._closed.wait(self.often):
            self.line()  # what lasts a second only is seen
            waited += self.often
            if self._live or waited % self.every < self.often:
                self._tell()

    def _tell(self) -> None:
        with self._one:
            text = (ERASE + self.line(shutil.get_terminal_size().columns - 1) if self._live
                    else f"{time.monotonic() - self._begun:.0f} s: {self.line()}\n")
            print(text, end="", file=self._stream, flush=True)


class Remaining:
    """Course of a run, as far as it is known; times are those of ``time.monotonic``.

    nodes, steps, bonded : of the scene
    """

    def __init__(self, nodes: int = 0, steps: int = 1, bonded: bool = True):
        self.nodes, self.steps, self.bonded = nodes, steps, bonded
        # seconds of a back-substitution of all subdomains; 0: too few to be seen
        self.solve = 0.0
        self.begun, self.ended = time.monotonic(), math.nan  # of all this, and of the iterations
        self.ends: list[float] = []  # of each
        self.values: list[float] = []  # what each leaves of what it waits for

    def iterated(self, event: Iteration, now: float) -> None:
        """Take in an iteration that has just ended."""
        self.ends.append(now)
        self.values.append(measure(event))
        self.target = event.target[1]

    @property
    def each(self) -> float:
        """Seconds of an iteration: the latest ones', or what back-substitutions let expect."""
        latest = self.ends[-LATEST:]
        if len(latest) > 1:
            return (latest[-1] - latest[0]) / (len(latest) - 1)
        return BESIDE * self.steps * self.solve

    def left(self, doing: Doing | None, now: float) -> float:
        """Return the seconds that are left; nan before a scene is made.

        doing : what the black box does, or has done last
        """
        if not self.nodes:
            return math.nan
        if math.isfinite(writing := now - self.ended):
            return max(self.after - writing, 0.3 * writing)
        if doing is None:
            whole = SLOW * FIRST[self.bonded] * self.nodes * (1 + 0.2 * self.steps) + self.after
            return max(whole - (now - self.begun), 0.5 * whole)
        if self.ends:
            rest = self.each * (self.to_do + AFTER) - (now - self.ends[-1])
        else:
            spent, assembling = now - doing.begun, doing.what == "assembling"
            guess = (SLOW * RATE * doing.of / doing.workers if assembling
                     else self.solve * doing.of / doing.pieces)
            whole = doing.seconds if math.isfinite(doing.seconds) else max(guess, 1.5 * spent)
            if assembling:
                self.solve = whole / LOADING
            rest = max(whole - spent, 0.0) + FIELDS[self.bonded] * self.solve * assembling
            rest += self.each * (STAGES + AFTER)
        return max(rest, ready()) + self.after

    @property
    def after(self) -> float:
        """Seconds of what is written and drawn."""
        return SLOW * (START + EACH * self.nodes * self.steps)

    @property
    def to_do(self) -> float:
        """Iterations that are still to be done, by the fall of the error, at first by
        experience.
        """
        done, pace, last = len(self.values), pace_of(self.values), self.values[-1]
        usual = max(STAGES - done, 0.3 * done)
        if not (pace > 0 and last > 0):
            return usual
        told = max(math.log(last / self.target), 0.0) / pace
        return (done * told + TRUSTED * usual) / (done + TRUSTED)


def ready() -> float:
    """Seconds until the process that draws has loaded what it needs."""
    return max(SLOW * LOADED - seconds_since_launch(), 0.0)


def measure(event: Iteration) -> float:
    """Return what an iteration waits for, or what goes with it where that is not evaluated yet."""
    told = getattr(event, event.target[0], math.nan), event.law_residual, event.force_imbalance
    return float(next((value for value in told if 0 < value < math.inf), math.nan))
