"""FreeFEM through files whose numbers have few digits, as codes that speak in text write them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from orchestrator.blackbox.codes.freefem.code import FreeFem
from orchestrator.blackbox.transport.session import MessageWorker
from orchestrator.registry import CODES


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Values with so many significant decimal digits."""
    size = np.where(values == 0, 1.0, np.abs(values))
    unit = 10.0 ** (np.floor(np.log10(size)) - digits + 1)
    return np.rint(values / unit) * unit


@contextmanager
def traces_of(digits: int) -> Iterator[None]:
    """Within this context the transport ``file`` carries forces and displacements with so many digits."""

    class Rounding(MessageWorker):
        def run_cases(self, op: int, index: int, forces: np.ndarray, name: str) -> tuple[np.ndarray, float]:
            answer, seconds = super().run_cases(op, index, rounded(forces, digits), name)
            return rounded(answer, digits), seconds

    class Wordy(FreeFem):
        def worker(self) -> type[Rounding]:
            return Rounding

    CODES.add("freefem", Wordy)
    try:
        yield
    finally:
        CODES.add("freefem", FreeFem)
