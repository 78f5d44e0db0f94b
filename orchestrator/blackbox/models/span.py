"""Right-hand sides that are combinations of others.

Images ask one model for what the same few fields do, each in its own axes: the macro forces of a face span the same space
however the face is turned. A basis of it is solved, and the answers are combined.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# What is left of a row outside the span of others, relative to the row, and is mere rounding.
ROUNDING = 1e-13


def spanned(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal rows (r, n) that span the rows of all parts, (m, n) each, and the weights (all m, r) that combine them.

    Rows of one part that are dependent are left as they are.
    """
    bases, weights = [], []  # of each part, what it adds; and its weights on all rows so far
    for rows in parts:
        size, rest, own = np.linalg.norm(rows, axis=1), rows, []
        for basis in bases:
            own.append(rest @ basis.T)
            rest = rest - own[-1] @ basis
        again = [rest @ basis.T for basis in bases]  # once more: what rounding has left
        for place, more in enumerate(again):
            own[place] = own[place] + more
            rest = rest - more @ bases[place]
        new = np.linalg.norm(rest, axis=1) > ROUNDING * size
        if new.any():
            q, r = np.linalg.qr(rest[new].T)
            bases.append(np.ascontiguousarray(q.T))
            mine = np.zeros((len(rows), q.shape[1]))
            mine[new] = r.T
            own.append(mine)
        weights.append(own)
    ends = np.cumsum([0] + [len(basis) for basis in bases])
    whole = np.zeros((sum(len(rows) for rows in parts), ends[-1]))
    start = 0
    for rows, own in zip(parts, weights):
        for block, a, b in zip(own, ends[:-1], ends[1:]):
            whole[start : start + len(rows), a:b] = block
        start += len(rows)
    return (np.vstack(bases) if bases else np.zeros((0, parts[0].shape[1]))), whole
