"""``method: {accuracy: 0.02}``: solve, estimate the error, make finer what pays, solve again."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

from orchestrator import run as one
from orchestrator.accuracy.measured import TRUSTED, energies, explained, told
from orchestrator.accuracy.passes import Pass, Passes, drop, put_back, set_aside
from orchestrator.accuracy.sizes import GROWTH, needed, wanted
from orchestrator.config.load import Loaded
from orchestrator.config.method import Accuracy, Tolerance
from orchestrator.errors import BLACKBOX_FAILED, CONVERGED, NOT_CONVERGED, InternalError, OrchestratorError, wrong
from orchestrator.method.monitors.mesh_error import LEAST
from orchestrator.method.stopping.discretisation import Estimate, Estimator
from orchestrator.method.stopping.element_problems import ElementProblems
from orchestrator.results.checkpoint import saved
from orchestrator.results.figures.artist import CannotDraw, drawn
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.screen import print_summary
from orchestrator.results.summary.summary import read_summary, write_summary
from orchestrator.scene.body import Meshed
from orchestrator.timing import EXPONENT

ITERATIONS = 0.1  # share of the iterations in what is asked for
AIM = 0.9  # what a mesh is made for, of what is asked for: sizes are followed within some tenths, and counts of elements even out
STALLED = 0.9  # two meshes, one after the other, that leave this much of the error or more: it does not fall
LEAST_GROWTH = 1.5  # meshers follow sizes within tens of per cent: a mesh that is to be better has at least as many times more elements
UNKNOWN = "the iterations' error is not known, of loose bodies or nonlinear matter: the accuracy is the mesh's alone"

UNMEASURED = f"; {TRUSTED:.0%} of the accuracy has to be estimated, since no energies measure what the estimate tells"


def run(loaded: Loaded, *, output: Path | None = None, resume: bool = False, quiet: bool = False, means: one.Means = one.Means(),
        **options: bool) -> int:
    """As ``orchestrator.run.run``, which is all where no accuracy is asked for; else again and again, in the same folder.

    means : its judge is given the solution on every mesh
    Returns exit code: 0 the accuracy is reached, 1 it is not: a limit, an error that does not fall, a mesh that cannot be made or
        solved on; the folder then has what the last mesh gave that converged
    InputError, BlackBoxError, KeyboardInterrupt : as there; ``resume`` goes on in the midst of the mesh that was solved on
    """
    if loaded.config.method.accuracy is None:
        return one.run(loaded, output=output, resume=resume, quiet=quiet, means=means, **options)
    if means.ranks.team.size > 1:
        raise wrong(("method", "accuracy"), f"accuracy on {means.ranks.team.size} ranks", "one process",
                    "start it without mpiexec; or take the last mesh's sizes, and run it on ranks without accuracy")
    return _Refinement(loaded, output, quiet, means).run(resume, **options)


class _Refinement:
    """The runs of one configuration, all in one folder.

    plan : the next mesh, as the last solution asks for it; None where no other is needed
    why : why no finer mesh is tried, though the error is too large
    unsolved : why the iterations on the last mesh have stopped without converging
    """

    def __init__(self, loaded: Loaded, output: Path | None, quiet: bool, means: one.Means):
        config = loaded.config
        self.asked: Accuracy = config.method.accuracy
        given = "tolerance" in config.method.model_fields_set
        tolerance = config.method.tolerance if given else Tolerance(error=max(ITERATIONS * self.asked.error, LEAST))
        self.config = config.model_copy(update={"method": config.method.model_copy(update={"tolerance": tolerance})})
        plain = self.config.model_copy(update={
            "method": self.config.method.model_copy(update={"accuracy": None}),
            "output": config.output.model_copy(update={"figures": False})})
        self.loaded, self.quiet, self.means = replace(loaded, config=plain), quiet, means
        self.path = Path(output or config.output.directory or Path("results") / config.name)
        self.begun, self.since = time.perf_counter(), time.perf_counter()
        self.passes, self.plan, self.why, self.unsolved = Passes(), None, "", ""

    def run(self, resume: bool, **options: bool) -> int:
        if resume:
            self.passes = Passes.read(self.path)
        else:
            Passes.forget(self.path)
        folder = ResultsFolder(self.path)
        if not resume:
            drop(folder)
        while True:
            self.since = time.perf_counter()
            try:
                code = one.run(self.loaded, output=self.path, resume=resume and saved(folder), quiet=True, means=self._means(), **options)
            except OrchestratorError as error:
                fault = isinstance(error, InternalError) and error.exit_code != BLACKBOX_FAILED
                if fault or not put_back(folder):
                    raise
                return self._ended(NOT_CONVERGED, f"the next mesh cannot be solved on: {error}")
            resume = False
            if self.unsolved and put_back(folder):
                return self._ended(NOT_CONVERGED, f"on mesh {len(self.passes.done)} the iterations have not converged, {self.unsolved}: "
                                                  "the results are those of the mesh before")
            if code != CONVERGED or self.plan is None:
                return self._ended(code if not self.why else NOT_CONVERGED, self.why)
            set_aside(folder)
            self.passes = Passes(self.passes.done, self.plan.maps, self.plan.elements, self.plan.refined, self.plan.kept,
                                 self.passes.before)
            self.passes.write(self.path)

    def _means(self) -> one.Means:
        sizes: dict[int, dict] = {}
        for (part, name), one_map in self.passes.maps.items():
            sizes.setdefault(part, {})[name] = one_map
        return replace(self.means, meshed=Meshed(sizes), judge=self._judged, artist=None, watch=None)

    def _judged(self, solution: Solution) -> Solution:
        """The solution with its estimate; what is to come of it is decided."""
        if solution.fields.believed is not None:
            raise wrong(("method", "accuracy"), "accuracy beside a code whose matter is its own", "matter of the YAML's young and poisson: "
                        "of other matter stresses are not known", "remove accuracy")
        estimator = estimator_of(solution)
        found = estimator(solution.sides)
        now = energies(solution, estimator, found) if solution.converged else None
        share = told(self.passes.before, now)
        bonded = all(i.law.perfect for i in solution.scene.interfaces)
        believed = bonded or share is not None or bool(self.passes.done) and explained(self.passes.before, now)
        self.passes.before = now
        summary, bound, mesh = solution.summary, solution.error_bound, solution.scene.mesh
        whole, sure = (_together(found.relative / one, bound, bonded) for one in (share or 1.0, share or TRUSTED))
        self.passes.done.append(Pass(len(mesh.cells), len(mesh.nodes), found.relative / (share or 1.0),
                                     bound if math.isfinite(bound) else None, whole, time.perf_counter() - self.since,
                                     self.passes.refined, self.passes.kept, share))
        if not self.quiet:
            print(self.passes.done[-1].line(len(self.passes.done)), flush=True)
        self.plan, self.why, self.unsolved = None, "", "" if solution.converged else solution.stop_reason
        met = sure <= self.asked.error and believed
        missed = solution.converged and not met
        if missed:
            self._decide(solution, found)
        if self.plan is None and missed:
            beside = "" if share else UNMEASURED
            summary["converged"], summary["stop_reason"] = False, f"accuracy: {self.why}{beside}"
        summary["discretisation_error"] = self.passes.done[-1].mesh_error
        summary["config"] = self.config.complete()
        summary["accuracy"] = {"asked": self.asked.error, "reached": whole, "met": bool(met),
                               "meshes": [vars(done) for done in self.passes.done]}
        if not math.isfinite(bound):
            summary["warnings"] = [*summary["warnings"], UNKNOWN]
        judged = replace(solution, summary=summary, fields=solution.fields.with_error(found.cells / (share or 1.0)))
        return judged if self.means.judge is None else self.means.judge(judged)

    def _decide(self, solution: Solution, found: Estimate) -> None:
        """The next mesh, or why there is none."""
        asked, done = self.asked, self.passes.done
        least = asked.smallest or 0.0
        goal = AIM * asked.error - (done[-1].error - done[-1].mesh_error)
        if goal <= 0:
            self.why = f"the iterations alone leave {done[-1].iterations_error:.1e}"
            return
        if len(done) > 2 and done[-1].estimated > STALLED * done[-2].estimated > STALLED**2 * done[-3].estimated:
            self.why = (f"the error has stayed above {STALLED:.0%} of the mesh's before, twice"
                        + (f", with elements no smaller than {least:g}" if least else ""))
            return
        mesh = solution.scene.mesh
        order = 2 if mesh.cells.shape[1] == 10 else 1
        enough = needed([p.elements for p in done], [p.estimated for p in done], goal * done[-1].share, order)
        spent = time.perf_counter() - self.begun
        in_time = len(mesh.cells) * (max((asked.seconds or math.inf) - spent, 0.0) / done[-1].seconds) ** (1 / EXPONENT)
        count = min(max(enough, LEAST_GROWTH * len(mesh.cells)), GROWTH * len(mesh.cells), asked.elements or math.inf, in_time)
        if count < LEAST_GROWTH * len(mesh.cells):
            short = (f"{asked.seconds:g} seconds, of which {spent:.0f} are spent," if count == in_time else f"{asked.elements:,} elements")
            more = max(enough, LEAST_GROWTH * len(mesh.cells))
            self.why = f"{short} are too few: about {more:,.0f} elements are needed"
            return
        followed = len(mesh.cells) / self.passes.elements if self.passes.elements else 1.0  # how the mesher has followed the last sizes
        plan = wanted(self.config, mesh, found.cells, count / followed, self.passes.maps, least)
        if not plan.refined:
            self.why = f"no elements may be smaller: smallest: {least:g}"
            return
        self.plan = plan

    def _ended(self, code: int, why: str) -> int:
        """The last of the summary, figures, the screen."""
        folder, summary = ResultsFolder(self.path), read_summary(self.path)
        drop(folder)
        if why and summary.get("converged"):
            summary |= {"converged": False, "stop_reason": f"accuracy: {why}"}
            write_summary(folder, summary)
        if self.config.output.figures:
            written = Solution.read(self.path)
            try:
                drawn(write_figures, folder, summary, written.history, written.fields)
            except CannotDraw:
                write_figures(folder, summary, written.history)
        if not self.quiet:
            print_summary(summary, self.path, verbose=self.means.verbose)
        return code


def estimator_of(solution: Solution) -> Estimator:
    """Of the error of its mesh: of ten-node tets by a problem in each, of four-node ones by recovered stresses."""
    scene = solution.scene
    return (ElementProblems if scene.mesh.cells.shape[1] == 10 else Estimator).of(scene)


def _together(mesh: float, iterations: float, bonded: bool) -> float:
    """Both errors: of bonds the legs of a right-angled triangle; with contact no more than their sum."""
    if not math.isfinite(iterations):
        return mesh
    return math.hypot(mesh, iterations) if bonded else mesh + iterations
