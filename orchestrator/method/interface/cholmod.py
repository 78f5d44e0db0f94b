"""Cholesky's factorisation by SuiteSparse's CHOLMOD: the library that FreeFEM itself brings, called without a compiler.

What is asked of it are functions that it has had since 2009, and settings at the head of a structure that has kept its shape from
its third to its fifth version (SuiteSparse 4 to 7). Any other version is not taken; nor is a library whose defaults are not found
where they should be.

One thread at a time is in the library: Debian's serial OpenBLAS, which it calls, has one workspace for all threads. Two threads that
solved with factors of their own got answers off by some per cent.
"""

from __future__ import annotations

import ctypes
import sys
import weakref
from ctypes import POINTER, byref, c_double, c_int, c_size_t, c_void_p
from functools import cache
from pathlib import Path
from threading import Lock

import numpy as np
import scipy.sparse as sp

VERSIONS = (5, 4, 3)
ROOM = 1 << 16  # bytes for the settings: more than any version takes
ORDERS = {"amd": 2, "metis": 3}  # minimum degree, nested dissection
SUPERNODAL, LOWER, LONG, REAL, DOUBLE, SYSTEM = 2, -1, 2, 1, 0, 0  # constants of cholmod.h
_ALONE = Lock()  # held by the thread that is in the library


class _Method(ctypes.Structure):
    _fields_ = [("statistics", c_double * 2), ("dense", c_double * 2), ("separator", c_double * 5), ("small", c_size_t * 5),
                ("switches", c_int * 5), ("ordering", c_int), ("other", c_size_t * 4)]


class _Settings(ctypes.Structure):
    """The head of ``cholmod_common``, as far as it is asked or set."""

    _fields_ = [("bound", c_double), ("grow0", c_double), ("grow1", c_double), ("grow2", c_size_t), ("rank", c_size_t),
                ("switch", c_double), ("supernodal", c_int), ("final", c_int * 6), ("zeros", c_double * 3),
                ("relaxed", c_size_t * 3), ("zomplex", c_int), ("upper", c_int), ("quick_return", c_int), ("binary", c_int),
                ("print", c_int), ("precise", c_int), ("try_catch", c_int), ("handler", c_void_p), ("methods", c_int),
                ("current", c_int), ("selected", c_int), ("method", _Method * 10), ("postorder", c_int)]


class _Sparse(ctypes.Structure):
    _fields_ = [("rows", c_size_t), ("columns", c_size_t), ("entries", c_size_t), ("p", c_void_p), ("i", c_void_p), ("nz", c_void_p),
                ("x", c_void_p), ("z", c_void_p), ("part", c_int), ("index", c_int), ("kind", c_int), ("real", c_int),
                ("sorted", c_int), ("packed", c_int)]


class _Dense(ctypes.Structure):
    _fields_ = [("rows", c_size_t), ("columns", c_size_t), ("entries", c_size_t), ("stride", c_size_t), ("x", c_void_p),
                ("z", c_void_p), ("kind", c_int), ("real", c_int)]


class _Factor(ctypes.Structure):
    """The head of ``cholmod_factor``: the first column whose pivot is not positive, or n."""

    _fields_ = [("n", c_size_t), ("minor", c_size_t)]


@cache
def library() -> ctypes.CDLL | None:
    """CHOLMOD, of the environment that Python runs in or else of the system; None where there is none that is known."""
    for version in VERSIONS:
        name = f"libcholmod.{version}.dylib" if sys.platform == "darwin" else f"libcholmod.so.{version}"
        for place in (str(Path(sys.prefix, "lib", name)), name):
            try:
                found = _declared(ctypes.CDLL(place))
            except (OSError, AttributeError):
                continue
            if _as_expected(found):
                return found
    return None


def _declared(found: ctypes.CDLL) -> ctypes.CDLL:
    room, sparse, dense, factor = c_void_p, POINTER(_Sparse), POINTER(_Dense), POINTER(_Factor)
    for name, result, arguments in (
            ("start", c_int, [room]), ("finish", c_int, [room]), ("analyze", factor, [sparse, room]),
            ("factorize", c_int, [sparse, factor, room]), ("free_factor", c_int, [POINTER(factor), room]),
            ("free_dense", c_int, [POINTER(dense), room]),
            ("solve2", c_int, [c_int, factor, dense, c_void_p, POINTER(dense), c_void_p, POINTER(dense), POINTER(dense), room])):
        function = getattr(found, f"cholmod_l_{name}")
        function.restype, function.argtypes = result, arguments
    return found


