"""summary.json of a run that dies: where it stood, and why it went no further."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from orchestrator.config.model import Config
from orchestrator.errors import InputError, InternalError, OrchestratorError, lacks_memory
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.parallel.team import Elsewhere, Team
from orchestrator.results.checkpoint import saved
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.content import problem_size
from orchestrator.results.summary.summary import versions, write_summary
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


class Remains(Subscriber):
    """Remembers the last iteration; writes only if the run fails or is interrupted."""

    def __init__(self, folder: ResultsFolder, config: Config, scene: Scene, watch: Stopwatch):
        self._folder, self._config, self._scene, self._watch = folder, config, scene, watch
        self._last: Iteration | None = None

    def iteration(self, event: Iteration) -> None:
        self._last = event

    def unwritten(self, error: BaseException, solution: Solution) -> None:
        """The run is done, but its results could not be written."""
        self._write(f"{solution.stop_reason}, results not written: {_first_line(error)}; --resume writes them")

    def failed(self, error: BaseException) -> None:
        self._write("interrupted" if isinstance(error, KeyboardInterrupt) else f"failed: {_first_line(error)}")

    def _write(self, reason: str) -> None:
        last = self._last
        content = {"name": self._config.name, "converged": False, "stop_reason": reason,
            "iterations": last.iteration if last else 0, "indicator": last.indicator if last else None,
            "error_bound": last.error_bound if last else None, **problem_size(self._scene),
            "timing": {"total": self._watch.total, **self._watch.seconds}, "versions": versions(), "config": self._config.complete()}
        with suppress(InputError):  # a full disk; the error itself is told
            write_summary(self._folder, content)


def _first_line(error: BaseException) -> str:
    return "interrupted" if isinstance(error, KeyboardInterrupt) else (str(error).splitlines() or [type(error).__name__])[0]

NAME = "traceback.txt"


@contextmanager
def unexpected(folder: ResultsFolder, team: Team) -> Iterator[None]:
    """Turns what is no error of the user's into an ``InternalError``, its traceback into a file of the folder.

    Memory that is exhausted is a want of memory, not a bug: it is said so.
    """
    try:
        yield
    except (Exception, Elsewhere) as error:
        cause = team.cause(error)
        if isinstance(cause, OrchestratorError) or not isinstance(cause, Exception):
            raise
        text, where = "".join(traceback.format_exception(cause)), "standard error"
        try:
            where = str(folder.write(NAME, text))
        except InputError:
            traceback.print_exception(cause)
        what = f"{type(cause).__name__}: {cause}".rstrip(": ")
        raise InternalError(what, where, saved(folder), lacks_memory(cause)) from error
