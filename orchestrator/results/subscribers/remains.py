"""summary.json of a run that dies: where it stood, and why it went no further."""

from __future__ import annotations

from orchestrator.config import Config
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.results.folder import ResultsFolder
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

    def failed(self, error: BaseException) -> None:
        last = self._last
        reason = "interrupted" if isinstance(error, KeyboardInterrupt) else f"failed: {str(error).splitlines()[0]}"
        write_summary(self._folder, {
            "name": self._config.name, "converged": False, "stop_reason": reason,
            "iterations": last.iteration if last else 0, "indicator": last.indicator if last else None,
            "error_bound": last.error_bound if last else None, **problem_size(self._scene),
            "timing": {"total": self._watch.total, **self._watch.seconds}, "versions": versions(),
            "config": self._config.complete(),
        })
