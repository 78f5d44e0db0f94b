"""Does a code keep the protocol? Checks that any black box can be run against, each with its own
message.

Reference values come from ``template``, an assembly by hand, and from scipy's factorisation.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.template import Solver
from orchestrator.blackbox.codes.adapter import AGREE, diagnosis, difference
from orchestrator.blackbox.guard import OWN
from orchestrator.blackbox.protocol import BlackBox, Model, Origin
from orchestrator.blackbox.trial.models import Trial, trial_models
from orchestrator.errors import BlackBoxError
from orchestrator.scene.conditions.rigid import motions

# of the stiffness, what rounding leaves of symmetry and of rigid motions' cost; of the largest
# compliance, the least of an eigenvalue that is no rounding
RIGID, DEFINITE = 1e-10, 1e-14
MANY = 600  # load cases at once

CHECKS: dict[str, Callable[[Trial], tuple[str, str]]] = {}  # by name: a figure, and what is wrong


def check(name: str, otherwise: str = ""):
    """Adds a check; one that says what is wrong ``otherwise`` returns how far answers are from
    where they should be.
    """
    def added(function: Callable) -> Callable:
        def small(trial: Trial) -> tuple[str, str]:
            apart = function(trial)
            return f"{apart:.0e}", "" if apart <= AGREE else f"{otherwise}: {apart:.1e}"

        CHECKS[name] = small if otherwise else function
        return function
    return added


def run_checks(start: Callable[[], BlackBox]) -> Iterator[tuple[str, str, str]]:
    """(check, figure, what is wrong: empty when it passed) of a black box; stops at a failure that
    ends the black box. Raises InputError
    where the code is not there."""
    models = trial_models()
    rng = np.random.default_rng(7)
    forces = [rng.standard_normal((4, len(m.trace))) * [[1.0], [1e3], [1e-3], [1.0]]
              for m in models]
    exact = [Solver().stiffness(m) for m in models]
    try:
        with start() as blackbox:
            trial = Trial(blackbox, models, exact, forces)
            folders = blackbox.usage.folders()
            for name, check in CHECKS.items():
                yield name, *check(trial)
        left = [str(folder) for folder in folders if folder.exists()]
        yield (
            "nothing left", "no file, no process",
            f"{', '.join(left)} was left behind" if left else "")
    except BlackBoxError as error:
        yield "an answer at all", "", str(error)


@check("stiffness, reference values")
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


@check("stiffness, symmetry")
def _symmetric(trial: Trial) -> tuple[str, str]:
    apart = max(difference(k.toarray().T, k.toarray()) for k in trial.stiffness)
    return (
        f"|K − Kᵀ| {apart:.0e}",
        "" if apart <= RIGID else f"the stiffness is not symmetric: |K − Kᵀ| is {apart:.1e} |K|")


@check("stiffness, rigid motions")
def _rigid(trial: Trial) -> tuple[str, str]:
    worst = 0.0
    for model, k in zip(trial.models, trial.stiffness):
        modes = motions(model.nodes - model.nodes.mean(axis=0)).reshape(-1, 6)
        worst = max(worst, float(np.abs(k @ modes).max() / (abs(k).max() * np.abs(modes).max())))
    return (
        f"|K R| {worst:.0e}",
        "" if worst <= RIGID else f"rigid motions cost energy: |K R| is {worst:.1e} |K| |R|")


@check("clamped and factorised")
def _loads(trial: Trial) -> tuple[str, str]:
    trial.blackbox.load(trial.models)
    return f"{len(trial.models)} models", ""


@check("fields")
def _fields(trial: Trial) -> tuple[str, str]:
    answers, apart = trial.blackbox.fields({i: trial.everywhere(i)
                                            for i in range(len(trial.models))}), 0.0
    for i, model in enumerate(trial.models):
        if wrong := trial.wrong("displacements", i, answers[i], trial.everywhere(i)):
            return "", wrong
        if answers[i][:, model.fixed.ravel()].any():
            return "", f"displacements of the {model.name}: clamped dofs move"
        apart = max(apart, difference(answers[i], trial.expected(i)))
    return f"{apart:.0e} from the reference solution", ""


@check("traces")
def _traces(trial: Trial) -> tuple[str, str]:
    trial.traces = trial.blackbox.traces(dict(enumerate(trial.forces)))
    apart, wrong = 0.0, ""
    for i, model in enumerate(trial.models):
        apart = max(apart, difference(trial.traces[i], trial.expected(i)[:, model.trace]))
        wrong = wrong or trial.wrong("traces", i, trial.traces[i], trial.everywhere(i), model.trace)
    return f"{apart:.0e} from the reference solution", wrong


check("linearity", "answers are not linear in the forces")(lambda t: difference(
    t.first(2 * t.forces[0][:1] - 3 * t.forces[0][3:4]),
    2 * t.traces[0][:1] - 3 * t.traces[0][3:4]))
check("batch and single", "a load case is answered otherwise in a batch than alone")(lambda t: max(
    difference(t.first(f[None]), u[None]) for f, u in zip(t.forces[0], t.traces[0])))


@check("many load cases")
def _many(trial: Trial) -> tuple[str, str]:
    """More rows than any cache or buffer is likely to hold; one of them is zero."""
    rows = np.resize([1.0, -2.0, 0.5], MANY)[:,
                                             None] * np.resize(
                                                 trial.forces[0], (MANY, trial.forces[0].shape[1]))
    rows[MANY // 2] = 0.0
    found = trial.first(rows)
    if found.shape == rows.shape and found[MANY // 2].any():
        return "", f"a load case of zeros among {MANY} is answered with displacements"
    full = np.zeros((MANY, trial.models[0].fixed.size))
    full[:, trial.models[0].trace] = rows
    apart = _row_by_row(found, trial.answers(0, full)[:, trial.models[0].trace])
    return (
        f"{apart:.0e}", "" if apart <= AGREE
        else f"of {MANY} load cases at once not all are answered as they are alone: {apart:.1e}")


@check("sizes of forces",
       "forces of twelve orders of magnitude in one batch: small load cases are answered worse "
       "than alone")
def _sizes(trial: Trial) -> float:
    size = 10.0 ** np.arange(-6, 7)[:, None]
    return _row_by_row(trial.first(size * trial.forces[0][:1]),
                       size * trial.expected(0)[:1, trial.models[0].trace])


@check("forces untouched")
def _untouched(trial: Trial) -> tuple[str, str]:
    """The caller's arrays are the caller's: they may be read-only, and must be the same
    afterwards.
    """
    traces, fields = dict(enumerate(f.copy() for f in trial.forces)), {
        i: trial.everywhere(i) for i in range(len(trial.models))}
    for f in (*traces.values(), *fields.values()):
        f.flags.writeable = False
    trial.blackbox.traces(traces)
    trial.blackbox.fields(fields)
    return "read-only arrays", ""


@check("order of models", "answers depend on the order in which models are asked")
def _order(trial: Trial) -> float:
    """Ask in reverse at once, then one model after the other with matrices of others asked for in
    between.
    """
    last = list(range(len(trial.models)))[::-1]
    answers = trial.blackbox.traces({i: trial.forces[i] for i in last})
    apart = max(difference(answers[i], trial.traces[i]) for i in last)
    for i in last[::2] + last[1::2]:
        trial.blackbox.stiffness([trial.models[i - 1]])
        apart = max(apart,
                    difference(trial.blackbox.traces({i: trial.forces[i]})[i], trial.traces[i]))
    return apart


check("repeatability",
      "the same question is answered otherwise the second time")(
          lambda t: difference(t.first(t.forces[0]), t.traces[0]))


@check("interface compliance")
def _compliance(trial: Trial) -> tuple[str, str]:
    compliance = trial.first(np.eye(len(trial.models[0].trace)))
    apart = difference(compliance.T, compliance)
    lowest = np.linalg.eigvalsh((compliance + compliance.T) / 2)[0] / np.abs(compliance).max()
    wrong = f"the interface compliance is not symmetric: {apart:.1e}" if apart > AGREE else \
        f"the interface compliance is not positive: smallest eigenvalue {lowest:.1e}" \
        if lowest < DEFINITE else ""
    return f"asymmetry {apart:.0e}, smallest eigenvalue {lowest:.0e}", wrong


@check("order of preparing", "answers depend on the order in which models are prepared")
def _reloaded(trial: Trial) -> float:
    """Load the same models again, the last one first."""
    last = len(trial.models) - 1
    trial.blackbox.load(trial.models[::-1])
    answers = trial.blackbox.traces({last - i: f for i, f in enumerate(trial.forces)})
    trial.blackbox.load(trial.models)
    return max(difference(answers[last - i], trial.traces[i]) for i in range(last + 1))


@check("matter of a volume")
def _matter(trial: Trial) -> tuple[str, str]:
    """A body that has a place in a mesh, in one volume called ``body``; the trial's other models
    have none, so that a code whose matter is
    its own takes them for soles. What the code's own matter is nobody knows: it stores energy, and
    answers forces by its own stiffness."""
    body, forces = trial.models[0], trial.everywhere(0)
    cells = np.arange(len(body.cells))
    body = replace(body, name="body in a mesh",
                   origin=Origin(np.arange(len(body.nodes)), cells, 0 * cells, ["body"]))
    stiffness, = trial.blackbox.stiffness([body])
    trial.blackbox.load([body])
    u, free = trial.blackbox.fields({0: forces})[0], ~body.fixed.ravel()
    trial.blackbox.load(trial.models)
    own, energy = trial.blackbox.traits().own_matter, np.einsum("ij,ij->i", forces, u)
    modes = motions(body.nodes - body.nodes.mean(axis=0)).reshape(-1, 6)
    rigid = float(np.abs(stiffness @ modes).max() / (abs(stiffness).max() * np.abs(modes).max()))
    values = np.linalg.eigvalsh(stiffness.toarray())
    left = difference((u @ stiffness)[:, free], forces[:, free])
    apart = difference(u, trial.expected(0))
    wrong = \
        f"forces move the body against them: of {energy.min():.2g} a load case gives energy away" \
        if energy.min() <= 0 else \
        f"its stiffness gives energy away: an eigenvalue of {values[0]:.3g} beside " \
        f"{values[-1]:.3g}" if values[0] < -RIGID * values[-1] else \
        f"rigid motions of the body cost energy: |K R| is {rigid:.1e} |K| |R|" \
        if rigid > RIGID else \
        f"displacements that do not fit its stiffness: {left:.1e} of the forces is left over" \
        if left > AGREE else \
        f"displacements otherwise than of a body without a place: {apart:.1e} ({OWN})" \
        if not own and apart > AGREE else ""
    return f"smallest energy {energy.min():.2g}, {left:.0e} of the forces left over", wrong


@check("clean death")
def _clean_death(trial: Trial) -> tuple[str, str]:
    """A process killed from outside is an error that names the subdomain, and ends the other
    processes.
    """
    pids = trial.blackbox.usage.pids()
    if not pids:
        return "no process between requests", ""
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    try:
        trial.first(trial.forces[0])
    except BlackBoxError as error:
        return "reported", "" if error.subdomain == trial.models[
            0].name else f"the error names no subdomain: {error}"
    return "", "the death of its process went unnoticed"


def _row_by_row(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of a row from what is expected, relative to that row."""
    if found.shape != expected.shape:
        return np.inf
    return max((difference(a, b) for a, b in zip(found, expected)), default=0.0)


def _of_region(model: Model, found: sp.csr_array, exact: sp.csr_array) -> str:
    """A stiffness in which some materials count otherwise than others, in words; empty where it is
    not just that.
    """
    if len(model.materials) < 2 or difference(found.toarray(), exact.toarray()) <= AGREE:
        return ""
    only = np.eye(len(model.materials))[:, :, None]
    each = [
        Solver().stiffness(
            replace(model, materials=model.materials
                    * np.hstack([own, np.ones_like(own)]))).toarray() for own in only]
    factors = np.linalg.lstsq(np.column_stack([k.ravel() for k in each]), found.toarray().ravel(),
                              rcond=None)[0]
    if difference(sum(f * k for f, k in zip(factors, each)),
                  found.toarray()) > AGREE or np.ptp(factors) <= AGREE:
        return ""
    return "; ".join(f"region {r + 1} of {len(factors)} counts {f:.6g} times"
                     for r, f in enumerate(factors)
                     if abs(f - 1) > AGREE) + \
        ": are the moduli of each tet those of materials[region]?"
