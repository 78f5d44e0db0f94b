"""``orchestrator conformance``: the checks of ``conformance`` as a table."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from orchestrator.blackbox.trial.conformance import run_checks
from orchestrator.blackbox.codes.registry import NAMES, code_named
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config.method import BlackBox
from orchestrator.errors import BLACKBOX_FAILED, CONVERGED, InputError, Problem


def try_out(code: str, transport: str | None, timeout: float) -> int:
    """Run a code against the protocol and print what was found.

    Parameters
    ----------
    code : as in the YAML
    transport : "pipe" or "file"; None: all that the code has
    timeout : seconds one answer may take

    Returns
    -------
    exit code: 0 all passed, 3 some check failed

    Raises
    ------
    InputError : no such code or transport, or it is not installed
    """
    make = code_named(code)
    if make is None:
        raise InputError(Problem((), f"code {code!r}", NAMES))
    made = make()
    names = [transport] if transport else list(made.transports)
    console, failed = Console(highlight=False), 0
    for name in names:
        settings = BlackBox.model_construct(code=code, element="P1", transport=name, workers=1, timeout=timeout)
        table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
        for check, figure, wrong in run_checks(lambda: make_blackbox(settings)):
            failed += bool(wrong)
            verdict = Text("failed", "bold red") if wrong else Text("passed", "green")
            table.add_row(verdict, check, Text(wrong or figure))
        version = made.version()
        console.print(f"{made.name}{' ' + version if version else ''}, transport {name}", style="bold")
        console.print(table)
    console.print(Text(f"{failed} failed", "bold red") if failed else Text("It keeps the protocol.", "bold green"))
    return BLACKBOX_FAILED if failed else CONVERGED
