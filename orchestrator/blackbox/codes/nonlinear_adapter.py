"""The base of nonlinear solvers written in Python: forces and tangent of the matter suffice,
Newton's method is here.

    from orchestrator.blackbox.codes.nonlinear_adapter import NonlinearAdapter

    class Solver(NonlinearAdapter):               # blackbox: {code: my_solver.py, nonlinear: true}
        def stiffness(self, model):               # elastic, of all tets, as in ``Adapter``
            ...
        def response(self, model, u, history):    # of the body, without soles
            return forces, tangent, new_history

Whoever has an iteration of their own derives from ``Adapter``, says ``nonlinear = own_matter =
True`` and writes ``advance`` and ``commit``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.linalg import symmetric_lu

# Relative, of the forces: Newton's method ends below it, or at rounding where it gets no further
# and is below ENOUGH. What
# is left must be far below the residual of the coupling.
BALANCED, ENOUGH = 1e-13, 1e-10
ITERATIONS, HALVINGS = 50, 8  # more do not help: the load step is too large
# elastic steps at once, and how often, where Newton's method gets no further
STEADY, DESCENTS = 8, 40


class NonlinearAdapter(Adapter):
    """Solves load steps one after the other, each from where the last one was committed.
    nonlinear : ``advance`` and ``commit`` are asked, as the entry's ``nonlinear: true`` says
    """

    own_matter = nonlinear = True

    def response(self, model: Any, u: np.ndarray,
                 history: Any) -> tuple[np.ndarray, sp.csr_array, Any]:
        """Forces and tangent for displacements at the end of a load step.

        model : the body alone; its nodes are those of the subdomain and of its soles, in the same
            order
        u : (3n,) displacements at the end of the load step
        history : what this method returned for the last committed step; None at the beginning. Not
            to be changed

        Returns (3n,) nodal forces, their derivative (3n, 3n), symmetric, and the history to begin
        the next step with
        """
        raise NotImplementedError

    def prepare(self, model: Any, stiffness: sp.csr_array) -> Any:
        """Prepare as the base does, with the body, its soles' stiffness, and a past."""
        return _Body(self, model, super().prepare(model, stiffness))

    def solve(self, prepared: Any, forces: np.ndarray) -> np.ndarray:
        """The elastic answer, for search directions and coarse problems."""
        return super().solve(prepared.elastic, forces)

    def advance(self, prepared: Any, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3n,) displacements from the last committed step, and the (3n,) forces that they need.

        given : (3n,) nodal forces on free dofs, prescribed displacements on clamped ones
        """
        return prepared.advance(given)

    def commit(self, prepared: Any) -> None:
        """The last ``advance`` was the end of the load step."""
        prepared.commit()


class _Body:
    """A model and its past.

    elastic : what ``Adapter.prepare`` returns
    """

    def __init__(self, solver: NonlinearAdapter, model: Any, elastic: Any):
        self.solver, self.elastic = solver, elastic
        sole, self.fixed = np.asarray(model.sole), model.fixed.ravel()
        self.free = np.flatnonzero(~self.fixed)
        self.body = _some(model, ~sole)
        self.soles = sp.csr_array(
            solver.stiffness(_some(model, sole))) if sole.any() else sp.csr_array(
                (len(self.fixed),) * 2)
        self.u, self.history = np.zeros(len(self.fixed)), None
        self.latest = self.u, None

    def commit(self) -> None:
        self.u, self.history = self.latest

    def advance(self, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method from the last committed step, so that answers do not depend on what has
        been asked since; where it gets no
        further, a few elastic steps, see ``_descended``. Raises ArithmeticError where it does not
        converge, or the matter answers what is
        no number."""
        at = self._at(np.where(self.fixed, given, self.u), given)
        newton, descents = 0, 0
        while True:
            if not at.finite:
                raise ArithmeticError(_no_numbers(self.body, at))
            if at.left <= BALANCED or newton == ITERATIONS:
                break
            further = self._moved(at, given)
            newton += further is not None
            if further is None:
                if at.left <= ENOUGH or descents == DESCENTS:
                    break
                further, descents = self._descended(at, given), descents + 1
            at = further
        if not at.left <= ENOUGH:
            raise ArithmeticError(
                f"Newton's method leaves {at.left:.1e} of the forces unbalanced after {newton} "
                f"iterations and {STEADY * descents} elastic steps: take smaller load steps, or "
                "matter that softens less")
        self.latest = at.u, at.history
        return at.u, at.needed

    def _descended(self, at: _At, given: np.ndarray) -> _At:
        """Elastic steps, whatever they do to what is unbalanced: matter that is never stiffer than
        elastic comes down in energy
        by each of them, also where it softens, and Newton's method has nothing to go by."""
        for _ in range(STEADY):
            u = at.u.copy()
            u[self.free] += self.elastic[1].solve((given - at.needed)[self.free])
            at = self._at(u, given)
            if not at.finite:
                break
        return at

    def _moved(self, at: _At, given: np.ndarray) -> _At | None:
        """A step along the tangent, halved until what is unbalanced falls in the norm of the
        elastic compliance; where none
        does, as when flow is reversed, an elastic one: matter that hardens never resists more.
        None: at rounding."""
        free, unbalanced = self.free, (given - at.needed)[self.free]
        factor = symmetric_lu(at.tangent[free][:, free])
        elastic = self.elastic[1].solve(unbalanced)
        size = unbalanced @ elastic
        for change, halvings in ((factor.solve(unbalanced), HALVINGS), (elastic, 1)):
            for halved in range(halvings):
                u = at.u.copy()
                u[free] += 0.5**halved * change
                found = self._at(u, given)
                rest = (given - found.needed)[free]
                if found.finite and rest @ self.elastic[1].solve(rest) < size:
                    return found
        return None

    def _at(self, u: np.ndarray, given: np.ndarray) -> _At:
        forces, tangent, history = self.solver.response(self.body, u, self.history)
        needed = forces + self.soles @ u
        size = max(np.linalg.norm(given[self.free]), np.linalg.norm(needed), np.finfo(float).tiny)
        tangent = sp.csr_array(tangent) + self.soles
        finite = bool(np.isfinite(needed).all() and np.isfinite(tangent.data).all())
        return _At(np.linalg.norm((given - needed)[self.free]) / size, u, needed, tangent, history,
                   finite)


