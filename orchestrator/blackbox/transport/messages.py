"""The bytes exchanged with a subdomain server, the same through pipes and files.

A request is ``op, ints[], reals[]``, a reply ``ints[], seconds[], reals[]``; an array is an int64
count followed by its entries. ``freefem_scripts/subdomain_server.edp`` is the other end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.scene.elasticity import lame

# operations, by the numbers that the codes' scripts know them by
LOAD, TRACES, FIELDS, STIFFNESS, QUIT, OWN_LOADS, ADVANCE = 1, 2, 3, 4, 5, 6, 7
ELEMENTS = {4: 1, 10: 2}  # by nodes of a tet
# Of the ten nodes of a tet in our order, that of the messages, FreeFEM's: its edges are 01, 02, 03,
# 12, 13, 23.
EDGE_ORDER = [0, 1, 2, 3, 4, 6, 7, 5, 8, 9]
# Relative residuals of a probe solve. Measured: below 1e-9 on sound models, above 5e-3 on singular
# ones.
RESIDUAL_LIMIT, SINGULAR = 1e-6, 1e-3
_LARGEST = 2**36  # bytes of one array; a larger count is not a count

Buffers = list[bytes | memoryview]
ReadInto = Callable[[memoryview], None]


class BadReply(Exception):
    """The bytes received are no sound reply. ``cause``, if any, is a probable one."""

    def __init__(self, what: str, cause: str = ""):
        super().__init__(what + (f" (probable cause: {cause})" if cause else ""))


@dataclass
class Reply:
    """One reply. ``seconds`` are the server's own: assemble, factorise, solve."""

    ints: np.ndarray
    seconds: np.ndarray
    reals: np.ndarray


def of_ints(values) -> bytes:
    """An array of whole numbers."""
    values = np.ascontiguousarray(values, np.int64)
    return np.int64(values.size).tobytes() + values.tobytes()


def of_reals(arrays: Sequence[np.ndarray]) -> Buffers:
    """An array of reals, of several one after the other."""
    arrays = [np.ascontiguousarray(a, np.float64).ravel() for a in arrays]
    head = np.int64(sum(a.size for a in arrays)).tobytes()
    return [head] + [a.data.cast("B") for a in arrays if a.size]


def request(op: int, ints, reals: Sequence[np.ndarray]) -> Buffers:
    """An operation with its whole numbers and reals."""
    return [np.int64(op).tobytes(), of_ints(ints), *of_reals(reals)]


def about(op: int, index: int, model: Model, *more: int) -> Buffers:
    """Request about the model of a mesh file: LOAD, to clamp and factorise it; STIFFNESS, for the
    matrix with nothing clamped; OWN_LOADS,
    for the nodal forces that the code's own model has at so many load steps as ``more`` says."""
    head = [[index, ELEMENTS[model.cells.shape[1]], model.fixed.size], more]
    if op == LOAD:
        fixed = np.flatnonzero(model.fixed)
        head += [len(model.trace), len(fixed)], model.trace, fixed
    # of ten-node tets the nodes' numbers, from which a code learns ours; of others they agree
    numbers = np.empty(0, int) if model.cells.shape[1] == 4 else model.cells[:, EDGE_ORDER].ravel()
    return request(op, np.concatenate([np.asarray(part, int) for part in (*head, numbers)]),
                   lame(*model.materials.T))


def solve(op: int, jobs: Sequence[tuple[int, np.ndarray]]) -> Buffers:
    """Back-substitutions of (model, (rhs, m) forces) pairs; ``op`` is TRACES or FIELDS."""
    head = [len(jobs)] + [value for index, forces in jobs for value in (index, len(forces))]
    return request(op, head, [forces for _, forces in jobs])


FAREWELL = np.int64(QUIT).tobytes()  # end of the conversation


def read_reply(read_into: ReadInto) -> Reply:
    """Raises BadReply on counts that cannot be, and whatever ``read_into`` raises."""
    return Reply(_array(read_into, np.int64), _array(read_into, np.float64),
                 _array(read_into, np.float64))


