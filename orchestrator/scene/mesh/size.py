"""How large a mesh would be, asked before it is made: a slip in h or a count must not take the machine's memory."""

from __future__ import annotations

import resource
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil

from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.mesh.faces import MAX_NODES

DENSITY = 0.82  # nodes per h³, measured
BYTES = 2200.0  # per node, that a mesh of tets and its faces take at most while they are made, measured
_GROUPS = Path("/sys/fs/cgroup")


def check_size(nodes: float, path: KeyPath, found: str, cure: Callable[[float], str]) -> None:
    """Raises InputError for a mesh of more nodes (estimated) than there may be, with what would do.

    path : the key that decides on it; found : what stands there; cure : factor that elements have to grow by → what to write
    """
    fit = memory_left() / BYTES
    if not nodes <= (most := min(fit, MAX_NODES)):
        expected = f"at most {MAX_NODES} nodes" if fit >= MAX_NODES else \
            f"at most {fit:.2g} nodes, in the {BYTES * fit / 1e9:.2g} GB of memory that are free"
        raise InputError(Problem(path, f"{found} makes about {nodes:.2g} nodes", expected, cure(1.05 * (nodes / most) ** (1 / 3))))


def coarser(h: float) -> Callable[[float], str]:
    """The cure of an element size that is too small."""
    return lambda factor: f"take h: {h * factor:.2g} or more"


def check_memory(needed: float, path: KeyPath, found: str, cure: str) -> None:
    """Raises InputError for what takes more bytes than are free, with both numbers."""
    if not needed <= (left := memory_left()):
        raise InputError(Problem(path, f"{found}: takes about {needed / 1e9:.2g} GB of memory",
                                 f"at most the {left / 1e9:.2g} GB that are free", cure))


def memory_left() -> float:
    """Bytes that this process can still take: free on the machine, in its group of processes, below its own limit."""
    left = [float(psutil.virtual_memory().available)]
    for most, used in (("memory.max", "memory.current"),
                       ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")):  # of containers
        with suppress(OSError, ValueError):
            left.append(float((_GROUPS / most).read_text()) - float((_GROUPS / used).read_text()))
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    if soft != resource.RLIM_INFINITY:
        left.append(float(soft - psutil.Process().memory_info().vms))
    return max(min(left), 0.0)