@dataclass(frozen=True)
class _At:
    """Displacements, what they need, what is left of the forces on free dofs, relative; whether the
    matter answers with numbers.
    """

    left: float
    u: np.ndarray
    needed: np.ndarray
    tangent: sp.csr_array
    history: Any
    finite: bool


def _no_numbers(body: Any, at: _At) -> str:
    """Say where forces or tangent are not numbers, and at what strain."""
    dofs = ~np.isfinite(at.needed)
    what = "forces" if dofs.any() else "a tangent with entries"
    if not dofs.any():
        tangent = sp.coo_array(at.tangent)
        dofs[tangent.row[~np.isfinite(tangent.data)]] = True
    struck = dofs.reshape(-1, 3).any(axis=1)[body.cells].sum(axis=1)
    tet = int(np.argmax(struck))  # the matter of a tet strikes all of its nodes
    corners = body.cells[tet, :4]
    place = body.nodes[corners]
    moved = np.linalg.solve(place[1:] - place[0], at.u.reshape(-1, 3)[corners[1:]]
                            - at.u.reshape(-1, 3)[corners[0]])
    strain = (moved + moved.T) / 2
    rows = ", ".join(f"{name} {strain[i, j]:.3g}" for name, (i, j) in zip(
        ("xx", "yy", "zz", "xy", "yz", "xz"), ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))))
    return (
        f"response() returned {what} that are no numbers (nan or infinite): tet {tet} of the body, "
        f"at ({', '.join(f'{x:.6g}' for x in place.mean(axis=0))}), mean strain {rows}. Look for a "
        "division by zero or a root of a negative number there")


def _some(model: Any, chosen: np.ndarray) -> Any:
    """A model of some of the tets, on the same nodes."""
    return replace(model, cells=model.cells[chosen], region=model.region[chosen],
                   volume=model.volume[chosen], sole=model.sole[chosen])