def _array(read_into: ReadInto, dtype) -> np.ndarray:
    count = np.zeros(1, np.int64)
    read_into(count.data.cast("B"))
    if not 0 <= count[0] <= _LARGEST // 8:
        raise BadReply(f"an array of {count[0]} entries was announced")
    values = np.empty(count[0], dtype)
    if values.size:
        read_into(values.data.cast("B"))
    return values


def _check(reply: Reply, index: int, ints: int) -> None:
    if len(reply.ints) < ints or len(reply.seconds) != 3 or reply.ints[0] != index:
        raise BadReply(f"the reply does not belong to the request (head {reply.ints[:4].tolist()})")
    if reply.ints[1] != 0:
        raise BadReply(f"the server refused: status {reply.ints[1]}")


def check_hello(reply: Reply) -> int:
    """Read the server's greeting: bit 0 set, it is translation invariant; bit 1, its matter is its
    own; bit 2, nonlinear. Raises
    BadReply unless it introduced itself."""
    _check(reply, 0, 2)
    return int(reply.ints[2]) if len(reply.ints) > 2 else 0


def check_load(reply: Reply, index: int) -> None:
    """Raises BadReply when the factorisation cannot be trusted."""
    _check(reply, index, 4)
    if reply.ints[3] != 1 or len(reply.reals) != 1:
        raise BadReply(
            "the matrix is not stored as a symmetric half: CHOLMOD would give wrong numbers")
    check_residual(reply.reals[0])


def check_residual(residual: float) -> None:
    """Raises BadReply when a solve left a relative residual that a sound factorisation does not
    leave.
    """
    left = (
        f"a probe solve left a relative residual of {residual:.1e}, expected at most "
        f"{RESIDUAL_LIMIT:.0e}")
    if not residual <= SINGULAR:  # NaN included
        raise BadReply(f"the factorised matrix is singular: {left}",
                       "a part is not held, or has a zero or absurd modulus")
    if residual > RESIDUAL_LIMIT:
        raise BadReply(f"the factorised matrix is too close to singular: {left}",
            "a part that is barely held or very slender, or moduli of extreme contrast")


def check_solve(reply: Reply, index: int, rhs: int, size: int) -> np.ndarray:
    """The (rhs, size) displacements; raises BadReply on wrong sizes or numbers that are not
    finite.
    """
    _check(reply, index, 2)
    if reply.reals.size != rhs * size:
        raise BadReply(f"{reply.reals.size} displacements received, {rhs} x {size} expected")
    if not np.isfinite(reply.reals).all():
        raise BadReply("displacements are not finite",
                       "the forces are not, or the matrix is close to singular")
    return reply.reals.reshape(rhs, size)


def check_own_loads(reply: Reply, index: int, steps: int, size: int) -> np.ndarray:
    """The (steps, size) forces, zero where the model has none; raises BadReply."""
    _check(reply, index, 2)
    if reply.reals.size not in (0, steps * size):
        raise BadReply(f"{reply.reals.size} nodal forces received, {steps} x {size} expected")
    if not np.isfinite(reply.reals).all():
        raise BadReply("its own loads are not finite")
    return reply.reals.reshape(steps, size) if reply.reals.size else np.zeros((steps, size))


def check_stiffness(reply: Reply, index: int, dofs: int) -> sp.csr_array:
    """The symmetric (dofs, dofs) matrix, padding dropped; raises BadReply."""
    _check(reply, index, 4)
    entries = int(reply.ints[3])
    if len(reply.ints) != 4 + 2 * entries or len(reply.reals) != entries:
        raise BadReply(f"a matrix of {entries} entries came with {len(reply.reals)} values")
    if not np.isfinite(reply.reals).all():
        raise BadReply("the stiffness matrix has entries that are not finite",
                       "a degenerate tet or an absurd modulus")
    rows, columns = reply.ints[4 : 4 + entries], reply.ints[4 + entries :]
    keep = (rows < dofs) & (columns < dofs) & (reply.reals != 0)
    rows, columns, values = rows[keep].astype(np.int32), columns[keep].astype(
        np.int32), reply.reals[keep]
    mirrored = np.flatnonzero(rows != columns)
    indices = np.concatenate([rows, columns[mirrored]]), np.concatenate([columns, rows[mirrored]])
    return sp.csr_array((np.concatenate([values, values[mirrored]]), indices), shape=(dofs, dofs))
