"""NGSolve as a code: where its solver is, and what that needs."""

from __future__ import annotations

from orchestrator.blackbox.codes.python_code import FourNodeCode


class NGSolveCode(FourNodeCode):
    """NGSolve, through its Python interface."""

    solver = "orchestrator.blackbox.codes.ngsolve.solver:NGSolve"
    package = "ngsolve"
    translation_invariant, own_matter = True, False
