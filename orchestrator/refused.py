"""Refusals of the method, by the keys of the YAML that ask for it; what several codes, and matter
of their own, rule out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import entry_path
from orchestrator.config.method import Method
from orchestrator.errors import wrong
from orchestrator.parallel.team import Team

# cause → keys, what was found, what is expected, the cure
CAUSES: dict[str, tuple[tuple[str, ...], str, str, str]] = {
    "too few iterations": (
        ("method", "max_iterations"), "{allowed} iterations for {count} batches of load steps",
        "at least {count}: it bounds the whole run, and every batch takes one",
        "raise it, or raise method.increment"),
    "singular macro problem": (
        ("method", "macro"), "the macro matrix is singular ({why})",
        "a structure held against rigid motions, and macro fields that are independent",
        "check the boundary conditions; or choose a smaller method.macro.basis"),
    "too few digits": (
        ("method", "tolerance", "error"),
        "{wanted:.1e} beside a matrix whose entries have too few digits for it",
        "an error above {floor:.1e}, which its rounding alone may cause",
        "write error: {twice:.0e}, or the matrix with more digits (17 are all of a double's)"),
    "not convex": (
        ("interfaces",),
        "law {law} says convex = True, and is not: for two jumps its forces differ against their "
        "difference",
        "convex = True only where the force is the slope of a convex energy of the jump: the "
        "error is told to be guaranteed there",
        "leave convex out of the law's class: the error is estimated then"),
    "heat in own matter": (
        ("loads",), "a temperature on {name}, whose code has matter of its own",
        "temperatures on bodies of the YAML's young, poisson and expansion",
        "heat it in that model, or name other volumes under on:"),
    "sliding beside nonlinear matter": (
        ("interfaces",), "pairing: follow beside parts whose matter is nonlinear",
        "one of the two: both go from load step to load step by themselves",
        "write pairing: fixed"),
    "no undecomposed solution": (
        ("interfaces",), "--reference with interfaces that are not perfect",
        "perfect interfaces: the undecomposed solution has no other",
        "leave out --reference; judge by the law residuals in the summary"),
    "bonds that do not close": (
        ("interfaces",),
        "--reference leaves a jump of {jump:.2g} between sides whose displacements are {size:.2g} "
        "at most",
        "interfaces that can close",
        "do not prescribe different displacements on both sides of a bond"),
    "another start": (
        (), "checkpoint, iteration {iteration}: {name} has {wrong}",
        "what a run of this very problem has written",
        "run without --resume"),
}


@contextmanager
def by_keys() -> Iterator[None]:
    """Have what the method refuses in here told as a problem of the configuration.

    Raises InputError: it was refused
    """
    from orchestrator.errors import Refusal  # ``check`` asks before the method is imported

    try:
        yield
    except Refusal as refusal:
        path, *words = CAUSES[refusal.cause]
        raise wrong(path, *(text.format(**refusal.facts) for text in words)) from refusal


def check_codes(codes: Sequence, used: Sequence[int], blackbox: BlackBox, method: Method,
                reference: bool, team: Team) -> None:
    """Compare the entries of ``blackbox`` with what their solvers say of themselves, and with what
    is asked for.

    codes : entries of ``blackbox``; used : numbers of those that this rank uses
    reference : whether the undecomposed solution is asked for
    Raises InputError: they disagree
    """
    own = any(blackbox.traits(number).own_matter for number in used)
    if reference and len(codes) > 1 and own:
        raise wrong(("blackbox",),
                    "--reference with several codes, one of which has matter of its own",
                    "the whole structure in one code",
                    "leave out --reference, or use one code")
    if method.tolerance.error == "auto" and own:
        raise wrong(("method", "tolerance", "error"), "auto beside a code whose matter is its own",
                    "a number: the mesh's error is estimated from the YAML's moduli",
                    "write error: 1e-6")
    for number in used:
        truly, path = blackbox.traits(number).nonlinear, entry_path(number, codes)
        if truly and not codes[number].remembers:
            raise wrong(path, f"the solver of {codes[number].code} says that it is nonlinear",
                        "nonlinear: true in its entry: load steps then follow each other",
                        "write it, or nonlinear = False in its class")
        if codes[number].remembers and not truly:
            raise wrong((*path, "nonlinear"),
                        f"true, and the solver of {codes[number].code} is linear",
                        "nonlinear = True in its class, with advance and commit",
                        "write that, or leave nonlinear out")
    if not any(code.remembers for code in codes):
        return
    if team.size > 1:
        raise wrong(("blackbox",), f"nonlinear matter on {team.size} ranks",
                    "one rank: load steps are committed by one process",
                    "run without mpiexec; workers of the codes still share the work")
    if reference:
        raise wrong(("blackbox",), "--reference with nonlinear matter", "a linear problem",
                    "leave it out")
    if method.tolerance.indicator is not None:
        raise wrong(("method", "tolerance"), "indicator with nonlinear matter",
                    "law: the largest residual",
                    "write tolerance: {law: 1e-6}")
    if method.acceleration == "gmres":
        raise wrong(("method", "acceleration"),
                    "gmres with nonlinear matter, whose fixed point is not affine",
                    "anderson or none",
                    "leave it out")
