"""What several codes, matter of their own and nonlinear matter rule out."""

from __future__ import annotations

from collections.abc import Sequence

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import entry_path
from orchestrator.config.method import Method
from orchestrator.errors import InputError, Problem
from orchestrator.parallel.team import Team


def check_codes(codes: Sequence, used: Sequence[int], blackbox: BlackBox, method: Method, reference: bool, team: Team) -> None:
    """Compare the entries of ``blackbox`` with what their solvers say of themselves, and with what is asked for.

    codes : entries of ``blackbox``; used : numbers of those that this rank uses
    reference : whether the undecomposed solution is asked for
    Raises InputError: they disagree
    """
    own = any(blackbox.traits(number).own_matter for number in used)
    if reference and len(codes) > 1 and own:
        raise InputError(Problem(("blackbox",), "--reference with several codes, one of which has matter of its own",
                                 "the whole structure in one code", "leave out --reference, or use one code"))
    if method.tolerance.error == "auto" and own:
        raise InputError(Problem(("method", "tolerance", "error"), "auto beside a code whose matter is its own",
                                 "a number: the mesh's error is estimated from the YAML's moduli", "write error: 1e-6"))
    for number in used:
        truly, path = blackbox.traits(number).nonlinear, entry_path(number, codes)
        if truly and not codes[number].remembers:
            raise InputError(Problem(path, f"the solver of {codes[number].code} says that it is nonlinear", "nonlinear: true in its "
                                     "entry: load steps then follow each other", "write it, or nonlinear = False in its class"))
        if codes[number].remembers and not truly:
            raise InputError(Problem((*path, "nonlinear"), f"true, and the solver of {codes[number].code} is linear",
                                     "nonlinear = True in its class, with advance and commit", "write that, or leave nonlinear out"))
    if not any(code.remembers for code in codes):
        return
    if team.size > 1:
        raise InputError(Problem(("blackbox",), f"nonlinear matter on {team.size} ranks", "one rank: load steps are committed by "
                                 "one process", "run without mpiexec; workers of the codes still share the work"))
    if reference:
        raise InputError(Problem(("blackbox",), "--reference with nonlinear matter", "a linear problem", "leave it out"))
    if method.tolerance.error is None:
        raise InputError(Problem(("method", "tolerance"), "indicator with nonlinear matter", "error: the largest residual",
                                 "write tolerance: {error: 1e-6}"))
    if method.acceleration == "gmres":
        raise InputError(Problem(("method", "acceleration"), "gmres with nonlinear matter, whose fixed point is not affine",
                                 "anderson or none", "leave it out"))
