"""NGSolve as a code: where its solver is, and what that needs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from orchestrator.blackbox.codes.python_code import PythonCode


class NGSolveCode(PythonCode):
    """NGSolve, through its Python interface."""

    solver = "orchestrator.blackbox.codes.ngsolve.solver:NGSolve"
    package = "ngsolve"
    translation_invariant, own_matter = True, False

    class Settings(PythonCode.Settings):
        """A solver in Python."""

        element: Literal["P1"] = Field("P1", description="linear tetrahedra: its adapter knows no other")
