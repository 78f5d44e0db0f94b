"""What the method refuses, told by the keys of the YAML that ask for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from orchestrator.errors import InputError, Problem

# cause → keys, what was found, what is expected, the cure
CAUSES: dict[str, tuple[tuple[str, ...], str, str, str]] = {
    "too few iterations": (
        ("method", "max_iterations"), "{allowed} iterations for {count} batches of load steps",
        "at least {count}: it bounds the whole run, and every batch takes one", "raise it, or raise method.increment"),
    "singular macro problem": (
        ("method", "macro"), "the macro matrix is singular ({why})",
        "a structure held against rigid motions, and macro fields that are independent",
        "check the boundary conditions; or choose a smaller method.macro.basis"),
    "too few digits": (
        ("method", "tolerance", "error"), "{wanted:.1e} beside a matrix whose entries have too few digits for it",
        "an error above {floor:.1e}, which its rounding alone may cause",
        "write error: {twice:.0e}, or the matrix with more digits (17 are all of a double's)"),
    "heat in own matter": (
        ("loads",), "a temperature on {name}, whose code has matter of its own",
        "temperatures on bodies of the YAML's young, poisson and expansion", "heat it in that model, or name other volumes under on:"),
    "sliding beside nonlinear matter": (
        ("interfaces",), "pairing: follow beside parts whose matter is nonlinear",
        "one of the two: both go from load step to load step by themselves", "write pairing: fixed"),
    "no undecomposed solution": (
        ("interfaces",), "--reference with interfaces that are not perfect", "perfect interfaces: the undecomposed solution has no other",
        "leave out --reference; judge by the law residuals in the summary"),
    "bonds that do not close": (
        ("interfaces",), "--reference leaves a jump of {jump:.2g} between sides whose displacements are {size:.2g} at most",
        "interfaces that can close", "do not prescribe different displacements on both sides of a bond"),
    "another start": (
        (), "checkpoint, iteration {iteration}: {name} has {wrong}", "what a run of this very problem has written",
        "run without --resume"),
}


@contextmanager
def by_keys() -> Iterator[None]:
    """Have what the method refuses in here told as a problem of the configuration.

    Raises InputError: it was refused
    """
    from orchestrator.method.refusal import Refusal  # ``check`` asks before the method is imported

    try:
        yield
    except Refusal as refusal:
        path, *words = CAUSES[refusal.cause]
        raise InputError(Problem(path, *(text.format(**refusal.facts) for text in words))) from refusal
