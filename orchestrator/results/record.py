"""The files of a run: those that it keeps up to date while it lasts, and those that it ends with."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType

from orchestrator.blackbox.codes.foreign.results import OwnFields
from orchestrator.config.model import Config
from orchestrator.method.checkpoint import Start
from orchestrator.results.checkpoint import NAME as CHECKPOINT
from orchestrator.results.checkpoint import PROBLEM, CheckpointWriter, begun, load_checkpoint
from orchestrator.results.fields.files import write_fields
from orchestrator.results.figures.artist import Artist, CannotDraw
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.fingerprint import digest_of, problem_of
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.subscribers.history import HistoryWriter, read_history
from orchestrator.results.subscribers.remains import Remains
from orchestrator.results.summary.content import note_time
from orchestrator.results.summary.summary import write_summary
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


class Record:
    """What a run leaves in its folder while it lasts; as a context manager it is closed on leaving.

    folder : cleared of an earlier run's results, unless this one goes on from there
    resume : go on from the checkpoint in the folder
    start : where the run goes on from; None at the beginning
    scene, watch : as given
    subscribers : history, checkpoint, and what remains if the run dies
    Raises InputError: nothing to resume from, folder not writable, disk full
    """

    def __init__(self, folder: ResultsFolder, config: Config, scene: Scene, watch: Stopwatch, *, resume: bool = False):
        problem = problem_of(config.complete(), scene.mesh.nodes, scene.mesh.cells)
        key = digest_of(problem)
        self.start = load_checkpoint(folder, key, problem) if resume else None
        if resume and self.start is None:
            print(f"No iteration is kept in {folder.path}: the run begins at its beginning.", file=sys.stderr)
        if not resume:
            folder.clear()
            begun(folder)
            folder.write(f"{CHECKPOINT}/{PROBLEM}", json.dumps(problem, indent=1))
        self.scene, self.watch, self._folder, self._key = scene, watch, folder, key
        self._checkpoint = CheckpointWriter(folder, key, self.start)
        self._history = HistoryWriter(folder, self.start and self.start.iteration)
        self._remains = Remains(folder, config, scene, watch)
        # the history first: of what the checkpoint has, no line may be missing; a line too many is cut off on resuming
        self.subscribers = [self._history, self._checkpoint, self._remains]

    def finish(self, solution: Solution, fields: bool, artist: Artist | None, beside: Sequence[OwnFields] = ()) -> None:
        """Fields, summary and figures of a finished run; if it has converged, the checkpoint goes once the former are there.

        Whatever keeps fields and summary from being written, the checkpoint stays: ``--resume`` then does nothing but
        write. Figures come last, and hold up nothing: the command ``report`` draws them from what is there.

        solution : in its summary, the time that all this takes is noted; where it is of several ranks, these write its fields
            together: the others ``write_piece``
        fields : whether they are wanted
        artist : who draws the figures; None: nobody
        beside : fields of parts with a mesh of their own
        """
        summary = solution.summary
        try:
            self._history.complete()
            with self.watch("output"):
                if artist:
                    note_time(summary, self.watch)
                    artist.begin(write_figures, self._folder, summary, read_history(self._folder.path), solution.fields)
                if fields:
                    write_fields(self._folder, solution.fields, solution.piece, beside)
                if solution.answers is not None:
                    solution.answers.write(self._folder)
            self._summarise(summary)
        except BaseException as error:
            self._remains.unwritten(error, solution)
            raise
        if solution.converged:
            self._checkpoint.remove()
        if artist:
            with self.watch("output"):
                try:
                    artist.finish()
                except CannotDraw as error:  # charts can be drawn here
                    write_figures(self._folder, summary, read_history(self._folder.path))
                    summary["warnings"] = [*(summary.get("warnings") or ()), f"no pictures of the structure: {error}; "
                                           f"orchestrator report {self._folder.path} draws them"]
            self._summarise(summary)

    def _summarise(self, summary: dict[str, object]) -> None:
        note_time(summary, self.watch)
        write_summary(self._folder, summary)

    def latest(self) -> Start | None:
        """Where the run stands, to go on from: all that it has told is in the checkpoint."""
        found = load_checkpoint(self._folder, self._key)
        # this run's clock goes on, and so does its count of iterations
        return found and replace(found, seconds=0.0, before=0 if self.start is None else self.start.iteration)

    def keeps(self) -> bool:
        """Whether a checkpoint is written, so that there is something to go on from."""
        return self._checkpoint.keeps

    def __enter__(self) -> Record:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._history.close()