def _as_expected(found: ctypes.CDLL) -> bool:
    """Whether the defaults that cholmod.h tells are where they should be."""
    room = ctypes.create_string_buffer(ROOM)
    found.cholmod_l_start(room)
    s = _Settings.from_buffer(room)
    seen = (s.bound, s.grow0, s.grow1, s.grow2, s.rank, s.switch, s.supernodal, *s.relaxed, s.print, s.methods,
            s.method[1].dense[0], s.method[1].ordering, s.method[2].ordering, s.postorder)
    found.cholmod_l_finish(room)
    return seen == (0.0, 1.2, 1.2, 5, 8, 40.0, 1, 4, 16, 48, 3, 0, 10.0, ORDERS["amd"], ORDERS["metis"], 1)


def factorised(lower: sp.csc_array, order: str) -> Cholesky | None:
    """A factorisation in an order of ``ORDERS``; None without the library, or where the matrix is not positive definite.

    lower : (n, n), n > 0, the lower triangle
    """
    found = library()
    if found is None:
        return None
    factor = Cholesky(found, lower, order)
    return factor if factor.definite else None


class Cholesky:
    """L Lᵀ of a symmetric positive definite matrix; a call solves with it.

    definite : whether it is one; if not there is nothing to call
    """

    def __init__(self, found: ctypes.CDLL, lower: sp.csc_array, order: str):
        self._library, self._room = found, ctypes.create_string_buffer(ROOM)
        self.size = lower.shape[0]
        found.cholmod_l_start(self._room)
        settings = _Settings.from_buffer(self._room)
        settings.supernodal, settings.print, settings.quick_return, settings.methods = SUPERNODAL, 0, 1, 1
        settings.method[0].ordering = ORDERS[order]
        matrix, _kept = _sparse(lower)
        with _ALONE:
            self._factor = found.cholmod_l_analyze(byref(matrix), self._room)
            done = self._factor and found.cholmod_l_factorize(byref(matrix), self._factor, self._room)
        self._results = POINTER(_Dense)(), POINTER(_Dense)(), POINTER(_Dense)()  # of a solution, and two to work in
        weakref.finalize(self, _freed, found, self._room, self._factor, self._results)
        self.definite = bool(done) and self._factor.contents.minor == self.size

    def __call__(self, right: np.ndarray) -> np.ndarray:
        """Solutions (n, T) or (n,) for right-hand sides (n, T) or (n,)."""
        columns = np.asfortranarray(right.reshape(self.size, -1), dtype=float)
        given = _Dense(*columns.shape, columns.size, self.size, columns.ctypes.data, None, REAL, DOUBLE)
        if not columns.size:
            return np.array(right, dtype=float)
        x, y, e = self._results
        with _ALONE:
            if not self._library.cholmod_l_solve2(SYSTEM, self._factor, byref(given), None, byref(x), None, byref(y), byref(e),
                                                  self._room):
                raise MemoryError("CHOLMOD has no room for a solution")
            found = np.empty(columns.shape[::-1])
            ctypes.memmove(found.ctypes.data, x.contents.x, found.nbytes)  # a cast would leave a cycle of references
        return found.T.reshape(right.shape)


def _sparse(lower: sp.csc_array) -> tuple[_Sparse, list[np.ndarray]]:
    """A matrix as CHOLMOD has them, and the arrays that have to outlive it."""
    lower.sort_indices()
    kept = [np.ascontiguousarray(lower.indptr, np.int64), np.ascontiguousarray(lower.indices, np.int64),
            np.ascontiguousarray(lower.data, float)]
    p, i, x = (array.ctypes.data for array in kept)
    return _Sparse(*lower.shape, lower.nnz, p, i, None, x, None, LOWER, LONG, REAL, DOUBLE, 1, 1), kept


def _freed(found, room, factor, results) -> None:
    for dense in results:
        found.cholmod_l_free_dense(byref(dense), room)
    found.cholmod_l_free_factor(byref(factor), room)
    found.cholmod_l_finish(room)
