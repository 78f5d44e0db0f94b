"""gmsh switched on for one model, and its answers as arrays."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import gmsh
import numpy as np

HXT = 10
TRIANGLE, TET = 2, 4


@contextmanager
def session() -> Iterator[None]:
    """gmsh switched on, quiet, with a model of its own; always switched off again."""
    # gmsh gives these back to the system: a broken pipe would kill the program without a word, a hangup despite nohup
    handlers = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGPIPE, signal.SIGTERM, signal.SIGINT)}
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():
            signal.signal(number, handler)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        # With several threads gmsh gives another mesh at every call; alone it is hardly slower.
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def elements(kind: int, tags: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Node tags (k, 3 or 4) of the triangles or tets of some entities, and the entity (k,) as index into tags."""
    width = 4 if kind == TET else 3
    blocks = [gmsh.model.mesh.getElementsByType(kind, tag)[1].reshape(-1, width).astype(np.int64) for tag in tags]
    return np.concatenate(blocks), np.repeat(np.arange(len(tags)), [len(block) for block in blocks])


def points(tags: np.ndarray) -> np.ndarray:
    """(n, 3) coordinates of nodes, given by their tags."""
    known, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(known)
    return coordinates.reshape(-1, 3)[order[np.searchsorted(known[order], tags)]]


def last_complaint(error: Exception) -> str:
    """The last line of gmsh's error message."""
    lines = str(error).strip().splitlines() or gmsh.logger.getLastError().strip().splitlines()
    return lines[-1] if lines else type(error).__name__
