"""How a command ends: its exit code, errors shown rather than traced, signals that interrupt it in good order."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable

import typer

from orchestrator.errors import BLACKBOX_FAILED, INTERRUPTED, InputError, InternalError, OrchestratorError, lacks_memory
from orchestrator.interrupts import interrupt, raise_waiting
from orchestrator.wording import visible


def guarded(action: Callable[[], int]) -> None:
    """Runs a command and ends the program with its exit code; errors of the user's are shown, not traced.

    SIGTERM, SIGHUP and SIGUSR2 interrupt like Ctrl-C, so that batch systems and lost terminals get the checkpoint too; what is
    ignored, as SIGHUP is under nohup, stays so.
    """
    in_main = threading.current_thread() is threading.main_thread()
    # SIGUSR2 is what launchers of parallel runs forward to all ranks, and what batch systems can be told to send
    asked = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR2
    ends = [number for number in asked if signal.getsignal(number) != signal.SIG_IGN]
    previous = {number: signal.signal(number, interrupt) for number in ends} if in_main else {}
    try:
        raise_waiting()
        try:
            code = action()
        except OrchestratorError as error:
            _show(error)
            code = error.exit_code
        except Exception as error:
            if not lacks_memory(error):
                raise
            _show(InternalError(f"{type(error).__name__}: {error}".rstrip(": "), "none is kept", saved=False, memory=True))
            code = BLACKBOX_FAILED
        raise_waiting()  # a short command may end, or fail, before it has been looked again
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        code = INTERRUPTED
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    raise typer.Exit(code)


def _show(error: OrchestratorError) -> None:
    """An error on stderr: a count, then one paragraph per problem, unwrapped so that paths stay whole."""
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    if isinstance(error, InputError):
        count = len(error.problems)
        console.print(Text(f"{count} problem{'s' if count > 1 else ''} in the input", style="bold red"))
        for problem in error.problems:
            head, _, rest = visible(str(problem)).partition("\n")
            console.print(Text.assemble("\n", (head, "bold"), "\n", rest))
    else:
        console.print(Text.assemble(("Error: ", "bold red"), visible(str(error))))
