"""The process that an ``Artist`` starts: gets ready, does one job, ends.

    python -m orchestrator.results.figures.studio < JOB > ANSWER

JOB is the pickled pair of a function and its arguments, ANSWER that of what it returned and of its InputError.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import resource
import sys

import orchestrator.results.figures.figures  # noqa: F401  what a job needs, before it comes
from orchestrator.errors import InputError
from orchestrator.results.figures.canvas import Canvas
from orchestrator.results.figures.plotting import warm_up


def main() -> None:
    gc.disable()  # one job, then the end
    atexit.register(gc.freeze)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    with os.fdopen(os.dup(1), "wb") as answer:
        os.dup2(2, 1)  # what libraries print is no answer
        warm_up()
        canvas = Canvas()
        try:
            draw, job = pickle.load(sys.stdin.buffer)
        except EOFError:  # the run has ended without a result
            return
        result = error = None
        try:
            result = draw(*job, canvas=canvas)
        except InputError as its:
            error = its
        pickle.dump((result, error), answer)


if __name__ == "__main__":
    main()
