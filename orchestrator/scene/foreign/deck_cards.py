"""Cards of a deck, those without lines too, and which of them no part can have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from orchestrator.errors import InputError, KeyPath, Problem

# Cards of matter and conditions whose answers are not proportional to forces.
NONLINEAR = {"PLASTIC", "CYCLIC HARDENING", "HYPERELASTIC", "HYPERFOAM", "CREEP", "DEFORMATION PLASTICITY", "MOHR COULOMB",
             "CONTACT PAIR", "GAP", "SURFACE BEHAVIOR", "USER MATERIAL"}
# Those of them that a part may have which says that it is nonlinear: its matter flows, at small strains, whatever the time.
FLOWING = {"PLASTIC", "CYCLIC HARDENING", "DEFORMATION PLASTICITY"}
# What is said with a step, which is not the part's to say.
OF_STEPS = {"STEP", "END STEP", "STATIC", "FREQUENCY", "DYNAMIC", "HEAT TRANSFER", "BUCKLE", "RESTART"}


def headings(file: Path, path: KeyPath, depth: int = 0) -> Iterator[tuple[str, dict[str, str], str]]:
    """Keyword, options and place of every card, those without lines too; of files that are included as well."""
    try:
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(Problem(path, f"{file}: {error.strerror}", "a file that is there")) from error
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text.startswith("*") or text.startswith("**"):
            continue
        head, *rest = (word.strip() for word in text[1:].split(","))
        options = {key.strip().upper(): value.strip() for key, _, value in (word.partition("=") for word in rest)}
        card = " ".join(head.upper().split())
        yield card, options, f"{file}:{number}"
        if card == "INCLUDE" and depth < 20:
            yield from headings(file.parent / options.get("INPUT", ""), path, depth + 1)


def check_deck(file: Path, path: KeyPath, nonlinear: bool) -> None:
    """Raises InputError for cards that the deck of a part cannot have."""
    for card, options, where in headings(file, path):
        if card in OF_STEPS:
            raise InputError(Problem(path, f"{where}: *{card}", "the deck up to its first *STEP", "put what stands between *STATIC and "
                                     "*END STEP in a file of its own, loads:, and leave the rest out"))
        _refuse_nonlinear(card, options, where, path, nonlinear)


def check_loads(file: Path, path: KeyPath, nonlinear: bool) -> None:
    """Raises InputError for cards that loads cannot have."""
    for card, options, where in headings(file, path):
        _refuse_nonlinear(card, options, where, path, nonlinear)
        if card in OF_STEPS:
            raise InputError(Problem(path, f"{where}: *{card}", "what stands between *STATIC and *END STEP",
                                     "leave this line out: steps are made here"))


def _refuse_nonlinear(card: str, options: dict[str, str], where: str, path: KeyPath, nonlinear: bool) -> None:
    if "NLGEOM" in options:
        raise InputError(Problem(path, f"{where}: NLGEOM on *{card}: large displacements, to which joint forces are not proportional",
                                 "a linear part", "leave NLGEOM out"))
    if card in NONLINEAR - (FLOWING if nonlinear else set()):
        cure = "write nonlinear: true in its entry, so that load steps are replayed" if card in FLOWING else \
            "leave the card out, or put the nonlinear part in the orchestrator's own contact laws"
        raise InputError(Problem(path, f"{where}: *{card}, which makes the part nonlinear", "a linear part: its answers are "
                                 "superposed", cure))
