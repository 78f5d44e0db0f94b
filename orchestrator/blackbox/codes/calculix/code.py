"""CalculiX as a code, driven through files: a deck, a run, its binary results.

- stiffness: the matrix that CalculiX stores;
- load cases: a static step each, displacements from the restart file;
- unit loads: ``*GREEN``, one factorisation for all, displacements from the file of Green functions.

The environment variable ``ORCHESTRATOR_CALCULIX`` names another executable than the ``ccx`` of the
path.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sp
from pydantic import Field

from orchestrator.blackbox.codes.calculix import files
from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.transport.runs import Request, RunWorker, Tally
from orchestrator.blackbox.transport.worker import Ended
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import wrong


class CalculiX(Code):
    """The CalculiX executable. Raises InputError when it is not there."""

    translation_invariant = True
    install = "apt-get install calculix-ccx   (or ORCHESTRATOR_CALCULIX=/path/to/ccx)"
    meanings = {201: "CalculiX stopped with an error"}

    class CalculixSettings(CodeSettings):
        """CalculiX, one run per question."""

        element: Literal["P1"] = Field("P1",
                                       description="linear tetrahedra: CalculiX is used for no "
                                       "other here")
        transport: Literal["file"] = Field("file",
                                           description=(
                                               "CalculiX ends after every run: write transport: "
                                               "file, or leave it out"))

    Settings = CalculixSettings

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        wanted = os.environ.get("ORCHESTRATOR_CALCULIX", "")
        self.executable = shutil.which(wanted or "ccx")
        if self.executable is None:
            found = (
                f"ORCHESTRATOR_CALCULIX={wanted} is no executable" if wanted
                else "no ccx in the path")
            raise wrong(("blackbox", "code"), found, "the CalculiX executable", self.install)

    def worker(self) -> type[CalculixWorker]:
        return CalculixWorker

    def command(self, requests: str, replies: str = "") -> list[str]:
        """Command line that runs the deck ``requests``.inp; replies are files of the same name."""
        return [self.executable, "-i", requests]

    def environment(self) -> dict[str, str]:
        """The environment without CalculiX's own variables for threads."""
        return {key: value for key, value in super().environment().items()
                if key != "NUMBER_OF_CPUS" and not key.startswith("CCX_NPROC")}

    def version(self) -> str:
        """CalculiX's own version, e.g. "2.20"; empty when it does not answer."""
        return self._version

    @cached_property
    def _version(self) -> str:
        answer = subprocess.run([self.executable, "-v"], stdin=subprocess.DEVNULL,
                                capture_output=True, text=True, timeout=60)
        found = re.search(r"Version\s+(\S+)", answer.stdout)
        return found[1] if found else ""


JOB = "job"
PROBES = 32  # unit loads of the run that is made for the check and for its cost


@dataclass
class LoadedModel:
    """A model as CalculiX knows it.

    model : what was asked
    mesh : its part of every deck, boundary conditions included
    stiffness : (active, active), clamped dofs left out
    active : (active,) dofs of its rows, ascending
    """

    model: Model
    mesh: str
    stiffness: sp.csr_array
    active: np.ndarray


