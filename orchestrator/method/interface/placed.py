"""Large sparse matrices made of small ones, each placed on dofs of its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models.assembly import Block


def placed(blocks: Sequence[Block], slots: Sequence[np.ndarray], size: int) -> sp.csr_array:
    """(size, size) the blocks (n, n) on the dofs (n,) of each; no dof belongs to two blocks.

    One and the same block on many places is put there in one go.
    """
    alike: dict[int, list[int]] = {}
    for number, block in enumerate(blocks):
        alike.setdefault(id(block), []).append(number)
    groups = [(blocks[members[0]], np.stack([slots[i] for i in members])) for members in alike.values()]
    counts = np.zeros(size, dtype=np.int64)
    for block, at in groups:
        counts[at] = np.diff(block.indptr)
    total = int(counts.sum())
    kind = np.int32 if max(total, size) < np.iinfo(np.int32).max else np.int64
    ends = np.concatenate([[0], np.cumsum(counts)]).astype(kind)
    columns, values = np.empty(total, dtype=kind), np.empty(total)
    for block, at in groups:
        at = at.astype(kind)
        run = (np.diff(at, axis=1) == 1).all(axis=1) & (block.nnz > 0)  # dofs one after the other: so are their entries
        for first in at[run, :1].ravel().tolist():
            entries = slice(ends[first], ends[first] + block.nnz)
            np.add(block.indices, first, out=columns[entries], casting="same_kind")
            values[entries] = block.data
        if not run.all():
            row, others = np.repeat(np.arange(block.shape[0]), np.diff(block.indptr)), at[~run]
            entry = ends[others][:, row] + (np.arange(block.nnz) - block.indptr[row])
            columns[entry], values[entry] = others[:, block.indices], block.data
    return sp.csr_array((values, columns, ends), shape=(size, size))
