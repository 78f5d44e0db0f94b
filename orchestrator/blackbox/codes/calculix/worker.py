"""Drives CalculiX through files: a deck, a run, its binary results.

- stiffness: the matrix that CalculiX stores;
- load cases: a static step each, displacements from the restart file;
- unit loads: ``*GREEN``, one factorisation for all, displacements from the file of Green functions.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.codes.calculix import deck, files
from orchestrator.blackbox.codes.calculix.files import Unreadable
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.cost import Request
from orchestrator.blackbox.pool.stateless import StatelessWorker, Tally
from orchestrator.blackbox.pool.worker import Ended
from orchestrator.errors import InputError, Problem

JOB = "job"
PROBES = 32  # unit loads of the run that is made for the check and for its cost


@dataclass
class Loaded:
    """A model as CalculiX knows it.

    Parameters
    ----------
    model : what was asked
    mesh : its part of every deck, boundary conditions included
    stiffness : (active, active), clamped dofs left out
    active : (active,) dofs of its rows, ascending
    """

    model: Model
    mesh: str
    stiffness: sp.csr_array
    active: np.ndarray


class CalculixWorker(StatelessWorker):
    """One run after another, in a folder of its own. Every answer is checked against the stiffness CalculiX stored.

    A run's CPU seconds cannot be divided: factorising counts as solving.
    """

    def __init__(self, code, folder, number):
        own = folder / f"calculix-{number}"
        own.mkdir()
        super().__init__(code, own, number)
        self._loaded: dict[int, Loaded] = {}

    def open(self) -> None:
        """Run a single tet through all that is needed; raises InputError when this CalculiX cannot."""
        tet = Model("a single tet", np.eye(4, 3, -1), np.array([[0, 1, 2, 3]]), np.zeros(1, int),
                    np.array([[1.0, 0.3]]), np.repeat([[True], [True], [True], [False]], 3, axis=1), np.array([9]))
        try:
            loaded, seconds = self._store(tet, clamp=True)
            self.seconds["start"] += seconds
            for what in (self._unit_loads(loaded, tet.trace), self._load_cases(loaded, np.eye(1, 12, 9))):
                self.seconds["start"] += what[1]
        except Ended as error:
            raise self.failure("it did not start", error, "") from error
        except (Unreadable, BadReply) as error:
            version = self.code.version() or "of unknown version"
            raise InputError(Problem(
                ("blackbox", "code"), f"CalculiX {version}, which lacks a feature: {error}",
                "a CalculiX with *GREEN, *RESTART and stored matrices, such as Debian's 2.20",
                self.code.install)) from error

    def load(self, index: int, model: Model) -> None:
        tally = self.tallies[index] = Tally(model.name, len(model.trace))

        def check() -> None:
            loaded, seconds = self._store(model, clamp=True)
            self.seconds["assemble"] += seconds
            self._loaded[index] = loaded
            forces = np.zeros((1, model.fixed.size))
            # no rigid motion of any part escapes these
            forces[:, loaded.active] = np.where(np.arange(len(loaded.active)) % 5 == 0, 3.0, 1.0)
            _, single = self._load_cases(loaded, forces)
            self.seconds["solve"] += single
            tally.request = Request(0.0, single)  # every step factorises anew
            some = model.trace[:: max(1, len(model.trace) // PROBES)]
            if len(some):
                _, several = self._unit_loads(loaded, some)
                self.seconds["solve"] += several
                each = max(several - single, 0.0) / len(some)
                tally.unit_loads = Request(single, each)

        self._guarded("loading failed", model.name, check)

    def run_cases(self, op: int, index: int, forces: np.ndarray, name: str) -> tuple[np.ndarray, float]:
        loaded = self._loaded[index]
        trace = loaded.model.trace
        full = forces
        if op == messages.TRACES:
            full = np.zeros((len(forces), loaded.model.fixed.size))
            full[:, trace] = forces
        answer, seconds = self._guarded("solving failed", name, lambda: self._load_cases(loaded, full))
        self.seconds["solve"] += seconds
        self.tallies[index].request = Request(0.0, seconds / len(forces))
        return (answer[:, trace] if op == messages.TRACES else answer), seconds

    def run_unit_loads(self, index: int, name: str) -> tuple[np.ndarray, float]:
        loaded = self._loaded[index]
        trace = loaded.model.trace
        answer, seconds = self._guarded("solving failed", name, lambda: self._unit_loads(loaded, trace))
        self.seconds["solve"] += seconds
        compliance = answer[:, np.searchsorted(loaded.active, trace)]
        self._clear()  # the file of Green functions is large
        return compliance, seconds

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        stored, seconds = self._guarded("the stiffness matrix was not obtained", model.name,
                                        lambda: self._store(model, clamp=False))
        self.seconds["assemble"] += seconds
        return stored.stiffness

    # ---- the three kinds of runs: each returns its result and the CPU seconds -------------------

    def _store(self, model: Model, clamp: bool) -> tuple[Loaded, float]:
        if clamp and model.fixed.all():  # nothing moves: CalculiX stores no matrix then
            return Loaded(model, "", sp.csr_array((0, 0)), np.empty(0, dtype=int)), 0.0
        mesh = deck.mesh(model) + (deck.clamped(model) if clamp else "")
        seconds = self._run(mesh + deck.store_matrix())
        stiffness, active = files.matrix(self.folder / JOB, model.fixed.size)
        expected = np.flatnonzero(~model.fixed) if clamp else np.arange(model.fixed.size)
        if not np.array_equal(active, expected):
            raise BadReply(f"{len(active)} active dofs, {len(expected)} expected")
        if not np.isfinite(stiffness.data).all():
            raise BadReply("the stiffness matrix has entries that are not finite",
                           "a degenerate tet or an absurd modulus")
        return Loaded(model, mesh, stiffness, active), seconds

    def _load_cases(self, loaded: Loaded, forces: np.ndarray) -> tuple[np.ndarray, float]:
        if not np.isfinite(forces).all():
            raise BadReply("forces are not finite")
        if not len(loaded.active):
            return np.zeros_like(forces), 0.0
        # steps follow one another: a small case after a large one would keep the rounding of the large one
        size = np.abs(forces).max(axis=1, keepdims=True)
        seconds = self._run(loaded.mesh + deck.load_cases(forces / np.where(size > 0, size, 1.0)))
        answer = size * files.displacements(self.folder / JOB, len(forces), len(loaded.model.nodes))
        _check(loaded, answer[:, loaded.active], forces[:, loaded.active])
        return answer, seconds

    def _unit_loads(self, loaded: Loaded, dofs: np.ndarray) -> tuple[np.ndarray, float]:
        """Displacements (loads, active)."""
        seconds = self._run(loaded.mesh + deck.unit_loads(dofs))
        answer = files.green_functions(self.folder / JOB, len(dofs), len(loaded.active))
        forces = np.zeros(answer.shape)
        forces[np.arange(len(dofs)), np.searchsorted(loaded.active, dofs)] = 1.0
        _check(loaded, answer, forces)
        return answer, seconds

    # ---- one run ----------------------------------------------------------------------------------

    def _run(self, text: str) -> float:
        """CPU seconds of a run; raises Ended with the code's own words when it rejects the deck."""
        self._clear()
        self.write(f"{JOB}.inp", [text.encode()])
        before = os.fstat(self.log.fileno()).st_size
        code, seconds = self.wait_for_end(self.spawn(JOB, ""))
        printed = os.pread(self.log.fileno(), os.fstat(self.log.fileno()).st_size - before, before)
        said = complaint(printed.decode(errors="replace"))
        if said:
            raise Ended(f"it rejected the deck: {said}")
        if code != 0:
            raise Ended("the run failed")
        return seconds

    def _clear(self) -> None:
        for path in self.folder.iterdir():
            path.unlink()

    def _guarded(self, purpose: str, name: str, action: Callable):
        try:
            return action()
        except (Ended, BadReply, Unreadable) as error:
            raise self.failure(purpose, error, name) from error

    def release(self) -> None:
        super().release()
        shutil.rmtree(self.folder, ignore_errors=True)


def _check(loaded: Loaded, u: np.ndarray, forces: np.ndarray) -> None:
    """Raises BadReply where displacements (rhs, active) do not balance the forces."""
    for rows in np.array_split(np.arange(len(u)), len(u) // 64 + 1):  # a compliance is large
        if not np.isfinite(u[rows]).all():
            raise BadReply("displacements are not finite", "a part is not held, or has a zero or absurd modulus")
        left = np.linalg.norm((loaded.stiffness @ u[rows].T).T - forces[rows], axis=1)
        size = np.maximum(np.linalg.norm(forces[rows], axis=1), 1e-300)
        messages.check_residual(float(np.max(left / size, initial=0.0)))


def complaint(printed: str) -> str:
    """The first error message in what CalculiX printed, on one line; empty when there is none."""
    rows = iter(printed.splitlines())
    for row in rows:
        if "*ERROR" in row:
            message = [row.strip()]
            for more in rows:  # messages go on until an empty line
                if not more.strip() or "*" in more[:3]:
                    break
                message.append(more.strip())
            return " ".join(message)
    return ""