class CalculixWorker(RunWorker):
    """One run after another, in a folder of its own. Every answer is checked against the stiffness
    CalculiX stored. A run's CPU seconds
    cannot be divided: factorising counts as solving."""

    def __init__(self, code, folder, number):
        own = folder / f"calculix-{number}"
        own.mkdir()
        super().__init__(code, own, number)
        self._loaded: dict[int, LoadedModel] = {}

    def open(self) -> None:
        """Run a single tet through all that is needed; raises InputError when this CalculiX
        cannot.
        """
        tet = Model("a single tet", np.eye(4, 3, -1), np.array([[0, 1, 2, 3]]), np.zeros(1, int),
                    np.array([[1.0, 0.3]]), np.repeat([[True], [True], [True], [False]], 3, axis=1),
                    np.array([9]))
        try:
            loaded = self._store(tet, True, "start")
            self._unit_loads(loaded, tet.trace, "start")
            self._load_cases(loaded, np.eye(1, 12, 9), "start")
        except Ended as error:
            raise self.failure("it did not start", error, "") from error
        except BadReply as error:
            version = self.code.version() or "of unknown version"
            raise wrong(("blackbox", "code"), f"CalculiX {version}, which lacks a feature: {error}",
                "a CalculiX with *GREEN, *RESTART and stored matrices, such as Debian's 2.20",
                        self.code.install) from error

    def load(self, index: int, model: Model) -> None:
        """Load a model; a load case and some unit loads are solved for the check, and for what they
        cost.
        """
        tally = self.tallies[index] = Tally(model.name, len(model.trace))
        with self.telling("loading failed", model.name):
            self._loaded[index] = loaded = self._store(model, True, "assemble")
            forces = np.zeros((1, model.fixed.size))
            # no rigid motion of any part escapes these
            forces[:, loaded.active] = np.where(np.arange(len(loaded.active)) % 5 == 0, 3.0, 1.0)
            self._load_cases(loaded, forces)
            single = self._spent
            tally.request = Request(0.0, single)  # every step factorises anew
            some = model.trace[:: max(1, len(model.trace) // PROBES)]
            if len(some):
                self._unit_loads(loaded, some)
                tally.unit_loads = Request(single, max(self._spent - single, 0.0) / len(some))

    def run_cases(self, op: int, index: int, forces: np.ndarray,
                  name: str) -> tuple[np.ndarray, float]:
        loaded = self._loaded[index]
        wanted = loaded.model.trace if op == messages.TRACES else slice(None)
        full = np.zeros((len(forces), loaded.model.fixed.size))
        full[:, wanted] = forces
        with self.telling("solving failed", name):
            answer = self._load_cases(loaded, full)
        self.tallies[index].request = Request(0.0, self._spent / len(forces))
        return answer[:, wanted], self._spent

    def run_unit_loads(self, index: int, name: str) -> tuple[np.ndarray, float]:
        loaded = self._loaded[index]
        with self.telling("solving failed", name):
            answer = self._unit_loads(loaded, loaded.model.trace)
        compliance = answer[:, np.searchsorted(loaded.active, loaded.model.trace)]
        self._clear()  # the file of Green functions is large
        return compliance, self._spent

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        with self.telling("the stiffness matrix was not obtained", model.name):
            return self._store(model, False, "assemble").stiffness

    # ---- the three kinds of runs -----------------------------------------------------------------

    def _store(self, model: Model, clamp: bool, stage: str) -> LoadedModel:
        if clamp and model.fixed.all():  # nothing moves: CalculiX stores no matrix then
            return LoadedModel(model, "", sp.csr_array((0, 0)), np.empty(0, int))
        mesh = files.mesh(model) + (files.clamped(model) if clamp else "")
        self._run(mesh + files.STORE_MATRIX, stage)
        stiffness, active = files.matrix(self.folder / JOB, model.fixed.size)
        expected = np.flatnonzero(~model.fixed) if clamp else np.arange(model.fixed.size)
        if not np.array_equal(active, expected):
            raise BadReply(f"{len(active)} active dofs, {len(expected)} expected")
        if not np.isfinite(stiffness.data).all():
            raise BadReply("the stiffness matrix has entries that are not finite",
                           "a degenerate tet or an absurd modulus")
        return LoadedModel(model, mesh, stiffness, active)

    def _load_cases(self, loaded: LoadedModel, forces: np.ndarray,
                    stage: str = "solve") -> np.ndarray:
        """Displacements (rhs, 3n)."""
        if not np.isfinite(forces).all():
            raise BadReply("forces are not finite")
        if not len(loaded.active):
            self._spent = 0.0
            return np.zeros_like(forces)
        # steps follow one another: a small case after a large one would keep the rounding of the
        # large one
        size = np.abs(forces).max(axis=1, keepdims=True)
        self._run(loaded.mesh + files.load_cases(forces / np.where(size > 0, size, 1.0)), stage)
        answer = size * files.displacements(self.folder / JOB, len(forces)).reshape(forces.shape)
        _check(loaded, answer[:, loaded.active], forces[:, loaded.active])
        return answer

    def _unit_loads(self, loaded: LoadedModel, dofs: np.ndarray,
                    stage: str = "solve") -> np.ndarray:
        """Displacements (loads, active)."""
        self._run(loaded.mesh + files.unit_loads(dofs), stage)
        answer = files.green_functions(self.folder / JOB, len(dofs), len(loaded.active))
        forces = np.zeros(answer.shape)
        forces[np.arange(len(dofs)), np.searchsorted(loaded.active, dofs)] = 1.0
        _check(loaded, answer, forces)
        return answer

    def _run(self, text: str, stage: str) -> None:
        """Run a deck, whose CPU seconds count as a stage; raises Ended with the code's own words
        when it rejects the deck.
        """
        self._clear()
        self.write(f"{JOB}.inp", [text.encode()])
        before = os.fstat(self.log.fileno()).st_size
        code, self._spent = self.wait_for_end(self.spawn(JOB))
        printed = os.pread(self.log.fileno(), os.fstat(self.log.fileno()).st_size - before, before)
        if said := files.complaint(printed.decode(errors="replace")):
            raise Ended(f"it rejected the deck: {said}")
        if code != 0:
            raise Ended("the run failed")
        self.seconds[stage] += self._spent

    def _clear(self) -> None:
        for path in self.folder.iterdir():
            path.unlink()

    def release(self) -> None:
        super().release()
        shutil.rmtree(self.folder, ignore_errors=True)


def _check(loaded: LoadedModel, u: np.ndarray, forces: np.ndarray) -> None:
    """Raises BadReply where displacements (rhs, active) do not balance the forces."""
    for rows in np.array_split(np.arange(len(u)), len(u) // 64 + 1):  # a compliance is large
        if not np.isfinite(u[rows]).all():
            raise BadReply("displacements are not finite",
                           "a part is not held, or has a zero or absurd modulus")
        left = np.linalg.norm((loaded.stiffness @ u[rows].T).T - forces[rows], axis=1)
        size = np.maximum(np.linalg.norm(forces[rows], axis=1), 1e-300)
        messages.check_residual(float(np.max(left / size, initial=0.0)))
