"""scikit-fem as a code: where its solver is, and what that needs."""

from __future__ import annotations

from orchestrator.blackbox.codes.python_code import PythonCode


class ScikitFemCode(PythonCode):
    """scikit-fem, a pure Python finite element library."""

    solver = "orchestrator.blackbox.codes.scikit_fem.solver:ScikitFem"
    package = "scikit-fem"
    translation_invariant, own_matter = True, False
