"""Cholesky's factorisation by SuiteSparse's CHOLMOD: the library that FreeFEM itself brings, called
without a compiler.

What is asked of it are functions that it has had since 2009, and settings at the head of a
structure that has kept its shape from its third to its fifth version (SuiteSparse 4 to 7). Any
other version is not taken; nor is a library whose defaults are not found where they should be.

One thread at a time is in the library: Debian's serial OpenBLAS, which it calls, has one workspace
for all threads. Two threads that solved with factors of their own got answers off by some per cent.
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

VERSIONS = (5, 4, 3)  # of its shared library whose settings are laid out alike
ROOM = 1 << 16  # bytes for the settings: more than any version takes
ORDERS = {"amd": 2, "metis": 3}  # minimum degree, nested dissection
SUPERNODAL, LOWER, LONG, REAL, DOUBLE, SYSTEM = 2, -1, 2, 1, 0, 0  # constants of cholmod.h
_ALONE = Lock()  # held by the thread that is in the library


_KINDS = {"double": c_double, "int": c_int, "size_t": c_size_t, "void*": c_void_p}


def _fields(declared: str) -> list[tuple[str, type]]:
    """Return the fields of a structure as C declares them, ``double a, b[2]; int c``."""
    found = []
    for line in declared.split(";"):
        kind, names = line.split(maxsplit=1)
        for name, _, count in (one.strip(" ]\n").partition("[") for one in names.split(",")):
            found.append((name, _KINDS[kind] * int(count) if count else _KINDS[kind]))
    return found


class _Method(ctypes.Structure):
    _fields_ = _fields("""double statistics[2], dense[2], separator[5]; size_t small[5];
        int switches[5], ordering; size_t other[4]""")


_KINDS["method"] = _Method


class _Settings(ctypes.Structure):
    """The head of ``cholmod_common``, as far as it is asked or set."""

    _fields_ = _fields("""double bound, grow0, grow1; size_t grow2, rank; double switch;
        int supernodal, final[6]; double zeros[3]; size_t relaxed[3];
        int zomplex, upper, quick_return, binary, print, precise, try_catch; void* handler;
        int methods, current, selected; method method[10]; int postorder""")


class _Sparse(ctypes.Structure):
    _fields_ = _fields("""size_t rows, columns, entries; void* p, i, nz, x, z;
        int part, index, kind, real, sorted, packed""")


class _Dense(ctypes.Structure):
    _fields_ = _fields("size_t rows, columns, entries, stride; void* x, z; int kind, real")


class _Factor(ctypes.Structure):
    """The head of ``cholmod_factor``: the first column whose pivot is not positive, or n."""

    _fields_ = _fields("size_t n, minor")


@cache
def library() -> ctypes.CDLL | None:
    """CHOLMOD, of the environment that Python runs in or else of the system; None where there is
    none that is known.
    """
    for version in VERSIONS:
        name = (
            f"libcholmod.{version}.dylib" if sys.platform == "darwin"
            else f"libcholmod.so.{version}")
        for place in (str(Path(sys.prefix, "lib", name)), name):
            try:
                found = ctypes.CDLL(place)
                found.cholmod_l_analyze.restype = POINTER(_Factor)
                if _as_expected(found):
                    return found
            except (OSError, AttributeError):
                continue
    return None


def _as_expected(found: ctypes.CDLL) -> bool:
    """Whether the defaults that cholmod.h tells are where they should be."""
    room = ctypes.create_string_buffer(ROOM)
    found.cholmod_l_start(room)
    s = _Settings.from_buffer(room)
    seen = (s.bound, s.grow0, s.grow1, s.grow2, s.rank, s.switch, s.supernodal, *s.relaxed, s.print,
            s.methods,
            s.method[1].dense[0], s.method[1].ordering, s.method[2].ordering, s.postorder)
    found.cholmod_l_finish(room)
    return seen == (0.0, 1.2, 1.2, 5, 8, 40.0, 1, 4, 16, 48, 3, 0, 10.0, ORDERS["amd"],
                    ORDERS["metis"], 1)


def factorised(lower: sp.csc_array, order: str) -> Cholesky | None:
    """A factorisation in an order of ``ORDERS``; None without the library, or where the matrix is
    not positive definite.

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
        settings.supernodal, settings.print = SUPERNODAL, 0
        settings.quick_return, settings.methods = 1, 1
        settings.method[0].ordering = ORDERS[order]
        matrix, _kept = _sparse(lower)
        with _ALONE:
            self._factor = found.cholmod_l_analyze(byref(matrix), self._room)
            done = self._factor and found.cholmod_l_factorize(
                byref(matrix), self._factor, self._room)
        # of a solution, and two to work in
        self._results = POINTER(_Dense)(), POINTER(_Dense)(), POINTER(_Dense)()
        weakref.finalize(self, _freed, found, self._room, self._factor, self._results)
        self.definite = bool(done) and self._factor.contents.minor == self.size

    def __call__(self, right: np.ndarray) -> np.ndarray:
        """Solutions (n, T) or (n,) for right-hand sides (n, T) or (n,)."""
        columns = np.asfortranarray(right.reshape(self.size, -1), dtype=float)
        given = _Dense(*columns.shape, columns.size, self.size, columns.ctypes.data, None, REAL,
                       DOUBLE)
        if not columns.size:
            return np.array(right, dtype=float)
        x, y, e = self._results
        with _ALONE:
            if not self._library.cholmod_l_solve2(SYSTEM, self._factor, byref(given), None,
                                                  byref(x), None, byref(y), byref(e),
                                                  self._room):
                raise MemoryError("CHOLMOD has no room for a solution")
            found = np.empty(columns.shape[::-1])
            # a cast would leave a cycle of references
            ctypes.memmove(found.ctypes.data, x.contents.x, found.nbytes)
        return found.T.reshape(right.shape)


def _sparse(lower: sp.csc_array) -> tuple[_Sparse, list[np.ndarray]]:
    """A matrix as CHOLMOD has them, and the arrays that have to outlive it."""
    lower.sort_indices()
    kept = [np.ascontiguousarray(lower.indptr, np.int64),
            np.ascontiguousarray(lower.indices, np.int64),
            np.ascontiguousarray(lower.data, float)]
    p, i, x = (array.ctypes.data for array in kept)
    return _Sparse(*lower.shape, lower.nnz, p, i, None, x, None, LOWER, LONG, REAL, DOUBLE, 1,
                   1), kept


def _freed(found, room, factor, results) -> None:
    for dense in results:
        found.cholmod_l_free_dense(byref(dense), room)
    found.cholmod_l_free_factor(byref(factor), room)
    found.cholmod_l_finish(room)
