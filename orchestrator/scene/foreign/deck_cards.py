"""Cards of a CalculiX deck that is a part, and of the files of its loads: those that no part can have, and what they say of time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from orchestrator.errors import InputError, KeyPath, Problem, wrong
from orchestrator.scene.mesh.inp_cards import Inclusion, Row, cards, heading

# Cards of matter and conditions whose answers are not proportional to forces.
NONLINEAR = {"PLASTIC", "CYCLIC HARDENING", "HYPERELASTIC", "HYPERFOAM", "CREEP", "DEFORMATION PLASTICITY", "MOHR COULOMB",
             "CONTACT PAIR", "GAP", "SURFACE BEHAVIOR", "USER MATERIAL"}
# Those of them that a part may have which says that it is nonlinear: its matter flows, at small strains, whatever the time.
FLOWING = {"PLASTIC", "CYCLIC HARDENING", "DEFORMATION PLASTICITY"}
# What CalculiX keeps from one step to the next, and how many words of a line say where it acts.
KEPT = {"CLOAD": 2, "DLOAD": 2, "DSLOAD": 2, "BOUNDARY": 2, "TEMPERATURE": 1}
# Those that write to files, or read from files, that they name; CalculiX does not mind blanks.
OF_FILES = ("VIEWFACTOR", "SUBMODEL", "SUBSTRUCTURE", "CRACKPROPAGATION")
# What is said with a step, which is not the part's to say.
OF_STEPS = {"STEP", "END STEP", "STATIC", "FREQUENCY", "DYNAMIC", "HEAT TRANSFER", "BUCKLE", "RESTART"}


def headings(file: Path, path: KeyPath) -> Iterator[tuple[str, dict[str, str], str]]:
    """Keyword, options and place of every card, those without lines too; of files that are included as well."""
    try:
        for text, at, number in Inclusion(file).spliced():
            if text.startswith("*"):
                yield *heading(text), f"{at}:{number}"
    except InputError as error:
        raise InputError([Problem(path, p.found, p.expected, "mend the deck") for p in error.problems]) from error


def files_of(file: Path) -> list[Path]:
    """A deck's file and those that it includes, as they are named."""
    deck = Inclusion(file)
    for _ in deck.spliced():
        pass
    return deck.opened


def check_cards(file: Path, path: KeyPath, nonlinear: bool, loads: bool = False) -> None:
    """Raises InputError for cards that the deck of a part, or the file of its loads, cannot have."""
    for card, options, where in headings(file, path):
        if card in OF_STEPS and not (loads and "NLGEOM" in options):
            said = (f"*{card}", "what stands between *STATIC and *END STEP", "leave this line out: steps are made here") if loads else (
                f"*{card}", "the deck up to its first *STEP",
                "put what stands between *STATIC and *END STEP in a file of its own, loads:, and leave the rest out")
        elif card.replace(" ", "").startswith(OF_FILES):
            said = f"*{card[:20]}, which writes or reads files of its own", "cards of matter, supports and loads", "leave the card out"
        elif "NLGEOM" in options:
            said = (f"NLGEOM on *{card}: large displacements, to which joint forces are not proportional", "a linear part",
                    "leave NLGEOM out")
        elif card in NONLINEAR - (FLOWING if nonlinear else set()):
            said = (f"*{card}, which makes the part nonlinear", "a linear part: its answers are superposed",
                     "write nonlinear: true in its entry, so that load steps are replayed" if card in FLOWING else
                     "leave the card out, or put the nonlinear part in the orchestrator's own contact laws")
        elif loads and card == "BOUNDARY" and _new(options):
            said = ("*BOUNDARY, OP=NEW takes the deck's supports away: its stiffness would be another", "supports that stay",
                     "leave OP=NEW out, and move what is to be back by 0")
        elif loads and card == "MODEL CHANGE":
            said = "*MODEL CHANGE makes the deck's stiffness another", "loads alone", "leave the elements out of the deck, or in it"
        else:
            continue
        raise wrong(path, f"{where}: {said[0]}", *said[1:])
    if loads and nonlinear and not _first(file)[1].startswith("*"):
        raise wrong(path, f"{file}: numbers before the first card", "cards: a load step of matter that flows is one increment",
                    "leave that line out, and write more load steps for smaller increments")


def runs_on(file: Path, path: KeyPath) -> bool:
    """Whether an amplitude of the deck is a function of the time since the first load step."""
    return any(card == "AMPLITUDE" and "".join(options.get("TIME", "").upper().split()) == "TOTALTIME"
               for card, options, _ in headings(file, path))


def period(file: Path, path: KeyPath) -> float:
    """Duration of a load file's step: the second number of *STATIC's own line, where the file begins with it.

    Raises InputError: no length of time
    """
    where, line = _first(file)
    if line.startswith("*"):
        return 1.0
    word = (line.split(",") + [""])[1].strip()
    try:
        lasts = float(word.upper().replace("D", "E") or 1.0)
    except ValueError:
        lasts = -1.0
    if not 0 <= lasts < float("inf"):
        raise wrong(path, f"{where}: no length of time", "an increment and the length of the step, the line after "
                    "*STATIC, or a card", "mend that line, or leave it out")
    return lasts or 1.0


def check_kept(files: list[Path], path: KeyPath) -> None:
    """Raises InputError where a file says nothing of a load of the file before: CalculiX would keep it from step to step, and
    here a file says all that acts in its load step."""
    before: dict[tuple[str, ...], Row] = {}
    for i, file in enumerate(files):
        new = {card for card, options, _ in headings(file, path) if _new(options)}
        said = {(card, *(word.upper() for word in row.words[: KEPT[card]])): row for card, _, rows in cards(file) if card in KEPT
                for row in rows}
        for key, row in before.items():
            if key not in said and key[0] not in new:
                raise wrong((*path, i), f"{file} says nothing of {', '.join(key[1:])} under *{key[0]}, which CalculiX would keep "
                            f"from the load step before ({row.file}:{row.line})", "in each file all that acts in its load step",
                            "write that line again with what it is now, which may be 0"
                            + ("" if key[0] == "BOUNDARY" else f"; or *{key[0]}, OP=NEW if it ends"))
        before = said


def _new(options: dict[str, str]) -> bool:
    return options.get("OP", "").upper() == "NEW"


def _first(file: Path) -> tuple[str, str]:
    """Place of the first line that says something, in files included too, and the line; a card where there is none."""
    return next(((f"{at}:{number}", text) for text, at, number in Inclusion(file).spliced()), (f"{file}:1", "*"))
