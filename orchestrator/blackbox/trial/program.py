"""Does a program keep the protocol of two files in and two out? A table of what was asked, and of what is wrong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.blackbox.codes.foreign.condensed import judged
from orchestrator.blackbox.codes.foreign.program import Answers
from orchestrator.config.foreign_parts import ProgramPart
from orchestrator.errors import InputError
from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.foreign.program_run import JOINT, ProgramRuns
from orchestrator.scene.foreign.tables import checked_nodes


def checks(run: str, timeout: float) -> Iterator[tuple[str, str, str]]:
    """(check, figure, what is wrong: empty when it passed), up to the first failure.

    Parameters
    ----------
    run : the program; timeout : seconds that one call may take
    """
    try:
        runs = ProgramRuns(ProgramPart(run=run, timeout=timeout), (), "it")
        rows = runs.joints()
        ids, points = checked_nodes([(i, [float(w) for w in words[:4]]) for i, words in enumerate(rows, 1)], JOINT, ())
        names = list(dict.fromkeys(words[4] for words in rows if len(words) == 5))
        joints = Joints(ids, points, np.empty((0, 3), int), np.empty(0, int), names, np.zeros((len(ids), 3), bool), np.eye(6))
        yield "a call without joint nodes", f"{len(ids)} nodes" + (f" of {', '.join(names)}" if names else "") + \
            f", between {_place(points.min(axis=0))} and {_place(points.max(axis=0))}", ""
        answers = Answers.of(runs, joints, joints.size)
        n = len(answers.springs)
        yield f"{n + 3:,} cases in one call", f"springs of {answers.springs[0]:.3g} suit it", ""
        yield "repeated, linear, at rest without forces", "", ""
        yield "reciprocal, positive", f"asymmetry {answers.asymmetry:.0e}", ""
        yield "rigid motions", _held(joints, answers), ""
        yield "digits", f"{answers.digits:.0e} of each is rounding" if answers.digits else "all that doubles have", ""
    except InputError as error:
        yield "it stops here", "", f"{error.problems[0].found}; expected {error.problems[0].expected}. {error.problems[0].cure}"


def _held(joints: Joints, answers: Answers) -> str:
    """Whether supports inside hold it; raises InputError where the stiffness is none."""
    try:
        judged(joints, answers.stiffness, np.zeros((1, len(answers.springs))), (), "it", answers.error)
    except InputError:
        held = Joints(*(getattr(joints, f) for f in ("ids", "points", "triangles", "joint", "names", "held")), np.zeros((6, 0)))
        judged(held, answers.stiffness, np.zeros((1, len(answers.springs))), (), "it", answers.error)
        return "cost force: supports inside hold it, write held: true in its entry"
    return "cost nothing: it is not held inside"


def _place(x: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"
