"""The black box that a configuration asks for: codes are found, started, and put behind the layers
that save them work.

Several runs use one, one after the other, as ``KeptCodes``: what a run asks again that the one
before has asked is there. Processes stay, and so do models and their factors where all models of a
run are those of the run before, to the last byte: runs that differ in loads, bolts' forces, gaps or
friction then share everything that a code has made. Nonlinear models remember load steps: they are
made anew.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.guard import GuardedCode
from orchestrator.blackbox.models import body_model
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.errors import InputError, Problem
from orchestrator.kept import key_of
from orchestrator.registry import CODES, FOREIGN
from orchestrator.scene.model import Scene

# Each worker is a process with its threads, pipes and tens of MB; more than the cores only wait for
# each other.
MOST_WORKERS, WORKERS_PER_CORE = 64, 8


def find_codes(settings: Sequence[CodeSettings], used: Iterable[int] | None = None,
               run_programs: bool = True) -> dict[int, Code]:
    """The code of each entry that is used. Nothing is started but an interpreter that an entry
    names, to be asked.

    settings : the entries of ``blackbox``
    used : which of them have a model; default all
    run_programs : whether interpreters that entries name may be started, to be asked whether they
        have what is needed
    Raises InputError for codes that are not installed, more workers than a machine can start; with
    the problems of all.
    """
    problems: list[Problem] = []
    cores = len(os.sched_getaffinity(0))
    most = max(MOST_WORKERS, WORKERS_PER_CORE * cores)
    found: dict[int, Code] = {}
    for index in sorted(set(range(len(settings)) if used is None else used)) or [0]:
        if (workers := settings[index].workers) != "auto" and workers > most:
            problems.append(Problem((*entry_path(index, settings), "workers"),
                                    f"{workers:,} workers on {cores} cores",
                                    f"at most {most} processes",
                                    "leave workers out: one per core is the fastest"))
            continue
        own = settings[index].code in FOREIGN
        try:
            found[index] = (FOREIGN if own else CODES)[settings[index].code](settings[index])
            if run_programs:
                found[index].ask()
        except InputError as error:  # a code knows nothing of lists
            problems += [p if own else replace(p, path=(*entry_path(index, settings), *p.path[1:]))
                         for p in error.problems]
    if problems:
        raise InputError(problems)
    return found


def doctor() -> list[str]:
    """List what is installed and what is missing of all codes, see ``Code.doctor``."""
    return [line for name, code in CODES.items() for line in code.doctor(name)]


def make_blackbox(settings: CodeSettings | Sequence[CodeSettings],
                  used: Iterable[int] | None = None) -> BlackBox:
    """A pool of all codes, whose answers are judged as they arrive.

    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all
    Raises InputError for a code that is not installed, nothing has been started then; BlackBoxError
    where processes do not start.
    """
    codes = find_codes(settings if isinstance(settings, Sequence) else [settings], used)
    guarded = {number for number, code in codes.items() if code.guarded}
    return GuardedCode(Pool(codes), guarded) if guarded else Pool(codes)


def with_own_loads(scene: Scene, settings: Sequence[CodeSettings]) -> Scene:
    """The scene with the loads that codes' own models have beside those of the YAML: heat, own
    weight, whatever a form says. They are
    asked for once, before anything is decomposed: energies, reactions and the error bound then know
    them like any others. It is another
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


class KeptCodes:
    """Makes black boxes, as ``make_blackbox`` does, but lends the last one again where the same
    codes are asked for.

    To be ended after the last run, and after a run that has failed: nobody knows what its codes are
    in the middle of.
    """

    def __init__(self) -> None:
        self._asked: tuple[list[CodeSettings], list[int]] | None = None
        self._box: KeptBlackBox | None = None

    def __call__(self, settings: Sequence[CodeSettings], used: Iterable[int]) -> BlackBox:
        """A black box for one run; raises as ``make_blackbox`` does."""
        asked = list(settings), sorted(set(used))
        if self._box is None or self._asked != asked:
            self.end()
            self._box, self._asked = KeptBlackBox(make_blackbox(*asked)), asked
        self._box.begin()
        return self._box

    def end(self) -> None:
        """End all processes; may be called twice."""
        if self._box is not None:
            self._box.end()
        self._box = None


class KeptBlackBox(BlackBox):
    """Loads nothing, assembles nothing and in set-up solves nothing that it had for the run before.

    inner : the pool, or what guards it
    """

    def __init__(self, inner: BlackBox):
        super().__init__(inner)
        self._loaded: list[bytes] = []  # keys of the models that the inner one holds
        self._key = b""  # another one whenever it has been given models
        self._before: dict[bytes, sp.csr_array] = {}  # stiffness matrices, of the run before
        self._matrices: dict[bytes, sp.csr_array] = {}  # and of this one
        # the same of answers in set-up: coarse fields, macro functions and soft modes ask again
        self._answered: dict[bytes, dict[int, np.ndarray]] = {}
        self._answers: dict[bytes, dict[int, np.ndarray]] = {}
        self._ready = False

    def begin(self) -> None:
        """Another run begins; seconds count from now on."""
        self._before, self._matrices = self._matrices, {}
        self._answered, self._answers, self._ready = self._answers, {}, False
        self.usage.afresh()

    @property
    def key(self) -> bytes:
        return self._key

    def ready(self) -> None:
        self._ready = True

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        if self._ready:
            return super().traces(forces)
        key = key_of([*forces.items()])
        found = self._answers | self._answered
        self._answers[key] = found[key] if key in found else super().traces(forces)
        return dict(self._answers[key])

    def load(self, models: Sequence[Model]) -> None:
        keys = [key_of(model) for model in models]
        if keys == self._loaded and not any(self._changes(model) for model in models):
            return
        self._loaded, self._answered, self._answers, self._key = [], {}, {}, os.urandom(16)
        super().load(models)
        self._loaded = keys

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        keys = [key_of(model) for model in models]
        known = self._before | self._matrices
        new = [i for i, model in enumerate(models) if keys[i] not in known or self._changes(model)]
        known |= zip((keys[i] for i in new), super().stiffness([models[i] for i in new]) if new
                     else ())
        self._matrices |= {key: known[key] for key in keys}
        return [known[key] for key in keys]

    def _changes(self, model: Model) -> bool:
        """Whether it is another one after each run."""
        return self.traits(model.code).nonlinear

    def close(self) -> None:
        """A run has ended; the processes stay until all of them have."""

    def end(self) -> None:
        """End all processes and remove all files."""
        self.inner.close()
