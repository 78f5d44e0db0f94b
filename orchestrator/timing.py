"""Seconds of a run: spent in each stage, and predicted."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import psutil


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
        watch.seconds["startup"] = time.time() - psutil.Process().create_time()
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


@dataclass
class Doing:
    """Something that workers do piece by piece; to be read from any thread.

    what : "assembling", or "back-substitutions"
    of, pieces : what all pieces cost, and how many there are
    done : what the pieces have cost that are done
    """

    what: str
    of: float
    pieces: int
    done: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        done = len(self.done)
        if self.what == "assembling":
            return f"assembling {done} of {self.pieces}" if done < self.pieces else "set-up"
        if done == self.pieces:
            return "first iteration"
        return f"set-up, {sum(self.done):,.0f} of {self.of:,.0f} {self.what}"


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
