"""``method: {accuracy: 0.02}``: solve, estimate the error, make finer what pays, solve again."""

from __future__ import annotations

import math
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from orchestrator import run as one
from orchestrator.accuracy.criteria import (
    answers, Criterion, criterion, errors, growth, ITERATIONS, peak_of)
from orchestrator.accuracy.measured import TRUSTED, energies, explained, told
from orchestrator.accuracy.passes import (
    NAME as PASSES, Pass, Passes, drop, put_back, set_aside, set_aside_again, tightest)
from orchestrator.accuracy.sizes import GROWTH, needed, wanted
from orchestrator.apart import Mesher
from orchestrator.config.load import Loaded
from orchestrator.config.method import Tolerance
from orchestrator.config.model import Config
from orchestrator.errors import (
    BLACKBOX_FAILED, CONVERGED, NOT_CONVERGED, InternalError, OrchestratorError, wrong)
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.method.monitors.criteria import LEAST
from orchestrator.parallel.team import Elsewhere
from orchestrator.results.checkpoint import saved
from orchestrator.results.figures.figures import figures_apart
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import print_summary
from orchestrator.results.summary.summary import read_summary, write_summary
from orchestrator.scene.body import Meshed
from orchestrator.timing import Stopwatch

# two meshes, one after the other, that leave this much of the error or more: it does not fall
STALLED = 0.9
# meshers follow sizes within tens of per cent: a mesh that is to be better has at least as many
# times more elements
LEAST_GROWTH = 1.5
BETWEEN = "the next mesh has not been made yet; --resume goes on"
UNKNOWN = (
    "the iterations' error is not known, of loose bodies or nonlinear matter: the accuracy is the "
    "mesh's alone")
UNMEASURED = (
    f"; {TRUSTED:.0%} of the accuracy has to be estimated, since no energies measure what the "
    "estimate tells")


def run(loaded: Loaded, *, output: Path | None = None, resume: bool = False, quiet: bool = False,
        means: one.Means = one.Means(),
        **options: object) -> int:
    """As ``orchestrator.run.run``, which is all where no accuracy is asked for; else again and
    again, in the same folder.

    means : its judge is given the solution on every mesh
    Returns exit code: 0 the accuracy is reached, 1 it is not: a limit, an error that does not fall,
    a mesh that cannot be made or
        solved on; the folder then has what the last mesh gave that converged
    InputError, BlackBoxError, KeyboardInterrupt : as there; ``resume`` goes on in the midst of the
        mesh that was solved on
    """
    if not loaded.config.refines:
        return one.run(loaded, output=output, resume=resume, quiet=quiet, means=means, **options)
    return _Refinement(loaded, output, quiet, means).run(resume, **options)


