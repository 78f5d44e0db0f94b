"""Contact cases: no undecomposed reference exists, so each run is judged by the solution it tends to.

The solution of a frictional problem need not be unique. Every run is therefore continued, from where it
stopped and on the same soles, until its laws hold as well as they will; the error of each of its
iterations is the distance of the interface displacements from that end. How far the ends of two runs are
apart, and in how many statuses they differ, is reported beside. Where the continuation gets no further than the run,
the end is not known, and neither are errors.

Bodies that nothing presses on at the end have the position that stabilisation gives them, which is part of the error;
without it they have none, and wherever they drift all laws hold. The *held error* leaves out their rigid motion, at the
load steps at which they are loose; their deformation counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.status import Status

from orchestrator.blackbox.pool.pool import default_workers
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config import Config, config_from
from orchestrator.method.decomposition import Decomposition, prepare
from orchestrator.method.delivery.held_bodies import held_bodies
from orchestrator.method.delivery.interface_fields import InterfaceFields, interface_fields, mean_of_sides
from orchestrator.method.delivery.recovery import recover
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.iterated import Iterated
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.increments import Start, iterate
from orchestrator.method.stopping.bound import Bound
from orchestrator.results.fields.fields import Fields
from orchestrator.results.summary.summary import memory_peak_mb
from orchestrator.scene.conditions.rigid import motions
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.make import make_soles
from benchmarks.kit.study import Case, Study, first
from orchestrator.timing import Stopwatch

BETTER = 0.1  # residual of an end, over the run's own, from which errors may be measured against it
CONTINUED = 600  # iterations at most, to find where a run tends to
LEVELS = (1e-1, 1e-2, 1e-3, 1e-6)
_KEPT = 60_000  # trace dofs that a trail keeps; of more, evenly many


class Trail:
    """Interface displacements of every iteration, in single precision; called by the loop.

    Parameters
    ----------
    space : numbering of the traces
    """

    silent = True  # it asks no code, which may work on meanwhile

    def __init__(self, space: TraceSpace):
        self.space = space
        stride = -(-space.size // _KEPT)
        self.stride = stride + (stride > 1 and stride % 3 == 0)  # all three components are seen
        self.places: list[np.ndarray] = []

    def __call__(self, fields: Admissible, bound: Bound) -> float:
        self.places.append(self.seen(fields.w))
        return math.nan

    def seen(self, w: np.ndarray) -> np.ndarray:
        """The kept part of (T, D)."""
        return w[:, :: self.stride].astype(np.float32)

    def errors(self, w: np.ndarray) -> list[float]:
        """Relative distance of every iteration from w."""
        end = self.seen(w)
        return [apart(place, end) for place in self.places]

    def held_errors(self, w: np.ndarray, scene: Scene, loose: list[set[str]]) -> list[float]:
        """The same without the rigid motion of loose bodies.

        Parameters
        ----------
        loose : per load step, names of the subdomains that nothing holds
        """
        end = self.seen(w)
        owner = self.space.owner[:: self.stride]
        dof = self.space.dof[:: self.stride]
        rigid = {}
        for e in {s.index for s in scene.subdomains if any(s.name in names for names in loose)}:
            rows = np.flatnonzero(owner == e)
            columns = motions(scene.mesh.nodes[dof[rows] // 3]).reshape(-1, 3, 6)
            rigid[scene.subdomains[e].name] = rows, np.linalg.qr(columns[np.arange(len(rows)), dof[rows] % 3])[0]

        def error(place: np.ndarray) -> float:
            difference = (place - end).astype(float)
            for step, names in enumerate(loose):
                for rows, modes in (rigid[name] for name in names):
                    difference[step, rows] -= modes @ (modes.T @ difference[step, rows])
            return float(np.linalg.norm(difference) / np.linalg.norm(end))

        return [error(place) for place in self.places]


@dataclass
class Followed:
    """A contact case and the solution it tends to.

    Parameters
    ----------
    iterated : of the run itself; its history knows the true error
    w, status : (T, D) and (T, P) of the end, where the run was continued to
    loose : per load step, names of the subdomains that nothing holds at the end
    held_errors : per iteration, the error but for the rigid motion of these
    accuracy : law residual of the end
    fields : for pictures, if asked for
    watch, setup : seconds, of the run without its continuation, and back-substitutions per load step at set-up
    clock : the black box's CPU seconds; memory_mb : largest, of all processes
    """

    scene: Scene
    iterated: Iterated
    w: np.ndarray
    status: np.ndarray
    loose: list[set[str]]
    held_errors: list[float]
    accuracy: float
    fields: Fields | None
    interfaces: InterfaceFields
    watch: Stopwatch
    setup: float
    seconds: float
    clock: dict[str, float]
    memory_mb: float

    @property
    def history(self) -> list[Iteration]:
        return self.iterated.history


def follow(study: Study, case: Case, beside: Followed | None = None, *, towards: Followed | None = None,
           mesh_seconds: float | None = None, wants_fields: bool = False, continued: int = CONTINUED,
           measure: Mapping[str, Any] | None = None) -> Followed:
    """Solve a case, continue it to its end, add its row and its curves.

    Parameters
    ----------
    beside : the row says how far the end is from this one's
    towards : take the end of this case in the place of a continuation
    mesh_seconds : what the mesh took, when another case made it
    wants_fields : recover the fields, which counts in the seconds
    continued : iterations at most after the run's own; 0: its last iteration is its end
    measure : further columns of the row
    """
    config, watch = config_from(dict(case.config)), Stopwatch()
    with study.console.status(str(case)) as status, np.errstate(over="ignore", invalid="ignore"):  # some cases diverge
        with watch("mesh"):
            scene = study.scene(case.config)
        if mesh_seconds is not None:
            watch.start -= mesh_seconds - watch.seconds["mesh"]
            watch.seconds["mesh"] = mesh_seconds

        followed = _solve(config, scene, watch, towards, wants_fields, _Shown(status, case), continued)
    apart_from = {} if beside is None else {
        "apart": apart(followed.w, beside.w), "other_statuses": int((followed.status != beside.status).sum())}
    iterated, steps = followed.iterated, scene.steps
    row = {"subdomains": len(scene.subdomains), "dofs": 3 * len(scene.mesh.nodes), "steps": steps,
           "iterations": iterated.iterations, "setup_sweeps": round(followed.setup * steps),
           **{f"sweeps_{level:.0e}": sweeps_to(followed, "true_error", level) for level in LEVELS},
           "true_error": iterated.history[-1].true_error, "held_error": followed.held_errors[-1], "law_residual": iterated.last.law_residual,
           "indicator": iterated.last.indicator, "end_law_residual": followed.accuracy, **apart_from,
           **dict(zip(("open", "stick", "slip"), (int((followed.status == kind).sum()) for kind in range(3)))),
           "stop_reason": iterated.stop_reason, "seconds": round(followed.seconds, 2), **(measure or {})}
    study.add(case, row, followed.history, f"law residual {row['law_residual']:.1e}, error {row['true_error']:.1e}")
    return followed


def sweeps_to(followed: Followed, quantity: str, value: float) -> int | None:
    """Back-substitutions per subdomain, over all load steps and without set-up, until a quantity is at most ``value``."""
    found = first(followed.history, quantity, value)
    return found and found.iteration * followed.scene.steps


def apart(w: np.ndarray, end: np.ndarray) -> float:
    """‖w − end‖ / ‖end‖."""
    return float(np.linalg.norm(w - end) / np.linalg.norm(end)) if w.shape == end.shape else math.nan


def _solve(config: Config, scene: Scene, watch: Stopwatch, towards: Followed | None, wants_fields: bool,
           shown: Subscriber, continued: int) -> Followed:
    workers = max(default_workers() if code.workers == "auto" else code.workers for code in config.codes)
    method, fields = config.method, None
    with watch("soles"):
        soles = make_soles(scene, method.sole)
    with watch("start"):
        blackbox = make_blackbox(config.codes, {s.code for s in scene.subdomains})
    with blackbox:
        d = prepare(scene, soles, method, blackbox, workers, watch)
        trail = Trail(d.space)
        iterated = iterate(d, method, (shown,), watch, given={"true_error": trail})
        with watch("linear_stage"):
            continuous, _ = recover(d, iterated.fields, iterated.bound)
        interfaces = interface_fields(d, iterated)
        if wants_fields:
            fields = Fields.of(scene, mean_of_sides(scene, continuous), continuous, interfaces)
        seconds, clock = watch.total, blackbox.usage.clock()
        memory = memory_peak_mb() + blackbox.usage.memory_peak_mb()
        if towards is not None:
            w, status, loose, accuracy = towards.w, towards.status, towards.loose, towards.accuracy
        else:
            end = _end(d, config, scene, iterated, continued)
            w, status, accuracy = end.fields.w, end.local.status, end.last.law_residual
            last = interfaces if end is iterated else interface_fields(d, end)
            loose = [set(a + b) for a, b in zip(*held_bodies(scene, last))]
        errors, held = trail.errors(w), trail.held_errors(w, scene, loose)
        if towards is None and end is iterated and continued and not iterated.converged:  # nothing better is known
            errors, held = [[math.nan] * len(errors)] * 2
    iterated.history[:] = [replace(event, true_error=error) for event, error in zip(iterated.history, errors)]
    return Followed(scene, iterated, w, status, loose, held, accuracy, fields, interfaces, watch, d.setup_sweeps, seconds, clock, memory)


class _Shown(Subscriber):
    """Shows on the console how far a case is."""

    def __init__(self, status: Status, case: Case):
        self.status, self.case = status, case

    def iteration(self, event: Iteration) -> None:
        self.status.update(f"{self.case}: iteration {event.iteration}, law residual {event.law_residual:.1e}")


def _end(d: Decomposition, config: Config, scene: Scene, iterated: Iterated, continued: int) -> Iterated:
    """Where a run tends to: itself if it came there; else continued with the defaults, on its own soles."""
    if iterated.converged or not continued or not np.isfinite(iterated.fields.s).all():
        return iterated
    plain = config_from({**config.complete(), "method": {
        "tolerance": config.method.tolerance.model_dump(exclude_none=True), "max_iterations": continued}}).method
    stage = copy(d.stage)
    stage.macro = None  # at a solution its multiplier is zero
    view = replace(d, stage=stage, coarse=d.coarse or _coarse(d, scene, config.method))
    end = iterate(view, plain, (), Stopwatch(), Start(iterated.fields.s))
    return end if end.last.law_residual < BETTER * iterated.last.law_residual else iterated


def _coarse(d: Decomposition, scene: Scene, method):
    from orchestrator.method.coarse.correction import CoarseCorrection, kind_of
    from orchestrator.method.interface.pairing import make_pairs
    from orchestrator.method.interface.stabilisation import stabilisation

    pairs = make_pairs(scene, d.space, d.stage.direction.k, stabilisation(scene, method, d.sole_scale))
    return CoarseCorrection(scene, d.stage, pairs, kind_of("auto", scene, pairs, d.space.team))
