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
    """Columns from start to stop of the result; four rows share what is read of the matrix, which is most of what is read."""
    whole = len(rows) - len(rows) % 4
    for t in range(0, whole, 4):
        one, two, three, four = rows[t], rows[t + 1], rows[t + 2], rows[t + 3]
        for i in range(start, stop):
            columns, values = indices[indptr[i] : indptr[i + 1]], data[indptr[i] : indptr[i + 1]]
            first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
            for j in range(len(columns)):
                value, column = values[j], columns[j]
                first += value * one[column]
                second += value * two[column]
                third += value * three[column]
                fourth += value * four[column]
            result[t, i], result[t + 1, i], result[t + 2, i], result[t + 3, i] = first, second, third, fourth
    for i in range(start, stop):
        columns, values = indices[indptr[i] : indptr[i + 1]], data[indptr[i] : indptr[i + 1]]
        for t in range(whole, len(rows)):
            row, total = rows[t], 0.0
            for j in range(len(columns)):
                total += values[j] * row[columns[j]]
            result[t, i] = total
