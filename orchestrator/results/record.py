"""The files of a run: those that it keeps up to date while it lasts, and those that it ends
with.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from orchestrator.config.model import Config
from orchestrator.errors import (
    InputError, InternalError, OrchestratorError, lacks_memory, wrong)
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.parallel.team import Elsewhere, Team
from orchestrator.results.checkpoint import (
    NAME as CHECKPOINT, PROBLEM, VERSION, begun, load_checkpoint, saved)
from orchestrator.results.figures.artist import Artist, CannotDraw, no_figures
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.fingerprint import digest_of, problem_of
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.history import HistoryWriter, read_history
from orchestrator.results.keeping import CheckpointWriter
from orchestrator.results.solution import Solution
from orchestrator.results.starting import (
    Choose, keep_state, layout_of, nearest_start, started_from)
from orchestrator.results.summary.content import note_time, problem_size
from orchestrator.results.summary.summary import versions, write_summary
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.overlap import by_nodes
from orchestrator.timing import Stopwatch

TRACEBACK = "traceback.txt"
OTHERS = ("the run has begun with the state of another one: where friction allows several "
          "solutions the start may decide; without --start-from, or in a sweep with method.start: "
          "cold, it begins at zero")
GO_ON = "To go on: the same command with --resume."


class Record(Subscriber):
    """Record that a run leaves in its folder while it lasts; to be closed.

    folder : cleared of an earlier run's results, unless this one goes on from there
    resume : go on from the checkpoint in the folder
    start_from : folder of another run whose state this one begins with; choose: the folders of
        several, if any fit
    start : where the run goes on from; None at the beginning
    scene, watch : as given
    artist : who draws the figures; None: nobody, as where none are asked for or nothing that draws
        is installed
    subscribers : history, checkpoint, and this, which writes a summary if the run dies
    Raises InputError: nothing to resume from, folder not writable, disk full
    """

    def __init__(self, folder: ResultsFolder, config: Config, scene: Scene, watch: Stopwatch,
                 artist: Artist | None = None, *,
                 resume: bool = False, start_from: Path | None = None,
                 choose: Choose | None = None):
        problem = problem_of(config.complete(), scene.prints)
        problem["version of checkpoints"] = str(VERSION)
        key = digest_of(problem)
        self.start = load_checkpoint(folder, key, problem) if resume else None
        if resume and self.start is None:
            print(f"No iteration is kept in {folder.path}: the run begins at its beginning.",
                  file=sys.stderr)
        self._layout = layout_of(scene, by_nodes(scene, config.method))
        if self.start is None and (start_from or choose):
            if start_from and start_from.absolute() == folder.path.absolute():
                raise wrong((), f"--start-from {start_from}, the folder that this run writes to",
                            "another run's", "give this run another one with --output")
            self.start = (started_from(start_from, self._layout) if start_from
                          else nearest_start(choose, self._layout))
        if not resume:
            folder.clear()
            begun(folder)
            folder.write(f"{CHECKPOINT}/{PROBLEM}", json.dumps(problem, indent=1))
        self.scene, self.watch, self._config, self._folder = scene, watch, config, folder
        self._last, self._artist = None, artist
        self._checkpoint = CheckpointWriter(folder, key, self.start)
        self._history = HistoryWriter(folder, self.start and self.start.iteration or None)
        # the history first: of what the checkpoint has, no line may be missing; a line too many is
        # cut off on resuming
        self.subscribers = [self._history, self, self._checkpoint]

    def finish(self, solution: Solution) -> None:
        """Fields, summary and figures of a finished run; if it has converged, the checkpoint goes
        once the former are there.

        Whatever keeps fields and summary from being written, the checkpoint stays: ``--resume``
        then does nothing but write. Figures come last, and hold up nothing: the command ``report``
        draws them from what is there.

        solution : in its summary, the time that all this takes is noted
        """
        summary, folder = solution.summary, self._folder
        warnings = summary["warnings"] = list(summary.get("warnings") or ())
        summary["started_from"] = self.start and self.start.origin
        if summary["started_from"] and any(i.has_history for i in self.scene.interfaces):
            warnings.append(OTHERS)
        try:
            self._history.complete()
            with self.watch("output"):
                if self._config.output.figures:
                    warnings += no_figures()
                if self._artist:
                    note_time(summary, self.watch)
                    self._artist.begin(write_figures, folder, summary, read_history(folder.path),
                                       solution.fields)
                solution.write_results(folder)
            self._summarise(summary)
        except BaseException as error:
            self._left_off(f"{solution.stop_reason}, results not written: {_first_line(error)}; "
                           "--resume writes them")
            raise
        try:
            keep_state(folder, self._checkpoint.ended, self._layout)
        except InputError as error:
            warnings.append(f"no run can begin with this one's end: {error.problems[0].found}")
            self._summarise(summary)
        if solution.converged:
            self._checkpoint.remove()
        if self._artist:
            with self.watch("output"):
                try:
                    self._artist.finish()
                except CannotDraw as error:  # charts can be drawn here
                    write_figures(folder, summary, read_history(folder.path))
                    warnings.append(f"no pictures of the structure: {error}; orchestrator report "
                                    f"{folder.path} draws them")
            self._summarise(summary)

    def _summarise(self, summary: dict[str, object]) -> None:
        note_time(summary, self.watch)
        write_summary(self._folder, summary)

    def close(self) -> None:
        """Close the history."""
        self._history.close()

    def iteration(self, event: Iteration) -> None:
        self._last = event.without_state()

    def failed(self, error: BaseException) -> None:
        told = _first_line(error)
        self._left_off(told if isinstance(error, KeyboardInterrupt) else f"failed: {told}")

    def _left_off(self, reason: str) -> None:
        """Write the summary of a run that dies: where it stood, and why it went no further."""
        last = self._last
        content = {"name": self._config.name, "converged": False, "stop_reason": reason,
                   "iterations": last.iteration if last else 0,
                   "indicator": last and last.indicator, "error_bound": last and last.error_bound,
                   **problem_size(self.scene), "versions": versions(),
                   "timing": {"total": self.watch.total, **self.watch.seconds},
                   "config": self._config.complete()}
        with suppress(InputError):  # a full disk; the error itself is told
            write_summary(self._folder, content)


def _first_line(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return (str(error).splitlines() or [type(error).__name__])[0]


@contextmanager
def unexpected(folder: ResultsFolder, team: Team) -> Iterator[None]:
    """Turns what is no error of the user's into an ``InternalError``, its traceback into a file of
    the folder.

    Memory that is exhausted is a want of memory, not a bug: it is said so. An interrupt says how to
    go on, where that can be.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(*(error.args or [GO_ON] * saved(folder))) from error
    except (Exception, Elsewhere) as error:
        cause = team.cause(error)
        if isinstance(cause, OrchestratorError) or not isinstance(cause, Exception):
            raise
        text, where = "".join(traceback.format_exception(cause)), "standard error"
        try:
            where = str(folder.write(TRACEBACK, text))
        except InputError:
            traceback.print_exception(cause)
        what = f"{type(cause).__name__}: {cause}".rstrip(": ")
        raise InternalError(what, where, saved(folder), lacks_memory(cause)) from error
