"""Sums and maxima over the boundary dofs of each subdomain, for all of them at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.compiled import PART, compiled, in_parts


class Segments:
    """Columns that belong to subdomains, one after the other.

    Parameters
    ----------
    parts : columns of each subdomain, without gaps; those that have none are left out
    looped : by compiled loops, which read all once: for scenes whose stages are compiled anyway

    Attributes
    ----------
    subdomains : (S,) int, the others
    member : (columns,) int, place of each column's subdomain among these
    slices : the columns of each of them
    """

    def __init__(self, parts: Sequence[slice], looped: bool = False):
        self.subdomains = np.array([e for e, part in enumerate(parts) if part.stop > part.start], dtype=int)
        self.slices = [parts[e] for e in self.subdomains]
        self.starts = np.array([parts[e].start for e in self.subdomains], dtype=int)
        self.looped, self.ends = looped, np.array([parts[e].stop for e in self.subdomains], dtype=int)
        self.member = np.repeat(np.arange(len(self.starts)), [parts[e].stop - parts[e].start for e in self.subdomains])

    def sums(self, x: np.ndarray) -> np.ndarray:
        """(…, S) of values (…, columns)."""
        return np.add.reduceat(x, self.starts, axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def products(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(rows, S) sums of a · b, (rows, columns) each, and of their magnitudes."""
        if self.looped:
            result = np.empty((2, len(a), len(self.starts)))
            self._loop(_products, a, b, result)
            return result[0], result[1]
        both = a * b
        return self.sums(both), self.sums(np.abs(both, out=both))

    def largest(self, x: np.ndarray) -> np.ndarray:
        """(rows, S) largest magnitude of values (rows, columns); nan where any is."""
        if not len(self.starts):
            return np.zeros((*x.shape[:-1], 0))
        if self.looped:
            result = np.empty((len(x), len(self.starts)), dtype=np.int64)
            self._loop(_largest, np.ascontiguousarray(x).view(np.int64), result)
            return result.view(float)
        return np.maximum(np.maximum.reduceat(x, self.starts, axis=-1), -np.minimum.reduceat(x, self.starts, axis=-1))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(…, columns) to each column what its subdomain has of (…, S)."""
        return values.take(self.member, axis=-1)

    def rows(self, x: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(columns,) of values (rows, columns) another row for each subdomain, which (S,)."""
        if len(x) == 1 or len(which) and (which == which[0]).all():
            return x[which[0] if len(which) else 0]
        return x[self.spread(which), np.arange(x.shape[1])]

    def _loop(self, function, *arguments) -> None:
        columns = max(int(self.ends[-1] - self.starts[0]), 1) if len(self.starts) else 1
        in_parts(function, len(self.starts), self.starts, self.ends, *arguments,
                 part=max(1, PART * len(self.starts) // columns))


@compiled
def _products(start, stop, starts, ends, a, b, result):
    """``Segments.products`` of the subdomains from start to stop."""
    for t in range(len(a)):
        for e in range(start, stop):
            one, other, total, size = a[t, starts[e] : ends[e]], b[t, starts[e] : ends[e]], 0.0, 0.0
            for i in range(len(one)):
                product = one[i] * other[i]
                total += product
                size += abs(product)
            result[0, t, e], result[1, t, e] = total, size


@compiled
def _largest(start, stop, starts, ends, bits, result):
    """``Segments.largest`` of the subdomains from start to stop, of numbers as they are stored: without their signs they are
    ordered as integers are, and what is no number comes last."""
    for t in range(len(bits)):
        for e in range(start, stop):
            own, most = bits[t, starts[e] : ends[e]], np.int64(0)
            for i in range(len(own)):
                most = max(most, own[i] & np.int64(0x7FFFFFFFFFFFFFFF))
            result[t, e] = most
