"""Linear stage: from the state s to admissible traces (paper, eq. 20; with macro continuity, eq. 38).

In displacement form all load steps are independent, rows of one batch:

    u₁ = M⁻¹(f_d + Nᵀs)          the black box, all subdomains in parallel, eq. 13 and eq. 30
    α  from u₁ (``macro``)       the multiplier, eq. 33
    u  = u₁ − V α,   w = N u,    f = s − k w − G α, eq. 32 and eq. 19

s = f̂ + k ŵ is all that the linear stage needs of the local one. The map s ↦ (u, α, f) is affine,
so that affine combinations of its results are its results for the combined states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.linear.macro import Macro
from orchestrator.method.linear.macro_blocks import MacroAnswers
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.traces import TraceSpace


@dataclass
class Admissible:
    """Result of a linear stage, a row per load step: an element of the set 𝒜, eq. 8."""

    s: np.ndarray  # (T, D) state it was computed from
    u: np.ndarray  # (T, B) displacement of the boundary dofs
    alpha: np.ndarray  # (T, size) macro multiplier
    w: np.ndarray  # (T, D) traces of displacement and interface forces
    f: np.ndarray
    space: TraceSpace  # numbering
    robin: np.ndarray | None = field(default=None, init=False, repr=False)  # (T, D) s − G α, where it is known already

    @classmethod
    def of_extended(cls, s: np.ndarray, u: np.ndarray, alpha: np.ndarray, w: np.ndarray, f: np.ndarray,
                    space: TraceSpace) -> Admissible:
        """From traces (T, D + G) whose ghosts are known already."""
        fields = cls(s, u, alpha, w[:, : space.size], f[:, : space.size], space)
        fields.extended = w, f
        return fields

    @cached_property
    def extended(self) -> tuple[np.ndarray, np.ndarray]:
        """w and f with the neighbours' values behind, (T, D + G) each: they travel once, whoever asks."""
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
    loaded : (T, B) boundary values of M⁻¹f_d, computed once
    known : (T, D) prescribed traces, None where there are none
    blackbox : the solver, its answers judged
    nonlinear : puts in what nonlinear subdomains truly do at the load step; None where none is
    """

    def __init__(self, space: TraceSpace, direction: SearchDirection, macro: Macro | None,
                 loaded: np.ndarray, known: np.ndarray | None, blackbox: GuardedTraces, nonlinear: Callable | None = None):
        self.space, self.direction, self.macro = space, direction, macro
        self.loaded, self.known, self.blackbox, self.nonlinear = loaded, known, blackbox, nonlinear

    def under(self, loaded: np.ndarray, known: np.ndarray | None, nonlinear: Callable | None = None) -> LinearStage:
        """The same for other load steps."""
        return LinearStage(self.space, self.direction, self.macro, loaded, known, self.blackbox, nonlinear)

    def __call__(self, s: np.ndarray) -> Admissible:
        """Admissible fields for the state s (T, D), eq. 20; one back-substitution per subdomain and row.

        A zero state needs none: the loads' part is known.
        """
        if self.nonlinear is not None:
            robin = self.space.loads(s)
            u = self.blackbox.answered(robin)[0] + self.loaded if s.any() else self.loaded.copy()
            self.nonlinear(u, robin)
            w = self.trace(u)
            return self._with_macro(s, u, w, self.direction.times(w))
        if s.any():
            return self._corrected(s, self.blackbox.answered(self.space.loads(s)))
        return self._with_macro(s, *(x.copy() for x in self._of_loads))

    def _corrected(self, s: np.ndarray, answers: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Admissible:
        """The fields of a state, given what it alone makes of u, w and k w, which is changed."""
        for mine, theirs in zip(answers, self._of_loads):
            mine += theirs
        return self._with_macro(s, *answers)

    def _with_macro(self, s: np.ndarray, u: np.ndarray, w: np.ndarray, kw: np.ndarray) -> Admissible:
        """The fields of a state from u (T, B), which is changed, w and k w (T, D) without the macro problem."""
        if self.macro is None:
            return Admissible(s, u, np.zeros((len(s), 0)), w, s - kw, self.space)
        alpha = self.macro.multiplier(w, s - kw)
        u -= self.macro.displacement(alpha)
        return self.complete(s, u, alpha)

    @cached_property
    def _of_loads(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """u (T, B), w and k w (T, D) of the loads alone."""
        w = self.trace(self.loaded)
        return self.loaded, w, self.direction.times(w)

    def ended(self, fields: Admissible) -> Admissible:
        """The fields that end a load step, asked for and committed where matter is nonlinear, under the forces of these."""
        if self.nonlinear is None:
            return fields
        u = fields.u.copy()
        self.nonlinear(u, self.space.loads(self.robin_force(fields.s, fields.alpha)), commit=True)
        return self.complete(fields.s, u, fields.alpha)

    def complete(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """Traces and forces that belong to (s, u, α): eq. 2 in the search direction of eq. 11, which makes eq. 14."""
        w, robin = self.trace(u), self.robin_force(s, alpha)
        fields = Admissible(s, u, alpha, w, robin - self.direction.times(w), self.space)
        fields.robin = robin
        return fields

    def difference(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """The same for differences of (s, u, α): nothing is prescribed."""
        w, robin = self.space.trace(u), self.robin_force(s, alpha)
        return Admissible(s, u, alpha, w, robin - self.direction.times(w), self.space)

    def trace(self, u: np.ndarray) -> np.ndarray:
        """(T, D) traces of the boundary displacements (T, B), with what is prescribed."""
        w = self.space.trace(u)
        return w if self.known is None else w + self.known

    def robin_of(self, fields: Admissible) -> np.ndarray:
        """(T, D) s − G α of fields, formed once."""
        if fields.robin is None:
            fields.robin = self.robin_force(fields.s, fields.alpha)
        return fields.robin

    def robin_force(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """(T, D) s − G α: what the extended subdomains are loaded with, eq. 19 (macro continuity: eq. 37)."""
        return s if self.macro is None else s - times(self.macro.G, alpha)

    def known_answers(self, h: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """What the macro columns tell of S⁺h, see ``MacroAnswers``; None without a macro problem."""
        if self.macro is None:
            return None
        if self.macro.known is None:
            starts = {part.start: e for e, part in enumerate(self.space.boundary) if part.stop > part.start}
            own = self.blackbox.soles([starts[int(at)] for block in self.macro.blocks
                                       for at in block.columns[: len(block.answers), 0]])
            self.macro.known = MacroAnswers(self.macro.blocks, own, starts)
        return self.macro.known(h)

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """(rows, B) M⁻¹ of eq. 13 applied to boundary forces (rows, B), restricted to the boundary dofs."""
        return self.blackbox.all_traces(forces, self.space.boundary)
