"""Sums and maxima over the boundary dofs of each subdomain, for all of them at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class Segments:
    """Columns that belong to subdomains, one after the other.

    Parameters
    ----------
    parts : columns of each subdomain, without gaps; those that have none are left out

    Attributes
    ----------
    subdomains : (S,) int, the others
    member : (columns,) int, place of each column's subdomain among these
    slices : the columns of each of them
    """

    def __init__(self, parts: Sequence[slice]):
        self.subdomains = np.array([e for e, part in enumerate(parts) if part.stop > part.start], dtype=int)
        self.slices = [parts[e] for e in self.subdomains]
        self.starts = np.array([parts[e].start for e in self.subdomains], dtype=int)
        self.member = np.repeat(np.arange(len(self.starts)), [parts[e].stop - parts[e].start for e in self.subdomains])

    def sums(self, x: np.ndarray) -> np.ndarray:
        """(…, S) of values (…, columns)."""
        return np.add.reduceat(x, self.starts, axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def products(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(rows, S) sums of a · b, (rows, columns) each, and of their magnitudes."""
        both = a * b
        return self.sums(both), self.sums(np.abs(both, out=both))

    def largest(self, x: np.ndarray) -> np.ndarray:
        """(rows, S) largest magnitude of values (rows, columns); nan where any is."""
        if not len(self.starts):
            return np.zeros((*x.shape[:-1], 0))
        return np.maximum(np.maximum.reduceat(x, self.starts, axis=-1), -np.minimum.reduceat(x, self.starts, axis=-1))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(…, columns) to each column what its subdomain has of (…, S)."""
        return values.take(self.member, axis=-1)

    def rows(self, x: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(columns,) of values (rows, columns) another row for each subdomain, which (S,)."""
        if len(x) == 1 or len(which) and (which == which[0]).all():
            return x[which[0] if len(which) else 0]
        return x[self.spread(which), np.arange(x.shape[1])]
