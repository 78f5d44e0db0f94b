"""Draws the figures of a run in another process, which is made ready while the run computes.

    python -m orchestrator.results.figures.artist

To import what draws and to open a window takes as long as the iterations of a small problem.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Mapping

import numpy as np

from orchestrator.errors import InputError
from orchestrator.parallel.launcher import without_launcher
from orchestrator.results.figures.drawing import Drawing
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.figures.plotting import warm_up


class Artist:
    """The process; as a context manager it is ended on leaving. Where it fails, this process draws."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._job: tuple[object, ...] = ()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "orchestrator.results.figures.artist"], env=without_launcher(os.environ),
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                process_group=0)  # Ctrl-C is for the run, which then ends it
        except OSError:
            pass

    def begin(self, folder: ResultsFolder, summary: Mapping[str, object], history: Mapping[str, np.ndarray],
              fields: Fields | None) -> None:
        """Hands over a job: parameters as for ``write_figures``."""
        self._job = folder, summary, history, fields
        if self._process is not None:
            try:
                pickle.dump(self._job, self._process.stdin, pickle.HIGHEST_PROTOCOL)
                self._process.stdin.flush()
            except OSError:  # it has ended: ``finish`` tells
                pass

    def finish(self) -> None:
        """Waits for the figures.

        Raises
        ------
        InputError : disk full or folder not writable
        """
        answer, _ = self._process.communicate() if self._process is not None else (b"", None)
        if not answer:
            write_figures(*self._job)
        elif error := pickle.loads(answer):
            raise error

    def close(self) -> None:
        """Ends the process if it still runs."""
        if self._process is not None:
            self._process.terminate()
            self._process.communicate()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def main() -> None:
    """Gets ready, draws one job from standard input, answers on standard output: None or an InputError."""
    gc.disable()  # one job, then the end
    atexit.register(gc.freeze)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # so that it ends its own process too
    warm_up()
    drawing = Drawing()
    try:
        job = pickle.load(sys.stdin.buffer)
        error = None
        try:
            write_figures(*job, drawing=drawing)
        except InputError as its:
            error = its
        pickle.dump(error, sys.stdout.buffer)
    except EOFError:  # the run has ended without a result
        pass
    finally:
        drawing.close()


if __name__ == "__main__":
    main()
