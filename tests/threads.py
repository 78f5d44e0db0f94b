"""Ranks that are threads of one process; a matrix that ranks have parts of."""

import numpy as np
import scipy.sparse as sp

from benchmarks.kit.threads import Threads, among

__all__ = ["Threads", "among", "chain"]


def chain(ranks: int, each: int, definite: bool = True) -> list[tuple[sp.csr_array, np.ndarray, np.ndarray]]:
    """Parts of a matrix: neighbours in a ring share three unknowns; per rank its part, numbers, and what is shared."""
    rng, parts, total = np.random.default_rng(3), [], ranks * each
    for rank in range(ranks):
        number = np.sort(np.arange(rank * each, (rank + 1) * each + 3) % total)
        root = rng.standard_normal((len(number), len(number) if definite else 2))
        shared = (number % each < 3)
        parts.append((sp.csr_array(np.tril(root @ root.T + (np.eye(len(number)) if definite else 0.0))), number, shared))
    return parts
