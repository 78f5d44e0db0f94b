"""``orchestrator conformance``: the checks of ``conformance`` as a table."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from rich.console import Console
from rich.table import Table
from rich.text import Text

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.pool.pool import Pool
from orchestrator.blackbox.trial.conformance import run_checks
from orchestrator.config.blackbox import settings_class
from orchestrator.config.load import settings_from
from orchestrator.errors import BLACKBOX_FAILED, CONVERGED
from orchestrator.registry import CODES


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
    if code not in CODES and not code.partition(":")[0].endswith(".py") and Path(code).is_file():
        return _program(code, timeout)
    wanted = {"code": code, "workers": 1, "timeout": timeout}
    transports = get_args(settings_class(wanted).model_fields["transport"].annotation)
    entries = [settings_from({**wanted, "transport": name}) for name in ([transport] if transport else transports)]
    console, failed = Console(highlight=False), 0
    for found in find_codes(entries).values():
        table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
        for check, figure, wrong in run_checks(lambda: Pool(found)):
            failed += bool(wrong)
            verdict = Text("failed", "bold red") if wrong else Text("passed", "green")
            table.add_row(verdict, check, Text(wrong or figure))
        version = found.version()
        console.print(f"{found.name}{' ' + version if version else ''}, transport {found.settings.transport}", style="bold")
        console.print(table)
    console.print(Text(f"{failed} failed", "bold red") if failed else Text("It keeps the protocol.", "bold green"))
    return BLACKBOX_FAILED if failed else CONVERGED


def _program(run: str, timeout: float) -> int:
    """The same for a program with a mesh of its own."""
    from orchestrator.blackbox.trial.program import checks

    console, table, failed = Console(highlight=False), Table(box=None, show_header=False, padding=(0, 2, 0, 0)), 0
    for check, figure, wrong in checks(run, timeout):
        failed += bool(wrong)
        table.add_row(Text("failed", "bold red") if wrong else Text("passed", "green"), check, Text(wrong or figure))
    console.print(run, style="bold")
    console.print(table)
    console.print(Text("1 failed", "bold red") if failed else Text("It keeps the protocol.", "bold green"))
    return BLACKBOX_FAILED if failed else CONVERGED
