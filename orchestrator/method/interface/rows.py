"""Traces are rows, one per load step: (T, D) from the black box to the laws; and what is done to
their columns.

A row lies together in memory, as a right-hand side does in a message and as components do in the
laws. Sparse matrices multiply columns, several of them in one go, so that ``times`` turns its
argument for the product alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from hashlib import blake2b

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from scipy.linalg.blas import daxpy

# eigenvalue of a Gram matrix, over the largest, that counts as zero: its fields depend on others
DEPENDENT = 1e-10


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


def peak(x: np.ndarray) -> float:
    """Return the largest magnitude of some numbers, 0 of none; nan stays."""
    return float(np.abs(x).max(initial=0.0))


def ratio(top: np.ndarray | float, bottom: np.ndarray,
          there: np.ndarray | bool = True) -> np.ndarray:
    """Return quotients where ``bottom`` is positive, and they are wanted; elsewhere 0."""
    result = np.zeros(np.broadcast_shapes(np.shape(top), bottom.shape))
    return np.divide(top, bottom, out=result, where=(bottom > 0) & there)


def bounds_of(lengths: Sequence[int] | np.ndarray) -> np.ndarray:
    """Return (n + 1,) where each of some runs begins, and the end of the last."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=int)])


def scattered(number: np.ndarray) -> np.ndarray:
    """Numbers between −1 and 1 of no symmetry, one for each whole number: the same whatever the
    ranks.
    """
    return np.modf(np.sin(number * 12.9898 + 1.0) * 43758.5453)[0]


def joined(parts: Sequence[np.ndarray], empty: tuple[int, ...] = (0,)) -> np.ndarray:
    """The parts one after the other; whole numbers of the shape ``empty`` where there are none."""
    return np.concatenate(parts) if parts else np.empty(empty, int)


def orthonormal(gram: np.ndarray, beside: float = 0.0) -> np.ndarray:
    """(n, n) R with which fields of this Gram matrix (n, n) become orthonormal, Rᵀ gram R = 1; its
    columns are zero where fields depend
    on others, or are nothing ``beside`` the square of a field that has been taken out of them."""
    size, vectors = np.linalg.eigh(gram)
    there = size > DEPENDENT * size.max(initial=beside)
    return np.where(there, vectors / np.sqrt(np.where(there, size, 1.0)), 0.0)


def eigenvalue(product: Callable[[np.ndarray], np.ndarray], size: int, end: str) -> float:
    """Return the largest ("LA") or least ("SA") eigenvalue of a symmetric matrix (size, size), to a
    hundredth, by its products."""
    start = np.random.default_rng(0).standard_normal(size)
    operator = sla.LinearOperator((size, size), matvec=product, dtype=float)
    return float(sla.eigsh(operator, k=1, which=end, tol=1e-2, v0=start,
                           return_eigenvectors=False)[0])


