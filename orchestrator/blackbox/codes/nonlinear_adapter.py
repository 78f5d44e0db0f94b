"""The base of nonlinear solvers written in Python: forces and tangent of the matter suffice, Newton's method is here.

    from orchestrator.blackbox.codes.nonlinear_adapter import NonlinearAdapter

    class Solver(NonlinearAdapter):                    # blackbox: {code: my_solver.py, nonlinear: true}
        def stiffness(self, model):                    # elastic, of all tets, as in ``Adapter``
            ...
        def response(self, model, u, history):         # of the body, without soles
            return forces, tangent, new_history

Whoever has an iteration of their own derives from ``Adapter``, says ``nonlinear = own_matter = True`` and writes ``advance``
and ``commit``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from orchestrator.blackbox.codes.adapter import Adapter

# Relative, of the forces: Newton's method ends below it, or at rounding where it gets no further and is below ENOUGH. What
# is left must be far below the residual of the coupling.
BALANCED, ENOUGH = 1e-13, 1e-10
ITERATIONS, HALVINGS = 50, 8  # more do not help: the load step is too large


class NonlinearAdapter(Adapter):
    """Solves load steps one after the other, each from where the last one was committed.

    Attributes
    ----------
    nonlinear : ``advance`` and ``commit`` are asked, as the entry's ``nonlinear: true`` says
    """

    own_matter = nonlinear = True

    def response(self, model: Any, u: np.ndarray, history: Any) -> tuple[np.ndarray, sp.csr_array, Any]:
        """What displacements need at the end of a load step.

        Parameters
        ----------
        model : the body alone; its nodes are those of the subdomain and of its soles, in the same order
        u : (3n,) displacements at the end of the load step
        history : what this method returned for the last committed step; None at the beginning. Not to be changed

        Returns
        -------
        (3n,) nodal forces, their derivative (3n, 3n), symmetric, and the history to begin the next step with
        """
        raise NotImplementedError

    def prepare(self, model: Any, stiffness: sp.csr_array) -> Any:
        """As the base says, with the body, its soles' stiffness, and a past."""
        return _Body(self, model, super().prepare(model, stiffness))

    def solve(self, prepared: Any, forces: np.ndarray) -> np.ndarray:
        """As the base says: the elastic answer, for search directions and coarse problems."""
        return super().solve(prepared.elastic, forces)

    def advance(self, prepared: Any, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3n,) displacements from the last committed step, and the (3n,) forces that they need.

        Parameters
        ----------
        given : (3n,) nodal forces on free dofs, prescribed displacements on clamped ones
        """
        return prepared.advance(given)

    def commit(self, prepared: Any) -> None:
        """The last ``advance`` was the end of the load step."""
        prepared.commit()


class _Body:
    """A model and its past.

    Parameters
    ----------
    elastic : what ``Adapter.prepare`` returns
    """

    def __init__(self, solver: NonlinearAdapter, model: Any, elastic: Any):
        self.solver, self.elastic = solver, elastic
        sole, self.fixed = np.asarray(model.sole), model.fixed.ravel()
        self.free = np.flatnonzero(~self.fixed)
        self.body = _some(model, ~sole)
        self.soles = sp.csr_array(solver.stiffness(_some(model, sole))) if sole.any() else \
            sp.csr_array((len(self.fixed),) * 2)
        self.u, self.history = np.zeros(len(self.fixed)), None
        self.latest = self.u, None

    def commit(self) -> None:
        self.u, self.history = self.latest

    def advance(self, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method, its steps halved where the imbalance grows; from the nearer of the step's beginning and the
        last answer. Raises ArithmeticError where it does not converge."""
        found = min((self._at(np.where(self.fixed, given, start), given) for start in (self.u, self.latest[0])),
                    key=lambda at: at[0])
        for _ in range(ITERATIONS):
            left, u, needed, tangent, history = found
            if left <= BALANCED:
                break
            free = self.free
            factor = spla.splu(sp.csc_array(tangent[free][:, free]), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                               options={"SymmetricMode": True})
            change = np.zeros_like(u)
            change[free] = factor.solve((given - needed)[free])
            for halved in range(HALVINGS):
                found = self._at(u + 0.5**halved * change, given)
                if found[0] < left:
                    break
            else:
                found = left, u, needed, tangent, history
                break
        left, u, needed, _, history = found
        if not left <= ENOUGH:
            raise ArithmeticError(f"Newton's method leaves {left:.1e} of the forces unbalanced: take smaller load steps")
        self.latest = u, history
        return u, needed

    def _at(self, u: np.ndarray, given: np.ndarray) -> tuple:
        """What is left of the forces on free dofs, relative; u; the forces it needs, their tangent, and the history."""
        forces, tangent, history = self.solver.response(self.body, u, self.history)
        needed = forces + self.soles @ u
        size = max(np.linalg.norm(given[self.free]), np.linalg.norm(needed), np.finfo(float).tiny)
        return np.linalg.norm((given - needed)[self.free]) / size, u, needed, tangent + self.soles, history


def _some(model: Any, chosen: np.ndarray) -> Any:
    """A model of some of the tets, on the same nodes."""
    return replace(model, cells=model.cells[chosen], region=model.region[chosen], volume=model.volume[chosen],
                   sole=model.sole[chosen])
