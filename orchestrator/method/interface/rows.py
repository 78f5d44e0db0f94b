"""Traces are rows, one per load step: (T, D) from the black box to the laws; and what is done to their columns.

A row lies together in memory, as a right-hand side does in a message and as components do in the laws. Sparse matrices
multiply columns, several of them in one go, so that ``times`` turns its argument for the product alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import daxpy

DEPENDENT = 1e-10  # eigenvalue of a Gram matrix, over the largest, that counts as zero: its fields depend on others


def times(matrix: sp.sparray, rows: np.ndarray) -> np.ndarray:
    """(T, m) matrix (m, n) times each of the rows (T, n)."""
    if len(rows) == 1:
        return (matrix @ rows[0])[None]
    return np.ascontiguousarray((matrix @ rows.T).T)


def dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(T,) products of the rows of (T, n) with each other."""
    return np.einsum("ti,ti->t", a, b)


def add(rows: np.ndarray, factors: np.ndarray, others: np.ndarray) -> None:
    """rows (T, n) += factors (T,) times others (T, n), rounded once."""
    for row, factor, other in zip(rows, factors, others):
        row[:] = daxpy(other, row, a=factor) if row.size else row


def joined(parts: Sequence[np.ndarray], empty: tuple[int, ...] = (0,)) -> np.ndarray:
    """The parts one after the other; whole numbers of the shape ``empty`` where there are none."""
    return np.concatenate(parts) if parts else np.empty(empty, int)


def orthonormal(gram: np.ndarray, beside: float = 0.0) -> np.ndarray:
    """(n, n) R with which fields of this Gram matrix (n, n) become orthonormal, Rᵀ gram R = 1; its columns are zero where fields depend
    on others, or are nothing ``beside`` the square of a field that has been taken out of them."""
    size, vectors = np.linalg.eigh(gram)
    there = size > DEPENDENT * size.max(initial=beside)
    return np.where(there, vectors / np.sqrt(np.where(there, size, 1.0)), 0.0)


def narrow(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix with indices of 32 bits where they suffice: a third less to keep, and to read in every product."""
    if max(matrix.nnz, *matrix.shape) > np.iinfo(np.int32).max:
        return matrix
    return sp.csr_array((matrix.data, matrix.indices.astype(np.int32, copy=False), matrix.indptr.astype(np.int32, copy=False)),
                        shape=matrix.shape)


def fitting(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix in arrays no longer than its entries: a product's have room for zeros that it has left out."""
    return sp.csr_array((matrix.data[: matrix.nnz].copy(), matrix.indices[: matrix.nnz].copy(), matrix.indptr), shape=matrix.shape)


def unit_rows(at: np.ndarray, size: int) -> sp.csr_array:
    """(Q, size) unit rows with their entries at columns (Q,), empty ones for −1."""
    there = at >= 0
    return sp.csr_array((np.ones(there.sum()), at[there], np.concatenate([[0], np.cumsum(there)])), shape=(len(at), size))


def block_diagonal(blocks: Sequence[np.ndarray], counts: Sequence[int]) -> sp.csr_array:
    """(sum of counts, sum of m) blocks (count, m) one after the other; zeros are no entries. Those of no rows keep their columns."""
    widths = np.array([b.shape[1] for b in blocks], dtype=int)
    values = np.concatenate([np.empty(0), *(b.ravel() for b, count in zip(blocks, counts) if count)])
    width = np.repeat(widths, counts)  # of each row
    row, filled = np.repeat(np.arange(len(width)), width), np.flatnonzero(values)
    row = row[filled]
    column = filled + (np.repeat(np.cumsum(widths) - widths, counts) - (np.cumsum(width) - width))[row]
    ends = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(width)))])
    return narrow(sp.csr_array((values[filled], column, ends), shape=(len(width), int(widths.sum()))))


def placed(blocks: Sequence[sp.csr_array], slots: Sequence[np.ndarray], size: int) -> sp.csr_array:
    """(size, size) the blocks (n, n) on the dofs (n,) of each; no dof belongs to two blocks."""
    slots = [np.asarray(at, np.int32) for at in slots]
    row = joined([np.repeat(at, np.diff(block.indptr)) for block, at in zip(blocks, slots)])
    column = joined([at[block.indices] for block, at in zip(blocks, slots)])
    return narrow(sp.csr_array((np.concatenate([np.empty(0), *(block.data for block in blocks)]), (row, column)), shape=(size, size)))


class Blocks:
    """A symmetric matrix of blocks on dofs that lie together, those that are alike kept once; a product with columns, and a diagonal.

    blocks : (t, t), the different ones
    numbers, starts : which of them each is, and its first dof
    size : dofs in all
    """

    def __init__(self, blocks: Sequence[sp.csr_array], numbers: Sequence[int], starts: Sequence[int], size: int):
        numbers, starts, self.shape = np.array(numbers, dtype=int), np.array(starts, dtype=int), (size, size)
        members = np.bincount(numbers, minlength=len(blocks))
        spans = [np.arange(block.shape[0]) for block in blocks]
        self._shared = [(blocks[k], (starts[numbers == k][:, None] + spans[k]).astype(np.int32)) for k in np.flatnonzero(members > 1)]
        lone = np.flatnonzero(members[numbers] == 1).tolist()
        self._alone = placed([blocks[numbers[i]] for i in lone], [starts[i] + spans[numbers[i]] for i in lone], size)

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """Products with x (size,) or (size, T)."""
        result = self._alone @ x
        for block, at in self._shared:
            columns = x[at].swapaxes(0, 1)
            result[at] = (block @ columns.reshape(len(columns), -1)).reshape(columns.shape).swapaxes(0, 1)
        return result

    def diagonal(self) -> np.ndarray:
        """(size,)"""
        result = self._alone.diagonal()
        for block, at in self._shared:
            result[at] = block.diagonal()
        return result


class Segments:
    """Columns that belong to subdomains, one after the other.

    parts : columns of each subdomain, without gaps; those that have none are left out

    subdomains : (S,) int, the others
    member : (columns,) int, place of each column's subdomain among these
    slices : the columns of each of them
    """

    def __init__(self, parts: Sequence[slice]):
        self.subdomains = np.array([e for e, part in enumerate(parts) if part.stop > part.start], dtype=int)
        self.slices = [parts[e] for e in self.subdomains]
        self.starts = np.array([part.start for part in self.slices], dtype=int)
        self.member = np.repeat(np.arange(len(self.starts)), [part.stop - part.start for part in self.slices])

    def sums(self, x: np.ndarray) -> np.ndarray:
        """(…, S) of values (…, columns)."""
        return np.add.reduceat(x, self.starts, axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def products(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(rows, S) sums of a · b, (rows, columns) each, and of their magnitudes."""
        return self.sums(a * b), self.sums(np.abs(a * b))

    def largest(self, x: np.ndarray) -> np.ndarray:
        """(rows, S) largest magnitude of values (rows, columns); nan where any is."""
        return np.maximum.reduceat(np.abs(x), self.starts, axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(…, columns) to each column what its subdomain has of (…, S)."""
        return values.take(self.member, axis=-1)

    def rows(self, x: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(columns,) of values (rows, columns) another row for each subdomain, which (S,)."""
        return x[self.spread(which), np.arange(x.shape[1])]
