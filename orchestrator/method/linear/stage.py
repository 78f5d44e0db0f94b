"""Linear stage: from the state s to admissible traces (paper, eq. 20; with macro continuity,
eq. 38).

In displacement form all load steps are independent, rows of one batch:

    u₁ = M⁻¹(f_d + Nᵀs)          the black box, all subdomains in parallel, eq. 13 and eq. 30
    α  from u₁ (``macro``)       the multiplier, eq. 33
    u  = u₁ − V α,   w = N u,    f = s − k w − G α, eq. 32 and eq. 19

s = f̂ + k ŵ is all that the linear stage needs of the local one. The map s ↦ (u, α, f) is affine,
so that affine combinations of its results are its results for the combined states.

Linear stage, macro problem and coarse contact problem are set up once, with the elastic M. Where
matter is nonlinear, what a subdomain truly does under the same forces is asked of its code at every
stage, one load step at a time,

    u = advance(f_ext + Nᵀs),      δ = u − M⁻¹(f_d + Nᵀs)

and δ is added to what the stage finds: the elastic problems then extrapolate from the true answer.
At the fixed point they correct nothing (α = 0, y = 0), so that what is found is the true answer's.
At the end of a load step it is committed, with the forces that it ended with. Its pseudo-loads

    p = K u − r(u)      (on all dofs; r: the forces that u needs; zero where matter and soles are
                        elastic)

make the elastic problem answer u: M u_free = f_d + Nᵀs + p. As loads of the scene they serve all
that is delivered: fields, reactions, balance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.linear.loading import Loading
from orchestrator.method.linear.macro import Macro
from orchestrator.scene.model import Subdomain


@dataclass
class Admissible:
    """Result of a linear stage, a row per load step: an element of the set 𝒜, eq. 8."""

    s: np.ndarray  # (T, D) state it was computed from
    u: np.ndarray  # (T, B) displacement of the boundary dofs
    alpha: np.ndarray  # (T, size) macro multiplier
    w: np.ndarray  # (T, D) traces of displacement and interface forces
    f: np.ndarray
    space: TraceSpace  # numbering
    # (T, D + G) traces of displacement at which springs of stabilisation carry nothing; None: those
    # of the load step before
    anchor: np.ndarray | None = field(default=None, init=False, repr=False)

    @classmethod
    def of_extended(cls, s: np.ndarray, u: np.ndarray, alpha: np.ndarray, w: np.ndarray,
                    f: np.ndarray,
                    space: TraceSpace, anchor: np.ndarray | None = None) -> Admissible:
        """From traces (T, D + G) whose ghosts are known already."""
        fields = cls(s, u, alpha, w[:, : space.size], f[:, : space.size], space)
        fields.extended, fields.anchor = (w, f), anchor
        return fields

    @cached_property
    def extended(self) -> tuple[np.ndarray, np.ndarray]:
        """w and f with the neighbours' values behind, (T, D + G) each: they travel once, whoever
        asks.
        """
        return self.space.extended(self.w, self.f)

    @property
    def rows(self) -> tuple[np.ndarray, ...]:
        """All that has a row per load step."""
        return self.s, self.u, self.alpha, self.w, self.f

    @classmethod
    def joined(cls, batches: Sequence[Admissible]) -> Admissible:
        """The fields of all load steps from those of batches of them, in order."""
        return cls(*(np.vstack(same) for same in zip(*(b.rows for b in batches))), batches[0].space)

    def combined(self, weights: np.ndarray) -> Admissible:
        """Fields of T' load steps that are combinations of the present ones, weights (T, T')."""
        return Admissible(*(weights.T @ x for x in self.rows), self.space)


class LinearStage:
    """The linear stage of one decomposition.

    space, direction : numbering and search direction
    macro : the macro problem, or None (mono-scale)
    loading : what the loads give on their own, computed once
    blackbox : the solver, its answers judged
    nonlinear : puts in what nonlinear subdomains truly do at the load step; None where none is
    """

    def __init__(self, space: TraceSpace, direction: SearchDirection, macro: Macro | None,
                 loading: Loading, blackbox: GuardedTraces, nonlinear: Callable | None = None):
        self.space, self.direction, self.macro = space, direction, macro
        self.loading, self.blackbox, self.nonlinear = loading, blackbox, nonlinear

    def under(self, loading: Loading, nonlinear: Callable | None = None) -> LinearStage:
        """The same for other load steps."""
        return LinearStage(self.space, self.direction, self.macro, loading, self.blackbox,
                           nonlinear)

    def __call__(self, s: np.ndarray) -> Admissible:
        """Admissible fields for the state s (T, D), eq. 20; one back-substitution per subdomain and
        row.

        A zero state needs none: the loads' part is known.
        """
        u, forces = self.loading.boundary.copy(), self.space.loads(s)
        if s.any():
            u += self.solve(forces)
        if self.nonlinear is not None:
            self.nonlinear(u, forces)
        if self.macro is None:
            return self.complete(s, u, np.zeros((len(s), 0)))
        w = self.trace(u)
        alpha = self.macro.multiplier(w, s - self.direction.times(w))
        return self.complete(s, u - self.macro.displacement(alpha), alpha)

    def ended(self, fields: Admissible) -> Admissible:
        """The fields that end a load step, asked for and committed where matter is nonlinear, under
        the forces of these.
        """
        if self.nonlinear is None:
            return fields
        u = fields.u.copy()
        self.nonlinear(u, self.space.loads(self.robin_of(fields)), commit=True)
        return self.complete(fields.s, u, fields.alpha)

    def complete(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """Traces and forces that belong to (s, u, α): eq. 2 in the search direction of eq. 11,
        which makes eq. 14.
        """
        w = self.trace(u)
        f = self.robin_force(s, alpha) - self.direction.times(w)
        return Admissible(s, u, alpha, w, f, self.space)

    def trace(self, u: np.ndarray) -> np.ndarray:
        """(T, D) traces of the boundary displacements (T, B), with what is prescribed."""
        return self.space.trace(u, self.loading.known)

    def robin_of(self, fields: Admissible) -> np.ndarray:
        """(T, D) s − G α of fields."""
        return self.robin_force(fields.s, fields.alpha)

    def robin_force(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """(T, D) s − G α: what the extended subdomains are loaded with, eq. 19 (macro continuity:
        eq. 37).
        """
        return s if self.macro is None else s - self.macro.force(alpha)

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """(rows, B) M⁻¹ of eq. 13 applied to boundary forces (rows, B), restricted to the boundary
        dofs.
        """
        return self.blackbox.all_traces(forces, self.space.boundary)


class Nonlinear:
    """The nonlinear subdomains of one decomposition.

    own : the subdomains in the order of ``space.subdomains``; some remember load steps
    traces : per subdomain (t,) its boundary dofs in local numbering
    dofs : per subdomain, dofs of its extended mesh
    reload : the loading, from the subdomains' loads as they are
    """

    def __init__(self, blackbox: BlackBox, space: TraceSpace, own: Sequence[Subdomain],
                 traces: Sequence[np.ndarray],
                 dofs: Sequence[int], reload: Callable[[], Loading]):
        self.blackbox, self.space, self.own = blackbox, space, own
        self.traces, self.dofs, self.reload = traces, dofs, reload
        self.members = [e for e, s in enumerate(own) if s.remembers]
        self.external = {e: own[e].loads.copy() for e in self.members}  # without pseudo-loads

    def put(self, step: int, u: np.ndarray, robin: np.ndarray, commit: bool = False) -> None:
        """Put true answers at a load step into boundary displacements (1, B), given the boundary
        forces (1, B) behind them.

        commit : the step ends with them, and pseudo-loads are added to the subdomains' loads
        """
        given = {}
        for e in self.members:
            s, forces = self.own[e], np.zeros(self.dofs[e])
            forces[: 3 * len(s.nodes)] = np.where(s.fixed, s.prescribed[step],
                                                  self.external[e][step]).ravel()
            forces[self.traces[e]] += robin[0, self.space.boundary[e]]
            given[e] = forces
        for e, answer in self.blackbox.advance(given, commit).items():
            u[0, self.space.boundary[e]] = answer[0, self.traces[e]]
            if commit:
                s = self.own[e]
                s.loads[step] = self.external[e][step] + answer[1, : s.loads[step].size].reshape(
                    -1, 3)

    def foresee(self, step: int) -> None:
        """Give a load step the pseudo-loads of the one before: what has flown stays."""
        for e in self.members:
            before = self.own[e].loads[step - 1] - self.external[e][step - 1] if step else 0.0
            self.own[e].loads[step] = self.external[e][step] + before
