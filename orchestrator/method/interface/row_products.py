"""Products of sparse matrices with rows as they lie, compiled: nothing is turned, and all cores work.

For scenes with laws, whose stages are compiled anyway; where all is bonded ``rows.times`` needs no compiler.
"""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled, in_parts


def compiled_times(matrix, rows: np.ndarray) -> np.ndarray:
    """(T, m) a sparse matrix (m, n) by rows times each of the rows (T, n)."""
    result = np.empty((len(rows), matrix.shape[0]))
    in_parts(_times, matrix.shape[0], matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(rows), result)
    return result


@compiled
def _times(start, stop, indptr, indices, data, rows, result):
    """Columns from start to stop of the result."""
    for i in range(start, stop):
        columns, values = indices[indptr[i] : indptr[i + 1]], data[indptr[i] : indptr[i + 1]]
        for t in range(len(rows)):
            row, total = rows[t], 0.0
            for j in range(len(columns)):
                total += values[j] * row[columns[j]]
            result[t, i] = total
