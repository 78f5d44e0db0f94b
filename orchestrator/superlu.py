"""Sparse symmetric matrices factorised by SuperLU, with pivots on the diagonal, and the order in which eliminating fills least."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla


def symmetric_lu(matrix: sp.sparray, order: str = "MMD_AT_PLUS_A") -> spla.SuperLU:
    """Factors of a symmetric matrix; ``order`` is SuperLU's word, minimum degree or NATURAL. RuntimeError: a pivot is exactly zero."""
    return spla.splu(sp.csc_array(matrix), permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def dissection(matrix: sp.sparray) -> np.ndarray:
    """(n,) int, a nested dissection of a symmetric pattern, by METIS: an elimination order of little fill."""
    pattern = sp.coo_array(matrix)
    row, column = pattern.coords
    off = row != column
    graph = sp.csr_array((np.ones(off.sum(), np.int8), (row[off], column[off])), shape=pattern.shape)
    if not graph.nnz:
        return np.arange(graph.shape[0])
    from orchestrator.optional import need  # servers of codes import the rest alone

    pymetis = need("pymetis")
    return np.asarray(pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))[0])