class _Refinement:
    """The runs of one configuration, all in one folder.

    tolerance : of the iterations on the mesh that is solved on, or will be next; as given, or such
        that they leave a small share
    plan : the next mesh, as the last solution asks for it; None where no other is needed
    why : why no finer mesh is tried, though the error is too large
    unsolved : why the iterations on the last mesh have stopped without converging
    """

    def __init__(self, loaded: Loaded, output: Path | None, quiet: bool, means: one.Means):
        config = loaded.config
        self.asked = config.method.accuracy
        self.given = "tolerance" in config.method.model_fields_set
        self.tolerance = config.method.tolerance if self.given else Tolerance(
            error=max(ITERATIONS * self.asked.error, LEAST))
        self.loaded, self.quiet, self.means = loaded, quiet, means
        self.path = Path(output or config.output.directory or Path("results") / config.name)
        self.begun = self.since = time.perf_counter()
        self.watch = means.watch or Stopwatch.since_launch()
        self.passes, self.plan, self.mesher = Passes(), None, None
        self.why = self.unsolved = ""

    def run(self, resume: bool, **options: bool) -> int:
        sources = [self.config.mesh] if self.config.mesh else [
            part.source for part in self.config.parts]
        of_cad = any(source is not None and source.step is not None for source in sources)
        # other meshes are refined without libraries that may fail
        with Mesher() if of_cad else nullcontext() as self.mesher:
            return self._repeated(resume, **options)

    def _repeated(self, resume: bool, **options: bool) -> int:
        folder, team = ResultsFolder(self.path), self.means.ranks.team
        if resume:
            self.passes = Passes.read(self.path)
            self.begun -= sum(done.seconds for done in self.passes.done)
            if self.passes.tolerance:
                self.tolerance = Tolerance(error=self.passes.tolerance)
            set_aside_again(folder)
        else:
            (self.path / PASSES).unlink(missing_ok=True)
            drop(folder)
        while True:
            self.since = time.perf_counter()
            try:
                code = one.run(self._plain(), output=self.path, resume=resume and saved(folder),
                               quiet=True, means=self._means(), **options)
            except (OrchestratorError, Elsewhere) as error:
                cause = team.cause(error)
                fault = not isinstance(cause, OrchestratorError) or isinstance(
                    cause, InternalError) and cause.exit_code != BLACKBOX_FAILED
                if fault or not put_back(folder):
                    raise
                team.part(cause)
                return self._ended(NOT_CONVERGED, f"the next mesh cannot be solved on: {cause}")
            resume, options = False, options | {"start_from": None}
            if self.unsolved and put_back(folder):
                return self._ended(NOT_CONVERGED,
                                   f"on mesh {len(self.passes.done)} the iterations have not "
                                   f"converged, {self.unsolved}: the results are those of the mesh "
                                   "before")
            if code != CONVERGED or self.plan is None:
                return self._ended(code if not self.why else NOT_CONVERGED, self.why)
            set_aside(folder)
            self.passes = replace(self.passes, mesh=self.plan,
                                  tolerance=0.0 if self.given else self.tolerance.error)
            self.passes.write(self.path)
            self._told(folder, BETWEEN)  # until the next mesh is there these are the results

    @property
    def config(self) -> Config:
        """Return what was asked for, with the tolerance that follows from it."""
        config = self.loaded.config
        return config.model_copy(
            update={"method": config.method.model_copy(update={"tolerance": self.tolerance})})

    @property
    def follows(self) -> bool:
        """Whether a mesh may be solved on with a smaller tolerance than the one before."""
        return not self.given and self.tolerance.error > LEAST

    def _plain(self) -> Loaded:
        """For one mesh."""
        config = self.config.with_element(
            self.passes.element) if self.passes.element else self.config
        return replace(self.loaded, config=config.model_copy(update={
            "method": config.method.model_copy(update={"accuracy": None}),
            "output": config.output.model_copy(update={"figures": False})}))

    def _means(self) -> one.Means:
        sizes: dict[int, dict] = {}
        for (part, name), one_map in self.passes.mesh.maps.items():
            sizes.setdefault(part, {})[name] = one_map
        meshed = Meshed(sizes,
                        self.mesher) if sizes and self.mesher else Meshed(sizes)
        return replace(self.means, meshed=meshed, judge=self._judged, artist=None,
                       label="" if self.quiet else f"mesh {1 + len(self.passes.done)}",
                       watch=self.watch.again() if self.passes.done else self.watch)

    def _judged(self, solution: Solution) -> Solution:
        """The solution with its estimate; what is to come of it is decided."""
        if solution.fields.believed is not None:
            raise wrong(("method", "accuracy"), "accuracy beside a code whose matter is its own",
                        "matter of the YAML's young and poisson: of other matter stresses are not "
                        "known", "remove accuracy")
        estimator, summary, mesh = estimator_of(
            solution.scene), solution.summary, solution.scene.mesh
        found = estimator(solution.sides)
        now = energies(solution, estimator, found) if solution.converged else None
        share = told(self.passes.before, now, estimator)
        believed = solution.scene.bonded or share is not None or bool(
            self.passes.done) and explained(self.passes.before, now)
        self.passes.before, self.passes.element = now, "P1" if mesh.cells.shape[1] == 4 else "P2"
        # halved tets are within those before
        measurable = now is not None and (now.potential is not None or self.mesher is None)
        energy = criterion(solution, found, share, measurable, self.asked.error)
        made, bound = self.passes.mesh, energy.iterations
        self.passes.done.append(Pass(len(mesh.cells), len(mesh.nodes), energy.mesh,
                                     bound if math.isfinite(bound) else None, energy.error,
                                     time.perf_counter() - self.since,
                                     1e6 * summary["memory_peak_mb"], made.refined, made.kept,
                                     made.had,
                                     share, peak_of(solution), answers(summary)))
        if grows := growth([done.peak for done in self.passes.done]):
            summary["peak_stress"] = {**summary["peak_stress"], "grows": grows}
        if not self.quiet:
            print(self.passes.done[-1].line(len(self.passes.done)), flush=True)
        self.plan, self.why = None, ""
        self.unsolved = "" if solution.converged else solution.stop_reason
        met = believed and energy.met
        missed = solution.converged and not met
        if missed:
            self._decide(solution, energy)
        if self.plan is None and missed:
            beside = "" if share else UNMEASURED
            summary["converged"], summary["stop_reason"] = False, f"accuracy: {self.why}{beside}"
        summary["discretisation_error"] = self.passes.done[-1].mesh_error
        summary["config"] = self.config.complete()
        summary["accuracy"] = {"asked": self.asked.error, "reached": energy.error, "met": met,
                               "numbers": errors(self.passes.done),
                               "meshes": [vars(done) for done in self.passes.done]}
        if not math.isfinite(bound):
            summary["warnings"] = [*summary["warnings"], UNKNOWN]
        cells = found.cells / (share or 1.0)
        judged = replace(solution, summary=summary, fields=solution.fields.with_error(cells))
        return judged if self.means.judge is None else self.means.judge(judged)

    def _decide(self, solution: Solution, energy: Criterion) -> None:
        """The next mesh, or why there is none."""
        asked, done, mesh = self.asked, self.passes.done, solution.scene.mesh
        least = asked.smallest or 0.0
        errors, goal = [before.estimated for before in done], energy.goal(self.follows)
        *_, third, second, last = [math.inf] * 2 + errors
        if goal <= 0:
            self.why = f"the iterations alone leave {energy.iterations:.1e}"
        elif not energy.met and last > STALLED * second > STALLED**2 * third:
            self.why = (f"the error has stayed above {STALLED:.0%} of the mesh's before, twice"
                        + (f", with elements no smaller than {least:g}" if least else ""))
        if self.why:
            return
        order = 2 if mesh.cells.shape[1] == 10 else 1
        enough = needed([p.elements for p in done], errors, goal, order)
        least_count = LEAST_GROWTH * len(mesh.cells)
        limit = tightest(asked, done, time.perf_counter() - self.begun, max(enough, least_count))
        count = min(max(enough, least_count), GROWTH * len(mesh.cells), limit.elements)
        short = f"{limit.short} are too few: {limit.needed} are needed"
        if count < least_count:
            self.why = short
            return
        made = self.passes.mesh
        # how the mesher has followed the last sizes
        followed = len(mesh.cells) / made.elements if made.elements else 1.0
        count = min(max(count / followed, least_count), limit.elements / followed)
        plan = wanted(self.config, mesh, energy.cells / goal, count, made.maps, least)
        if plan.refined:
            self.plan = plan
        else:
            self.why = f"no elements may be smaller: smallest: {least:g}" if least else short

    def _told(self, folder: ResultsFolder, why: str) -> dict[str, object]:
        """The summary, which says why the accuracy is not reached, where it is not; what was
        decided of its mesh is in it already.
        """
        summary = read_summary(self.path)
        if why and why != self.why:
            summary |= {"converged": False, "stop_reason": f"accuracy: {why}"}
            write_summary(folder, summary)
        return summary

    def _ended(self, code: int, why: str) -> int:
        """The last of the summary, figures, the screen."""
        folder = ResultsFolder(self.path)
        drop(folder)
        summary = self._told(folder, why)
        if self.config.output.figures:
            written = Solution.read(self.path)
            figures_apart(folder, summary, written.history, written.fields)
        if not self.quiet:
            print_summary(summary, self.path, verbose=self.means.verbose)
        return code
