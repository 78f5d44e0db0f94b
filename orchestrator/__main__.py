"""``python -m orchestrator``, and the console script: interrupts are seen to before anything else is imported."""

import gc
import signal
import sys

from orchestrator.errors import INTERRUPTED
from orchestrator.imports import put_off
from orchestrator.interrupts import interrupt


def main() -> None:
    """Entry point."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # scripts start so what they put in the background
        signal.signal(signal.SIGINT, interrupt)
    gc.set_threshold(50_000)  # modules, arrays: hardly any cycles among them; imports gain a twentieth
    put_off()
    try:
        from orchestrator.cli import main as command

        command()
    except KeyboardInterrupt:  # before a command has begun or after it has ended; during one it says so itself
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
