"""summary.json of a run that dies: where it stood, and why it went no further."""

from __future__ import annotations

from contextlib import suppress

from orchestrator.config import Config
from orchestrator.errors import InputError
from orchestrator.method.events import Iteration, Subscriber
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
        content = {
            "name": self._config.name, "converged": False, "stop_reason": reason,
            "iterations": last.iteration if last else 0, "indicator": last.indicator if last else None,
            "error_bound": last.error_bound if last else None, **problem_size(self._scene),
            "timing": {"total": self._watch.total, **self._watch.seconds}, "versions": versions(),
            "config": self._config.complete(),
        }
        with suppress(InputError):  # a full disk; the error itself is told
            write_summary(self._folder, content)


def _first_line(error: BaseException) -> str:
    return "interrupted" if isinstance(error, KeyboardInterrupt) else (str(error).splitlines() or [type(error).__name__])[0]
