"""The process that an ``Artist`` starts: gets ready, does its jobs, ends.

    python -m orchestrator.results.figures.studio < JOBS > ANSWER

JOBS are pickled pairs of a function and its arguments, one after the other; every function but the first is told what the
one before has returned. ANSWER is the pickled pair of what the last returned and of an InputError.
"""

from __future__ import annotations

import gc

gc.disable()  # a few jobs, then the end: imports are already spared

import atexit  # noqa: E402
import os  # noqa: E402
import pickle  # noqa: E402
import resource  # noqa: E402
import sys  # noqa: E402

import numpy as np  # noqa: E402

import orchestrator.results.figures.figures  # noqa: E402, F401  what a job needs, before it comes
from orchestrator.errors import InputError  # noqa: E402
from orchestrator.results.figures import surface  # noqa: E402
from orchestrator.results.figures.canvas import Canvas  # noqa: E402
from orchestrator.results.figures.plotting import warm_up  # noqa: E402
from orchestrator.results.figures.view import Camera, View  # noqa: E402


def main() -> None:
    atexit.register(gc.freeze)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    with os.fdopen(os.dup(1), "wb") as answer:
        os.dup2(2, 1)  # what libraries print is no answer
        warm_up()
        canvas = Canvas()
        canvas.draw(_example())  # VTK loads its filters, and has its shaders compiled
        result, error, told = None, None, {}
        while error is None:
            try:
                draw, job = pickle.load(sys.stdin.buffer)
            except EOFError:
                break
            try:
                result = draw(*job, canvas=canvas, **told)
            except InputError as its:
                error = its
            told = {"prepared": result}
        if told:  # otherwise the run has ended without a result
            pickle.dump((result, error), answer)


def _example() -> View:
    """A small picture of a tet that has all that pictures have."""
    nodes = np.eye(4)[:, :3]
    faces, _ = surface.outer_faces(nodes, np.arange(4)[None])
    lines = nodes[surface.edges(nodes, faces)]
    return View(nodes, faces, nodes[:, 0], lines, lines, Camera.framing(nodes), (0.0, 1.0), inches=0.1)


if __name__ == "__main__":
    main()