def narrow(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix with indices of 32 bits where they suffice: a third less to keep, and to read in
    every product.
    """
    if max(matrix.nnz, *matrix.shape) > np.iinfo(np.int32).max:
        return matrix
    return sp.csr_array((matrix.data, matrix.indices.astype(np.int32, copy=False),
                         matrix.indptr.astype(np.int32, copy=False)),
                        shape=matrix.shape)


def rows_of(points: np.ndarray, count: int) -> np.ndarray:
    """Return (3Q,) int, the rows of points (Q,) among ``count``, component after component."""
    return (np.arange(3)[:, None] * count + points).ravel()


def unit_rows(at: np.ndarray, size: int) -> sp.csr_array:
    """(Q, size) unit rows with their entries at columns (Q,), empty ones for −1."""
    there = at >= 0
    return sp.csr_array((np.ones(there.sum()), at[there], bounds_of(there)), shape=(len(at), size))


def block_diagonal(blocks: Sequence[np.ndarray], counts: Sequence[int]) -> sp.csr_array:
    """(sum of counts, sum of m) blocks (count, m) one after the other; zeros are no entries. Those
    of no rows keep their columns.
    """
    widths = np.array([b.shape[1] for b in blocks], dtype=int)
    values = np.concatenate(
        [np.empty(0), *(b.ravel() for b, count in zip(blocks, counts) if count)])
    width = np.repeat(widths, counts)  # of each row
    row, filled = np.repeat(np.arange(len(width)), width), np.flatnonzero(values)
    row = row[filled]
    column = filled + (np.repeat(np.cumsum(widths) - widths, counts)
                       - (np.cumsum(width) - width))[row]
    ends = bounds_of(np.bincount(row, minlength=len(width)))
    return narrow(sp.csr_array((values[filled], column, ends),
                               shape=(len(width), int(widths.sum()))))


def placed(blocks: Sequence[sp.csr_array], slots: Sequence[np.ndarray], size: int) -> sp.csr_array:
    """(size, size) the blocks (n, n) on the dofs (n,) of each; no dof belongs to two blocks."""
    slots = [np.asarray(at, np.int32) for at in slots]
    row = joined([np.repeat(at, np.diff(block.indptr)) for block, at in zip(blocks, slots)])
    column = joined([at[block.indices] for block, at in zip(blocks, slots)])
    return narrow(
        sp.csr_array((np.concatenate([np.empty(0), *(block.data for block in blocks)]),
                      (row, column)), shape=(size, size)))


class Blocks:
    """A matrix of blocks, those that are alike kept once: products with columns, its transpose, a
    diagonal.

    alone : (n, m) sparse, of the blocks that are like no other
    shared : per kind the block (r, c), and rows (k, r) and columns (k, c) of all that are like it,
        none of which is there twice
    """

    def __init__(self, alone: sp.csr_array,
                 shared: Sequence[tuple[sp.csr_array, np.ndarray, np.ndarray]]):
        self.alone, self.shared, self.shape = alone, shared, alone.shape

    @classmethod
    def symmetric(cls, blocks: Sequence[sp.csr_array], numbers: Sequence[int],
                  starts: Sequence[int], size: int) -> Blocks:
        """(size, size) from blocks (t, t) on dofs that lie together.

        blocks : the different ones; numbers, starts : which of them each is, and its first dof
        """
        numbers, starts = np.array(numbers, dtype=int), np.array(starts, dtype=int)
        members = np.bincount(numbers, minlength=len(blocks))
        spans = [np.arange(block.shape[0]) for block in blocks]
        at = {k: (starts[numbers == k][:, None] + spans[k]).astype(np.int32)
              for k in np.flatnonzero(members > 1)}
        lone = np.flatnonzero(members[numbers] == 1).tolist()
        return cls(placed([blocks[numbers[i]] for i in lone],
                          [starts[i] + spans[numbers[i]] for i in lone], size),
                   [(blocks[k], own, own) for k, own in at.items()])

    @classmethod
    def found(cls, matrix: sp.csr_array, groups: Sequence[Sequence[tuple[slice, slice]]]) -> Blocks:
        """A sparse matrix (n, m) whose rows all are in one block: alike are those of a group with
        the same numbers.

        groups : rows and columns of blocks; of one group no two share any
        """
        matrix.sort_indices()
        kinds: dict[tuple[int, bytes], list[tuple[slice, slice]]] = {}
        for number, group in enumerate(groups):
            for rows, columns in group:
                ends = matrix.indptr[rows.start : rows.stop + 1]
                within = slice(ends[0], ends[-1])
                key = digest(np.diff(ends), matrix.indices[within] - columns.start,
                             matrix.data[within])
                kinds.setdefault((number, key), []).append((rows, columns))
        several = [members for members in kinds.values() if len(members) > 1]
        shared = [(sp.csr_array(matrix[members[0][0]][:, members[0][1]]),
                   *(_together(each) for each in zip(*members))) for members in several]
        counts, kept = np.diff(matrix.indptr), np.ones(matrix.shape[0], dtype=bool)
        for _, rows, _ in shared:
            kept[rows] = False
        entries, ends = np.repeat(kept, counts), bounds_of(np.where(kept, counts, 0))
        return cls(
            narrow(sp.csr_array((matrix.data[entries], matrix.indices[entries], ends),
                                shape=matrix.shape)), shared)

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """Products with x (m,) or (m, T)."""
        result = self.alone @ x
        for block, rows, columns in self.shared:
            given = x[columns].swapaxes(0, 1)
            result[rows] += (block @ given.reshape(len(given), -1)).reshape(
                len(rows[0]), *given.shape[1:]).swapaxes(0, 1)
        return result

    @property
    def T(self) -> Blocks:
        """(m, n) its transpose."""
        return Blocks(self.alone.T,
                      [(block.T, columns, rows) for block, rows, columns in self.shared])

    def magnitudes(self) -> Blocks:
        """The same of magnitudes, which do not outlive a product: kept, they would take as much."""
        return Blocks(np.abs(self.alone),
                      [(np.abs(block), rows, columns) for block, rows, columns in self.shared])

    def diagonal(self) -> np.ndarray:
        """(n,) of a symmetric one."""
        result = self.alone.diagonal()
        for block, at, _ in self.shared:
            result[at] = block.diagonal()
        return result


def digest(*arrays: np.ndarray) -> bytes:
    """Sixteen bytes that tell equal arrays from others."""
    key = blake2b(digest_size=16)
    for array in arrays:
        key.update(array.tobytes())
    return key.digest()


def _together(slices: Sequence[slice]) -> np.ndarray:
    """(k, n) int32 what slices of one length hold."""
    return (np.array([each.start for each in slices])[:, None]
            + np.arange(slices[0].stop - slices[0].start)).astype(np.int32)


class ColumnSegments:
    """Columns that belong to subdomains, one after the other.

    parts : columns of each subdomain, without gaps; those that have none are left out

    subdomains : (S,) int, the others
    member : (columns,) int, place of each column's subdomain among these
    slices : the columns of each of them
    """

    def __init__(self, parts: Sequence[slice]):
        self.subdomains = np.array([e for e, part in enumerate(parts) if part.stop > part.start],
                                   dtype=int)
        self.slices = [parts[e] for e in self.subdomains]
        self.starts = np.array([part.start for part in self.slices], dtype=int)
        self.member = np.repeat(np.arange(len(self.starts)),
                                [part.stop - part.start for part in self.slices])

    def sums(self, x: np.ndarray) -> np.ndarray:
        """(…, S) of values (…, columns)."""
        return np.add.reduceat(x, self.starts,
                               axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def products(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(rows, S) sums of a · b, (rows, columns) each, and of their magnitudes."""
        return self.sums(a * b), self.sums(np.abs(a * b))

    def largest(self, x: np.ndarray) -> np.ndarray:
        """(rows, S) largest magnitude of values (rows, columns); nan where any is."""
        return np.maximum.reduceat(np.abs(x), self.starts,
                                   axis=-1) if len(self.starts) else np.zeros((*x.shape[:-1], 0))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(…, columns) to each column what its subdomain has of (…, S)."""
        return values.take(self.member, axis=-1)

    def rows(self, x: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(columns,) of values (rows, columns) another row for each subdomain, which (S,)."""
        return x[self.spread(which), np.arange(x.shape[1])]

    def lanczos(self, x: np.ndarray, product: Callable, image: Callable, steps: int) -> np.ndarray:
        """(S, steps, steps) Lanczos' matrices of C k, of each subdomain by itself, from x
        (columns,) on: their ends are near its own.

        product : x → k x, of the inner product; image : k x → C k x

        What is exhausted tells no other ends. What rounding leaves of orthogonality tells
        eigenvalues twice, but no other ones.
        """
        last, result = np.zeros_like(x), np.zeros((steps, steps, len(self.slices)))
        for j in range(steps):
            kx = product(x)
            size = np.sqrt(np.maximum(self.sums(x * kx), 0.0))
            there = size > (np.sqrt(DEPENDENT) * result[0, 0] if j else 0.0)
            if j:
                result[j - 1, j] = result[j, j - 1] = np.where(there, size, 0.0)
            scale = self.spread(ratio(1.0, size, there))
            x, kx = x * scale, kx * scale
            new = image(kx)
            result[j, j] = np.where(there, self.sums(new * kx), result[j - 1, j - 1])
            x, last = new - self.spread(result[j, j]) * x - self.spread(result[j, j - 1]) * last, x
        return result.transpose(2, 0, 1)
