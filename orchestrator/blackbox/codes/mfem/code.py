"""MFEM as a code: where its solver is, and what that needs."""

from __future__ import annotations

from orchestrator.blackbox.codes.python_code import FourNodeCode


class MfemCode(FourNodeCode):
    """MFEM, through its Python interface."""

    solver = "orchestrator.blackbox.codes.mfem.solver:Mfem"
    package = "mfem"
    translation_invariant, own_matter = True, False
