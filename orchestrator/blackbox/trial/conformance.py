"""Does a code keep the protocol? Checks that any black box can be run against, each with its own message.

Reference values come from ``template``, an assembly by hand, and from scipy's factorisation.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.diagnosis import AGREE, diagnosis, difference
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.blackbox.codes.template import Solver
from orchestrator.blackbox.trial.problem import Trial, trial_models
from orchestrator.errors import BlackBoxError
from orchestrator.scene.conditions.rigid import motions

RIGID, DEFINITE = 1e-10, 1e-14
MANY = 600  # load cases at once


def run_checks(start: Callable[[], BlackBox]) -> Iterator[tuple[str, str, str]]:
    """Run all checks on a black box.

    Returns iterator of (check, figure, what is wrong: empty when it passed); it stops at a failure that ends the black box

    Raises InputError: the code is not there
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
        said = _of_region(model, found, exact) or diagnosis(found.toarray(), exact.toarray())
        wrong = wrong or (f"stiffness of the {model.name}: {said}" if said else "")
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
        if wrong := trial.wrong("displacements", i, answers[i], trial.everywhere(i)):
            return "", wrong
        if answers[i][:, model.fixed.ravel()].any():
            return "", f"displacements of the {model.name}: clamped dofs move"
        apart = max(apart, difference(answers[i], trial.expected(i)))
    return f"{apart:.0e} from the reference solution", ""


def _traces(trial: Trial) -> tuple[str, str]:
    trial.traces = trial.blackbox.traces(dict(enumerate(trial.forces)))
    apart, wrong = 0.0, ""
    for i, model in enumerate(trial.models):
        apart = max(apart, difference(trial.traces[i], trial.expected(i)[:, model.trace]))
        wrong = wrong or trial.wrong("traces", i, trial.traces[i], trial.everywhere(i), model.trace)
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


def _many(trial: Trial) -> tuple[str, str]:
    """More rows than any cache or buffer is likely to hold; one of them is zero."""
    rows = np.resize([1.0, -2.0, 0.5], MANY)[:, None] * np.resize(trial.forces[0], (MANY, trial.forces[0].shape[1]))
    rows[MANY // 2] = 0.0
    found = trial.blackbox.traces({0: rows})[0]
    if found.shape == rows.shape and found[MANY // 2].any():
        return "", f"a load case of zeros among {MANY} is answered with displacements"
    full = np.zeros((MANY, trial.models[0].fixed.size))
    full[:, trial.models[0].trace] = rows
    apart = _row_by_row(found, trial.answers(0, full)[:, trial.models[0].trace])
    return _small(apart, f"of {MANY} load cases at once not all are answered as they are alone")


def _sizes(trial: Trial) -> tuple[str, str]:
    size = 10.0 ** np.arange(-6, 7)[:, None]
    found = trial.blackbox.traces({0: size * trial.forces[0][:1]})[0]
    apart = _row_by_row(found, size * trial.expected(0)[:1, trial.models[0].trace])
    return _small(apart, "forces of twelve orders of magnitude in one batch: small load cases are answered worse than alone")


def _untouched(trial: Trial) -> tuple[str, str]:
    """The caller's arrays are the caller's: they may be read-only, and must be the same afterwards."""
    traces, fields = dict(enumerate(f.copy() for f in trial.forces)), {i: trial.everywhere(i) for i in range(len(trial.models))}
    for f in (*traces.values(), *fields.values()):
        f.flags.writeable = False
    trial.blackbox.traces(traces)
    trial.blackbox.fields(fields)
    return "read-only arrays", ""


def _order(trial: Trial) -> tuple[str, str]:
    """In reverse at once, then one model after the other with matrices of others asked for in between."""
    last = list(range(len(trial.models)))[::-1]
    answers = trial.blackbox.traces({i: trial.forces[i] for i in last})
    apart = max(difference(answers[i], trial.traces[i]) for i in last)
    for i in last[::2] + last[1::2]:
        trial.blackbox.stiffness([trial.models[i - 1]])
        apart = max(apart, difference(trial.blackbox.traces({i: trial.forces[i]})[i], trial.traces[i]))
    return _small(apart, "answers depend on the order in which models are asked")


def _reloaded(trial: Trial) -> tuple[str, str]:
    """The same models again, the last one first."""
    count = len(trial.models)
    trial.blackbox.load(trial.models[::-1])
    answers = trial.blackbox.traces({count - 1 - i: f for i, f in enumerate(trial.forces)})
    apart = max(difference(answers[count - 1 - i], trial.traces[i]) for i in range(count))
    trial.blackbox.load(trial.models)
    return _small(apart, "answers depend on the order in which models are prepared")


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
    "linearity": _linear, "batch and single": _batch, "many load cases": _many, "sizes of forces": _sizes,
    "forces untouched": _untouched, "order of models": _order, "repeatability": _repeatable,
    "interface compliance": _compliance, "order of preparing": _reloaded,
}


def _small(apart: float, otherwise: str) -> tuple[str, str]:
    return f"{apart:.0e}", "" if apart <= AGREE else f"{otherwise}: {apart:.1e}"


def _row_by_row(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of a row from what is expected, relative to that row."""
    if found.shape != expected.shape:
        return np.inf
    return max((difference(a, b) for a, b in zip(found, expected)), default=0.0)


def _of_region(model: Model, found: sp.csr_array, exact: sp.csr_array) -> str:
    """A stiffness in which some materials count otherwise than others, in words; empty where it is not just that."""
    if len(model.materials) < 2 or difference(found.toarray(), exact.toarray()) <= AGREE:
        return ""
    only = np.where(np.arange(len(model.materials))[:, None, None] == np.arange(len(model.materials))[:, None], 1.0, 0.0)
    each = [Solver().stiffness(replace(model, materials=model.materials * np.hstack([own, np.ones_like(own)]))).toarray() for own in only]
    factors = np.linalg.lstsq(np.column_stack([k.ravel() for k in each]), found.toarray().ravel(), rcond=None)[0]
    if difference(sum(f * k for f, k in zip(factors, each)), found.toarray()) > AGREE or np.ptp(factors) <= AGREE:
        return ""
    return "; ".join(f"region {r + 1} of {len(factors)} counts {f:.6g} times" for r, f in enumerate(factors)
                     if abs(f - 1) > AGREE) + ": are the moduli of each tet those of materials[region]?"
