"""What requests cost, and whether a model's interface compliance is cheaper than to go on asking.

The compliance C = N M⁻¹Nᵀ of a model with t trace dofs costs a unit load on each of them, once; from then on an answer
is the product F C. It pays for models with few trace dofs that are asked often: bulky parts with small contact patches,
one slice that stands for a hundred, and codes that end after every run and factorise anew for each.

Compared are, for the n requests of r load cases that are still to come,

    n · request(r)     and     unit loads(t) + n · product(t, r),

all in measured seconds. Nobody knows n. It is taken to be as many requests as there have been, and more where a run is
expected to take more: who goes on until that balances pays at most about twice the cheaper of the two ways.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

# Linear stages expected of a run before it has begun (the shipped ones take 4 to 45).
STAGES = 20
MEMORY = 0.25  # of what is free: the share that compliances may take
# Back-substitutions that cost as much as assembling and factorising; measured 50 to 150 for 5,000 to 60,000 dofs.
LOADING = 120
_PROBE = 400  # size of the product that the machine's speed is measured on


@dataclass(frozen=True)
class Request:
    """CPU seconds of a request for some load cases, as measured: ``start`` and ``each``."""

    start: float
    each: float

    def of(self, cases: float) -> float:
        """Seconds for a number of load cases."""
        return self.start + cases * self.each


def to_come(done: int, expected: int = 0) -> int:
    """Requests to come, the next one included, after ``done`` of them; ``expected`` in all by who knows."""
    return max(expected - done, done + 1)


def compliance_pays(trace: int, requests: float, cases: float, request: Request, unit_loads: Request) -> bool:
    """Whether to form the compliance.

    Parameters
    ----------
    trace : number of unit loads
    requests, cases : how many are to come, and load cases of each
    request, unit_loads : what a request costs, and one of unit loads
    """
    gain = requests * request.of(cases) - unit_loads.of(trace)
    return gain > 0 and requests * product_seconds(trace, cases) < gain


def room() -> float:
    """Bytes that compliances may take now."""
    return MEMORY * os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def size_of(trace: int) -> int:
    """Bytes of a compliance."""
    return 8 * trace**2


def copies(cases: int, members: int, workers: int) -> int:
    """How often a model is loaded that stands for several: each time must pay by the solves it takes off another worker.

    Parameters
    ----------
    cases : load cases of a linear stage, of all members together
    members : subdomains it stands for
    workers : processes there are
    """
    return max(1, min(workers, members, cases * STAGES // LOADING))


def product_seconds(trace: int, cases: float) -> float:
    """Of (cases, trace) times (trace, trace): reading the matrix, and arithmetic, each at its measured speed."""
    once, each = _speeds()
    return trace**2 * max(once, cases * each)


@cache
def _speeds() -> tuple[float, float]:
    """Measured CPU seconds per entry of a matrix, as black boxes count them: for one row, and per row of many."""
    matrix, found = np.ones((_PROBE, _PROBE)), []
    for rows in (1, _PROBE):
        other, runs = np.ones((rows, _PROBE)), []
        for _ in range(5):
            begin = time.thread_time()
            other @ matrix
            runs.append(time.thread_time() - begin)
        found.append(min(runs) / _PROBE**2 / rows)
    return found[0], found[1]
