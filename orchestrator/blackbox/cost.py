"""What requests cost: whether a model's interface compliance is cheaper than more runs, and how often to load a model.

The compliance C = N M⁻¹Nᵀ of a model with t trace dofs costs a unit load on each of them, once; from then on an answer
is the product F C, next to nothing beside a run that starts a process and factorises. For the n requests of r load cases that
are still to come,

    n · request(r)     and     unit loads(t)

are compared, in measured seconds. Nobody knows n. It is taken to be as many requests as there have been, and more where a run is
expected to take more: who goes on until that balances pays at most about twice the cheaper of the two ways.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

# Linear stages expected of a run before it has begun (the shipped ones take 4 to 45).
STAGES = 20
MEMORY = 0.25  # of what is free: the share that compliances may take
# Back-substitutions that cost as much as assembling and factorising; measured 50 to 150 for 5,000 to 60,000 dofs.
LOADING = 120


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
    return requests * request.of(cases) > unit_loads.of(trace)


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
