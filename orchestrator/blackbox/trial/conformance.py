"""Does a code keep the protocol? Checks that any black box can be run against, each with its own message.

Reference values come from ``template``, an assembly by hand, and from scipy's factorisation.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from orchestrator.blackbox.pool.diagnosis import AGREE, diagnosis, difference
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.blackbox.codes.template import Solver
from orchestrator.errors import BlackBoxError
from orchestrator.scene.conditions.rigid import motions
from orchestrator.scene.mesh.structured import bricks

RIGID, DEFINITE = 1e-10, 1e-14


@dataclass
class Trial:
    """A black box under trial: what it was asked and what it answered.

    Parameters
    ----------
    models : a body of two materials held at one end, and a sole: a thin layer clamped at its outer face
    exact : per model, its reference stiffness
    forces : per model (4, t) trace forces
    """

    blackbox: BlackBox
    models: list[Model]
    exact: list[sp.csr_array]
    forces: list[np.ndarray]
    stiffness: list[sp.csr_array] = field(default_factory=list)
    traces: dict[int, np.ndarray] = field(default_factory=dict)

    def everywhere(self, index: int) -> np.ndarray:
        """The trace forces among all dofs, (4, 3n)."""
        full = np.zeros((len(self.forces[index]), self.models[index].fixed.size))
        full[:, self.models[index].trace] = self.forces[index]
        return full

    def expected(self, index: int) -> np.ndarray:
        """(4, 3n) displacements that the reference stiffness gives."""
        free, f = np.flatnonzero(~self.models[index].fixed), self.everywhere(index)
        factor = spla.splu(sp.csc_array(self.exact[index][free][:, free]))
        u = np.zeros_like(f)
        u[:, free] = factor.solve(np.ascontiguousarray(f[:, free].T)).T
        return u


def trial_models() -> list[Model]:
    """Small, distorted, with nothing symmetric in them that could hide a mistake."""
    body = _sample("body", [1.0, 0.8, 0.6], [3, 2, 2], [[200e3, 0.3], [70e3, 0.2]], 0)
    sole = _sample("sole", [1.0, 1.0, 0.05], [3, 3, 1], [[100e3, 0.25]], 2)
    return [body, sole]


def run_checks(start: Callable[[], BlackBox]) -> Iterator[tuple[str, str, str]]:
    """Run all checks on a black box.

    Returns
    -------
    iterator of (check, figure, what is wrong: empty when it passed); it stops at a failure that ends the black box

    Raises
    ------
    InputError : the code is not there
    """
    models = trial_models()
    rng = np.random.default_rng(7)
    forces = [rng.standard_normal((4, len(m.trace))) * [[1.0], [1e3], [1e-3], [1.0]] for m in models]
    exact = [Solver().stiffness(m) for m in models]
    try:
        with start() as blackbox:
            trial = Trial(blackbox, models, exact, forces)
            folders = blackbox.usage.folders()
            for name, check in CHECKS.items():
                yield name, *check(trial)
            yield "clean death", *_clean_death(trial)
        left = [str(folder) for folder in folders if folder.exists()]
        yield "nothing left", "no file, no process", f"{', '.join(left)} was left behind" if left else ""
    except BlackBoxError as error:
        yield "an answer at all", "", str(error)


# ---- checks: a figure, and what is wrong -----------------------------------------------------------


def _reference_values(trial: Trial) -> tuple[str, str]:
    trial.stiffness = trial.blackbox.stiffness(trial.models)
    apart, wrong = 0.0, ""
    for model, found, exact in zip(trial.models, trial.stiffness, trial.exact):
        if found.shape != exact.shape:
            return "", f"stiffness of the {model.name}: {found.shape} for {exact.shape} expected"
        apart = max(apart, difference(found.toarray(), exact.toarray()))
        wrong = wrong or _named(f"stiffness of the {model.name}", diagnosis(found.toarray(), exact.toarray()))
    return f"{apart:.0e} from the reference values", wrong


def _symmetric(trial: Trial) -> tuple[str, str]:
    apart = max(difference(k.toarray().T, k.toarray()) for k in trial.stiffness)
    wrong = "" if apart <= RIGID else f"the stiffness is not symmetric: |K − Kᵀ| is {apart:.1e} |K|"
    return f"|K − Kᵀ| {apart:.0e}", wrong


def _rigid(trial: Trial) -> tuple[str, str]:
    worst = 0.0
    for model, k in zip(trial.models, trial.stiffness):
        modes = motions(model.nodes - model.nodes.mean(axis=0)).reshape(-1, 6)
        worst = max(worst, float(np.abs(k @ modes).max() / (abs(k).max() * np.abs(modes).max())))
    return f"|K R| {worst:.0e}", "" if worst <= RIGID else f"rigid motions cost energy: |K R| is {worst:.1e} |K| |R|"


def _loads(trial: Trial) -> tuple[str, str]:
    trial.blackbox.load(trial.models)
    return f"{len(trial.models)} models", ""


def _fields(trial: Trial) -> tuple[str, str]:
    answers, apart = trial.blackbox.fields({i: trial.everywhere(i) for i in range(len(trial.models))}), 0.0
    for i, model in enumerate(trial.models):
        if wrong := diagnosis(answers[i], trial.expected(i)):
            return "", f"displacements of the {model.name}: {wrong}"
        if answers[i][:, model.fixed.ravel()].any():
            return "", f"displacements of the {model.name}: clamped dofs move"
        apart = max(apart, difference(answers[i], trial.expected(i)))
    return f"{apart:.0e} from the reference solution", ""


def _traces(trial: Trial) -> tuple[str, str]:
    trial.traces = trial.blackbox.traces(dict(enumerate(trial.forces)))
    apart, wrong = 0.0, ""
    for i, model in enumerate(trial.models):
        expected = trial.expected(i)[:, model.trace]
        apart = max(apart, difference(trial.traces[i], expected))
        wrong = wrong or _named(f"traces of the {model.name}", diagnosis(trial.traces[i], expected))
    return f"{apart:.0e} from the reference solution", wrong


def _linear(trial: Trial) -> tuple[str, str]:
    f, u = trial.forces[0], trial.traces[0]
    both = trial.blackbox.traces({0: 2 * f[:1] - 3 * f[3:4]})[0]
    apart = difference(both, 2 * u[:1] - 3 * u[3:4])
    return _small(apart, "answers are not linear in the forces")


def _batch(trial: Trial) -> tuple[str, str]:
    apart = 0.0
    for case in range(len(trial.forces[0])):
        single = trial.blackbox.traces({0: trial.forces[0][case : case + 1]})[0]
        apart = max(apart, difference(single, trial.traces[0][case : case + 1]))
    return _small(apart, "a load case is answered otherwise in a batch than alone")


def _order(trial: Trial) -> tuple[str, str]:
    answers = trial.blackbox.traces({1: trial.forces[1], 0: trial.forces[0]})
    apart = max(difference(answers[i], trial.traces[i]) for i in (0, 1))
    return _small(apart, "answers depend on the order in which models are asked")


def _repeatable(trial: Trial) -> tuple[str, str]:
    again = trial.blackbox.traces({0: trial.forces[0]})[0]
    return _small(difference(again, trial.traces[0]), "the same question is answered otherwise the second time")


def _compliance(trial: Trial) -> tuple[str, str]:
    compliance = trial.blackbox.traces({0: np.eye(len(trial.models[0].trace))})[0]
    apart = difference(compliance.T, compliance)
    lowest = np.linalg.eigvalsh((compliance + compliance.T) / 2)[0] / np.abs(compliance).max()
    wrong = f"the interface compliance is not symmetric: {apart:.1e}" if apart > AGREE else \
        f"the interface compliance is not positive: smallest eigenvalue {lowest:.1e}" if lowest < DEFINITE else ""
    return f"asymmetry {apart:.0e}, smallest eigenvalue {lowest:.0e}", wrong


def _clean_death(trial: Trial) -> tuple[str, str]:
    """A process killed from outside is an error that names the subdomain, and ends the other processes."""
    pids = trial.blackbox.usage.pids()
    if not pids:
        return "no process between requests", ""
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    try:
        trial.blackbox.traces({0: trial.forces[0]})
    except BlackBoxError as error:
        return "reported", "" if error.subdomain == trial.models[0].name else f"the error names no subdomain: {error}"
    return "", "the death of its process went unnoticed"


CHECKS: dict[str, Callable[[Trial], tuple[str, str]]] = {
    "stiffness, reference values": _reference_values, "stiffness, symmetry": _symmetric,
    "stiffness, rigid motions": _rigid, "clamped and factorised": _loads, "fields": _fields, "traces": _traces,
    "linearity": _linear, "batch and single": _batch, "order of models": _order, "repeatability": _repeatable,
    "interface compliance": _compliance,
}


def _small(apart: float, otherwise: str) -> tuple[str, str]:
    return f"{apart:.0e}", "" if apart <= AGREE else f"{otherwise}: {apart:.1e}"


def _named(what: str, wrong: str) -> str:
    return f"{what}: {wrong}" if wrong else ""


def _sample(name: str, size: list[float], cells: list[int], materials: list[list[float]], axis: int) -> Model:
    """A distorted box clamped at its end along an axis; traces on half of the other dofs, in no order."""
    mesh, rng = bricks(np.array(size), np.array(cells), name), np.random.default_rng(axis)
    step = np.array(size) / np.array(cells)
    nodes = mesh.nodes + rng.uniform(-0.12, 0.12, mesh.nodes.shape) * step
    fixed = np.repeat(np.isclose(mesh.nodes[:, axis], 0.0)[:, None], 3, axis=1)
    fixed[-1, 1] = True  # one component alone
    free = np.flatnonzero(~fixed)
    region = (np.arange(len(mesh.cells)) % 3 == 0).astype(int) % len(materials)
    return Model(name, nodes, mesh.cells, region, np.array(materials), fixed, rng.permutation(free)[: len(free) // 2])
