"""Fields of bodies' traces and what the linear stage answers to them: what the coarse contact
problem moves bodies in.

    U,   V = k U,   W = N M⁻¹NᵀV,   F = V − k W

A body has as many fields as any other; those it lacks are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.interface.rows import orthonormal, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import LinearStage


@dataclass
class Responses:
    """Fields of each trace dof's own body and their response, of n fields.

    space : numbering of this rank's traces
    U, V, W, F : (n, D)
    u : (n, B) on boundary dofs
    """

    space: TraceSpace
    U: np.ndarray
    V: np.ndarray
    W: np.ndarray
    F: np.ndarray
    u: np.ndarray

    @property
    def body(self) -> np.ndarray:
        """(B,) int, the subdomain of each boundary dof."""
        return np.repeat(self.space.subdomains,
                         [part.stop - part.start for part in self.space.boundary])

    @classmethod
    def of(cls, stage: LinearStage, fields: np.ndarray, allowed: np.ndarray) -> Responses:
        """To combinations (own bodies, m, n) of fields (m, D), made orthonormal: U k Uᵀ = 1; what
        depends on others becomes zero.

        On a body that has a single plane interface, the gradients along its normal do. What the
        first half moves stays with the first half.
        """
        k, space = stage.direction.k, stage.space
        grams = per_body(space, fields, times(k, fields))
        R = np.array([_nested(gram, may) for gram, may in zip(grams, allowed)]).reshape(
            allowed.shape)
        U = combined(fields, R, space.parts)
        V = times(k, U)
        u = stage.solve(space.loads(V))
        W = space.trace(u)
        return cls(space, U, V, W, V - times(k, W), u)


def _nested(gram: np.ndarray, may: np.ndarray) -> np.ndarray:
    """(m, n) combinations of what a body may move in (m, n), orthonormal: the first half of them,
    then what these leave of the others.
    """
    half = may.shape[1] // 2
    first, others = may[:, :half], may[:, half:]
    return _beside(first @ orthonormal(first.T @ gram @ first), others, gram)


def _beside(first: np.ndarray, others: np.ndarray, gram: np.ndarray) -> np.ndarray:
    """(m, n) combinations: the first, which are orthonormal, and what they leave of the others,
    orthonormal.
    """
    largest = float(np.einsum("ij,ik,kj->j", others, gram, others).max(initial=0.0))
    others = others - first @ (first.T @ gram @ others)
    return np.hstack([first, others @ orthonormal(others.T @ gram @ others, largest)])


def combined(fields: np.ndarray, R: np.ndarray, parts: list[slice]) -> np.ndarray:
    """(n, D) combinations R (own bodies, m, n) of fields (m, D), of each body's own."""
    result = np.zeros((R.shape[2], fields.shape[1]))
    for part, r in zip(parts, R):
        np.matmul(r.T, fields[:, part], out=result[:, part])
    return result


def per_body(space: TraceSpace, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(own bodies, n, n) products of rows (n, D) over each body's trace dofs, which lie
    together.
    """
    result = np.zeros((len(space.subdomains), len(a), len(b)))
    for e, part in enumerate(space.parts):
        result[e] = a[:, part] @ b[:, part].T
    return result
