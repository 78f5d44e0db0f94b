"""A code without a process, for tests of the method: the template's solver, called where others are sent messages.

    blackbox=IN_PROCESS     # what the cases of the tests take unless told otherwise
    blackbox=FREEFEM        # the real thing

It is a code like any other, found by its name in the registry: pool, layers and guards are those of every run. What is
missing is the process, its pipes and its files. That the real code gives the same is shown in ``test_in_process``.
"""

import time
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy.sparse as sp
from quadratic_case import assemble_ten

from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.codes.adapter import FullModel, solver_class
from orchestrator.blackbox.codes.template import Solver
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.config.blackbox import CodeSettings
from orchestrator.method.sparse.symmetric import by_cholesky, by_superlu
from orchestrator.registry import CODES

EXAMPLE = Path(__file__).parents[1] / "configs" / "elastoplastic.py"
Plastic = solver_class(str(EXAMPLE))

FREEFEM = {"code": "freefem", "workers": 1}
IN_PROCESS = {"code": "in-process", "workers": 1}
IN_PROCESS_PLASTIC = {"code": "in-process-plastic", "workers": 1, "options": {"yield_stress": 200.0, "hardening": 2000.0, "kinematic": 0.5}}


class TemplateSolver(Solver):
    """The template's solver, for tets of ten nodes too, and with an elimination order fit for symmetric matrices."""

    def stiffness(self, model: Model) -> sp.csr_array:
        return super().stiffness(model) if model.cells.shape[1] == 4 else assemble_ten(model)

    def prepare(self, model: Model):
        free = np.flatnonzero(~model.fixed)
        if not len(free):  # the layer that a foundation stands on
            return free, SimpleNamespace(solve=np.array)
        lower = sp.tril(self.stiffness(model)[free][:, free], format="csc")
        # scipy's SuperLU loses the memory of factors that another thread lets go than the one that made them
        return free, SimpleNamespace(solve=by_cholesky(lower, "amd") or by_superlu(lower))


class InProcessWorker(Worker):
    """What a worker does, in the thread that the pool keeps for it."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.solver, self.models, self.prepared = TemplateSolver(), {}, {}

    def load(self, index: int, model: Model) -> None:
        begin = time.thread_time()
        self.models[index], self.prepared[index] = model, self.solver.prepare(model)
        self.count([0.0, time.thread_time() - begin, 0.0])

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]], names: list[str]) -> dict[int, np.ndarray]:
        begin, answers = time.thread_time(), {}
        for index, forces in jobs:
            model = self.models[index]
            wanted = model.trace if op == messages.TRACES else slice(None)
            full = np.zeros((len(forces), model.fixed.size))
            full[:, wanted] = forces
            answers[index] = self.solver.solve(self.prepared[index], full)[:, wanted]
        self.count([0.0, 0.0, time.thread_time() - begin])
        return answers

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        begin = time.thread_time()
        matrix = self.solver.stiffness(model)
        self.count([time.thread_time() - begin, 0.0, 0.0])
        return matrix


class PlasticWorker(InProcessWorker):
    """The shipped example of a nonlinear solver, in the thread too."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.solver, self.elastic, self.promised = Plastic(**self.code.settings.options), {}, 2 + 4

    def load(self, index: int, model: Model) -> None:
        full = FullModel(*(getattr(model, f.name) for f in fields(Model)))
        for name, value in model.origin.arrays(len(model.nodes), len(model.cells)).items():
            setattr(full, name, value)
        self.models[index], self.elastic[index] = model, self.solver.stiffness(model)
        self.prepared[index] = self.solver.prepare(full, self.elastic[index])

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        u, needed = self.solver.advance(self.prepared[index], forces)
        if commit:
            self.solver.commit(self.prepared[index])
        return np.stack([u, self.elastic[index] @ u - needed])


class InProcess(Code):
    """The template's solver as a code; of what a code tells about its process there is nothing to tell."""

    translation_invariant = True

    def worker(self) -> type[Worker]:
        return InProcessWorker

    def command(self, requests: str, replies: str) -> list[str]:
        raise AssertionError("no process is started")


class InProcessPlastic(InProcess):
    translation_invariant, own_matter = False, True

    class Settings(CodeSettings):
        options: dict = {}

        @property
        def remembers(self) -> bool:
            return True

    def worker(self) -> type[Worker]:
        return PlasticWorker


CODES.add(IN_PROCESS["code"], InProcess)
CODES.add(IN_PROCESS_PLASTIC["code"], InProcessPlastic)
