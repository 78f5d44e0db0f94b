"""Seconds of a run: spent in each stage, and predicted."""

from __future__ import annotations

import math
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

LATEST = 8  # iterations that tell how fast the next ones are


class Stopwatch:
    """Adds up wall-clock seconds and calls under names; stages do not overlap.

    waited : what says how many seconds this process has waited for others so far
    waiting : seconds of each stage in which it waited
    """

    def __init__(self) -> None:
        self.start = time.perf_counter()
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self.waiting: dict[str, float] = defaultdict(float)
        self.waited: Callable[[], float] = float

    @classmethod
    def since_launch(cls) -> Stopwatch:
        """One that has run since this process was started; what has passed is the stage
        ``startup``.
        """
        watch = cls()
        watch.seconds["startup"] = seconds_since_launch()
        watch.start -= watch.seconds["startup"]
        return watch

    def again(self) -> Stopwatch:
        """One for the next of several meshes, begun when this one was; what has passed since is the
        stage ``meshes_before``.
        """
        watch, startup = Stopwatch(), self.seconds["startup"]
        watch.start = self.start
        watch.seconds |= {"startup": startup, "meshes_before": self.total - startup}
        return watch

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin, waited = time.perf_counter(), self.waited()
        try:
            yield
        finally:
            self.waiting[stage] += self.waited() - waited
            self.seconds[stage] += time.perf_counter() - begin
            self.calls[stage] += 1

    @property
    def total(self) -> float:
        """Seconds since the watch was made."""
        return time.perf_counter() - self.start


def seconds_since_launch() -> float:
    """Wall-clock seconds since this process was started: the interpreter and the imports; 0 if
    unknown.
    """
    try:
        with open("/proc/self/stat") as file:
            ticks = float(file.read().rpartition(")")[2].split()[19])
        with open("/proc/uptime") as file:
            return max(float(file.read().split()[0]) - ticks / os.sysconf("SC_CLK_TCK"), 0.0)
    except (OSError, ValueError, IndexError):
        return 0.0


# seconds of the imports over those that they computed: what others leave of a core
SLOW = seconds_since_launch() / time.process_time() or 1.0


def duration(seconds: float) -> str:
    """Return seconds as people say them, below two minutes in one digit."""
    if seconds >= 90:
        return f"{seconds / 60:.0f} min"
    return f"{max(float(f'{seconds:.1g}'), 1):g} s"


def pace_of(values: Sequence[float]) -> float:
    """Return by how much the logarithm of a measure falls per iteration, of late; nan: not
    known.
    """
    y = [math.log(value) for value in values[-LATEST:] if value > 0]
    if len(y) < 3:
        return math.nan
    return -np.polyfit(range(len(y)), y, 1)[0]


@dataclass
class Doing:
    """Something that workers do piece by piece; to be read from any thread.

    what : "assembling", or "back-substitutions"
    of, pieces : what all pieces cost, and how many there are; workers : who do it at once
    done : what the pieces have cost that are done
    """

    what: str
    of: float
    pieces: int
    workers: int
    done: list[float] = field(default_factory=list)
    begun: float = field(default_factory=time.monotonic)
    last: float = 0.0  # when the latest piece was done

    def finish(self, cost: float) -> None:
        """Enter a piece that is done."""
        self.done.append(cost)
        self.last = time.monotonic()

    def __str__(self) -> str:
        done = len(self.done)
        if self.what == "assembling":
            return f"assembling {done} of {self.pieces}" if done < self.pieces else "set-up"
        if done == self.pieces:
            return "first iteration"
        return f"set-up, {sum(self.done):,.0f} of {self.of:,.0f} {self.what}"

    @property
    def seconds(self) -> float:
        """Return what all of it takes, as far as the pieces tell that are done; nan: none is."""
        share = sum(self.done) / self.of if self.done else 0.0
        return (self.last - self.begun) / share if share else float("nan")


# Measured growth with the number of dofs from 1,500 to 13,000, of factorisations (1.6) and
# back-substitutions (1.7).
EXPONENT = 1.6
# Linear stages expected of a run before it has begun (the shipped ones take 4 to 45).
STAGES = 20


def predicted_cost(dofs: np.ndarray) -> np.ndarray:
    """Factorisation and back-substitutions of subdomains with so many dofs; only ratios mean
    anything.
    """
    return np.asarray(dofs, float) ** EXPONENT
