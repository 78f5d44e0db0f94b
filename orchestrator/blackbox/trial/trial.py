"""``orchestrator conformance``: does a code, or a program with a mesh of its own, keep its
protocol? A table of checks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from orchestrator.blackbox.start import find_codes
from orchestrator.scene.foreign.condensed import judged
from orchestrator.scene.foreign.answers import UnitAnswers
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.trial.conformance import run_checks
from orchestrator.config.blackbox import settings_class
from orchestrator.config.mesh import ProgramPart
from orchestrator.config.load import settings_from
from orchestrator.errors import BLACKBOX_FAILED, CONVERGED, InputError
from orchestrator.registry import CODES
from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.foreign.program import JOINT, ProgramRuns
from orchestrator.scene.foreign.matrix import checked_nodes
from orchestrator.scene.mesh.geometry import format_point

Checks = Iterable[tuple[str, str, str]]  # check, figure, what is wrong: empty when it passed


def try_out(code: str, transport: str | None, timeout: float) -> int:
    """Run a code against the protocol and print what was found.

    code : as in the YAML
    transport : "pipe" or "file"; None: all that the code has
    timeout : seconds one answer may take

    Returns exit code: 0 all passed, 3 some check failed
    Raises InputError: no such code or transport, or it is not installed
    """
    console, failed = Console(highlight=False), 0
    if code not in CODES and not code.partition(":")[0].endswith(".py") and Path(code).is_file():
        failed = _shown(console, code, _of_program(code, timeout))
    else:
        wanted = {"code": code, "workers": 1, "timeout": timeout}
        transports = get_args(settings_class(wanted).model_fields["transport"].annotation)
        entries = [settings_from({**wanted, "transport": name})
                   for name in ([transport] if transport else transports)]
        for found in find_codes(entries).values():
            said = f"{found.name} {found.version()}".strip()
            failed += _shown(console, f"{said}, transport {found.settings.transport}",
                             run_checks(lambda: Pool({0: found})))
    console.print(Text(f"{failed} failed", "bold red") if failed
                  else Text("It keeps the protocol.", "bold green"))
    return BLACKBOX_FAILED if failed else CONVERGED


def _shown(console: Console, title: str, checks: Checks) -> int:
    """Print a table of checks; how many failed."""
    table, failed = Table(box=None, show_header=False, padding=(0, 2, 0, 0)), 0
    for check, figure, wrong in checks:
        failed += bool(wrong)
        table.add_row(Text("failed", "bold red") if wrong else Text("passed", "green"), check,
                      Text(wrong or figure))
    console.print(title, style="bold")
    console.print(table)
    return failed


def _of_program(run: str, timeout: float) -> Iterator[tuple[str, str, str]]:
    """Checks of a program that reads two files and writes two, up to the first failure.

    run : the program; timeout : seconds that one call may take
    """
    try:
        runs = ProgramRuns(ProgramPart(run=run, timeout=timeout), (), "it")
        rows = runs.joints()
        table = [[float(w) for w in words[:4]] for words in rows]
        ids, points = checked_nodes(table, JOINT, ())
        names = list(dict.fromkeys(words[4] for words in rows if len(words) == 5))
        joints = Joints(ids, points, np.empty((0, 3), int), np.empty(0, int), names,
                        np.zeros((len(ids), 3), bool), np.eye(6))
        of = f" of {', '.join(names)}" if names else ""
        between = f"{format_point(points.min(axis=0))} and {format_point(points.max(axis=0))}"
        yield "a call without joint nodes", f"{len(ids)} nodes{of}, between {between}", ""
        answers = UnitAnswers.of(runs, joints, joints.size)
        n = len(answers.springs)
        yield f"{n + 3:,} cases in one call", f"springs of {answers.springs[0]:.3g} suit it", ""
        yield "repeated, linear, at rest without forces", "", ""
        yield "reciprocal, positive", f"asymmetry {answers.asymmetry:.0e}", ""
        yield "rigid motions", _held(joints, answers), ""
        yield (
            "digits", f"{answers.digits:.0e} of each is rounding" if answers.digits
            else "all that doubles have", "")
    except InputError as error:
        yield (
            "it stops here", "", f"{error.problems[0].found}; expected "
                                 f"{error.problems[0].expected}. {error.problems[0].cure}")


def _held(joints: Joints, answers: UnitAnswers) -> str:
    """Whether supports inside hold it; raises InputError where the stiffness is none."""
    loads = np.zeros((1, len(answers.springs)))
    try:
        judged(joints, answers.stiffness, loads, (), "it", answers.error)
    except InputError:
        judged(replace(joints, left=np.zeros((6, 0))), answers.stiffness, loads, (), "it",
               answers.error)
        return "cost force: supports inside hold it, write held: true in its entry"
    return "cost nothing: it is not held inside"
