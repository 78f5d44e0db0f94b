"""The black box that a configuration asks for: codes are found, started, and put behind the layers that save them work."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.guarded import GuardedCode
from orchestrator.blackbox.models.extended import body_model
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.errors import InputError, Problem
from orchestrator.registry import CODES, FOREIGN
from orchestrator.scene.model import Scene

# Each worker is a process with its threads, pipes and tens of MB; more than the cores only wait for each other.
MOST_WORKERS, WORKERS_PER_CORE = 64, 8


def find_codes(settings: Sequence[CodeSettings], used: Iterable[int] | None = None, run_programs: bool = True) -> dict[int, Code]:
    """The code of each entry that is used. Nothing is started but an interpreter that an entry names, to be asked.

    settings : the entries of ``blackbox``
    used : which of them have a model; default all
    run_programs : whether interpreters that entries name may be started, to be asked whether they have what is needed
    Raises InputError for codes that are not installed, more workers than a machine can start; with the problems of all.
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
        own = settings[index].code in FOREIGN
        try:
            found[index] = (FOREIGN if own else CODES)[settings[index].code](settings[index])
            if run_programs:
                found[index].ask()
        except InputError as error:  # a code knows nothing of lists
            problems += [p if own else replace(p, path=(*entry_path(index, settings), *p.path[1:])) for p in error.problems]
    if problems:
        raise InputError(problems)
    return found


def doctor() -> list[str]:
    """List what is installed and what is missing of all codes, see ``Code.doctor``."""
    return [line for name, code in CODES.items() for line in code.doctor(name)]


def make_blackbox(settings: CodeSettings | Sequence[CodeSettings], used: Iterable[int] | None = None) -> BlackBox:
    """A pool of all codes, whose answers are judged as they arrive.

    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all
    Raises InputError for a code that is not installed, nothing has been started then; BlackBoxError where processes do not start.
    """
    codes = find_codes(settings if isinstance(settings, Sequence) else [settings], used)
    guarded = {number for number, code in codes.items() if code.guarded}
    return GuardedCode(Pool(codes), guarded) if guarded else Pool(codes)


def with_own_loads(scene: Scene, settings: Sequence[CodeSettings]) -> Scene:
    """The scene with the loads that codes' own models have beside those of the YAML: heat, own weight, whatever a form says. They are
    asked for once, before anything is decomposed: energies, reactions and the error bound then know them like any others. It is another
    scene, so that the first may be solved again. Raises as ``make_blackbox`` does."""
    asked = {s.code for s in scene.subdomains if settings[s.code].brings_loads}
    if not asked:
        return scene
    scene = copy(scene)
    scene.brought = any(s.remembers for s in scene.subdomains)  # those are not asked
    scene.loads, scene.subdomains = scene.loads.copy(), [copy(s) for s in scene.subdomains]
    own = [s for s in scene.subdomains if s.code in asked]
    with Pool(find_codes(settings, asked)) as pool:
        found = pool.own_loads([body_model(scene, s) for s in own], scene.steps)
    for s, forces in zip(own, found):
        forces = forces.reshape(scene.steps, -1, 3)
        s.loads = s.loads + forces
        np.add.at(scene.loads, (slice(None), s.nodes), forces)
    return scene
