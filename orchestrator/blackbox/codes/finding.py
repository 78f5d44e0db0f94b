"""Are the codes there that a configuration asks for? Nothing is started but an interpreter that an entry names, to be asked."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace

from orchestrator.blackbox.codes.code import Code
from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.errors import InputError, Problem
from orchestrator.registry import CODES, FOREIGN

# Each worker is a process with its threads, pipes and tens of MB; more than the cores only wait for each other.
MOST_WORKERS, WORKERS_PER_CORE = 64, 8


def find_codes(settings: Sequence[CodeSettings], used: Iterable[int] | None = None, run_programs: bool = True) -> dict[int, Code]:
    """The code of each entry that is used.

    Parameters
    ----------
    settings : the entries of ``blackbox``
    used : which of them have a model; default all
    run_programs : whether interpreters that entries name may be started, to be asked whether they have what is needed

    Raises
    ------
    InputError : codes that are not installed, more workers than a machine can start; with the problems of all
    """
    problems: list[Problem] = []
    cores = len(os.sched_getaffinity(0))
    most = max(MOST_WORKERS, WORKERS_PER_CORE * cores)
    found: dict[int, Code] = {}
    for index in sorted(set(range(len(settings)) if used is None else used)) or [0]:
        if (workers := settings[index].workers) != "auto" and workers > most:
            problems.append(Problem((*entry_path(index, settings), "workers"), f"{workers:,} workers on {cores} cores",
                                    f"at most {most} processes", "leave workers out: one per core is the fastest"))
            continue
        try:
            known = FOREIGN if settings[index].code in FOREIGN else CODES
            found[index] = known[settings[index].code](settings[index])
            if run_programs:
                found[index].ask()
        except InputError as error:  # a code knows nothing of lists
            own = settings[index].code in FOREIGN
            problems += [p if own else replace(p, path=(*entry_path(index, settings), *p.path[1:])) for p in error.problems]
    if problems:
        raise InputError(problems)
    return found


def doctor() -> list[str]:
    """What is installed and what is missing of all codes, see ``Code.doctor``."""
    return [line for name, code in CODES.items() for line in code.doctor(name)]
