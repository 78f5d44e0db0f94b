"""Linear stage: from the state s to admissible traces (paper, eqs. 13–14, 20, 30–33).

In displacement form all load steps are independent columns of one batch:

    u₁ = M⁻¹(f_d + Nᵀs)          the black box, all subdomains in parallel
    α  from u₁ (``macro``)       the multiplier
    u  = u₁ − V α,   w = N u,    f = s − k w − G α

s = f̂ + k ŵ is all that the linear stage needs of the local one. The map s ↦ (u, α, f) is affine,
so that affine combinations of its results are its results for the combined states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.linear.macro import Macro
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace


@dataclass
class Admissible:
    """Result of a linear stage, a column per load step.

    Parameters
    ----------
    s : (D, T) state it was computed from
    u : (B, T) displacement of the boundary dofs
    alpha : (size, T) macro multiplier
    w, f : (D, T) traces of displacement and interface forces
    """

    s: np.ndarray
    u: np.ndarray
    alpha: np.ndarray
    w: np.ndarray
    f: np.ndarray

    @classmethod
    def joined(cls, batches: Sequence[Admissible]) -> Admissible:
        """The fields of all load steps from those of batches of them, in order."""
        return cls(*(np.hstack([getattr(b, f.name) for b in batches]) for f in fields(cls)))

    def combined(self, weights: np.ndarray) -> Admissible:
        """Fields of T' load steps that are combinations of the present ones, weights (T, T')."""
        return Admissible(*(getattr(self, f.name) @ weights for f in fields(self)))


class LinearStage:
    """The linear stage of one decomposition.

    Parameters
    ----------
    space, direction : numbering and search direction
    macro : the macro problem, or None (mono-scale)
    loaded : (B, T) boundary values of M⁻¹f_d, computed once
    blackbox : the solver
    """

    def __init__(self, space: TraceSpace, direction: SearchDirection, macro: Macro | None,
                 loaded: np.ndarray, blackbox: BlackBox):
        self.space, self.direction, self.macro = space, direction, macro
        self.loaded, self.blackbox = loaded, blackbox

    def __call__(self, s: np.ndarray) -> Admissible:
        """Admissible fields for the state s (D, T); one back-substitution per subdomain and column.

        A zero state needs none: the loads' part is known.
        """
        u = self.loaded.copy()
        if s.any():
            u += self.solve(self.space.scatter @ s)
        alpha = np.zeros((0, s.shape[1]))
        if self.macro is not None:
            w = self.space.trace(u)
            alpha = self.macro.multiplier(w, s - self.direction.k @ w)
            u -= self.macro.displacement(alpha)
        return self.complete(s, u, alpha)

    def complete(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """Traces and forces that belong to (s, u, α)."""
        w = self.space.trace(u)
        return Admissible(s, u, alpha, w, self.robin_force(s, alpha) - self.direction.k @ w)

    def robin_force(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """(D, T) s − G α: the interface load that the extended subdomains are solved with."""
        return s if self.macro is None else s - self.macro.G @ alpha

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """(B, columns) M⁻¹ applied to boundary forces, restricted to the boundary dofs."""
        return self.space.join(self.blackbox.traces(self.space.split(forces)), forces.shape[1])
