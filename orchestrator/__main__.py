"""``python -m orchestrator``, and the console script: interrupts are seen to before anything else is imported."""

import signal
import sys

from orchestrator.errors import INTERRUPTED
from orchestrator.ending import interrupt


def main() -> None:
    """Entry point."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # scripts start so what they put in the background
        signal.signal(signal.SIGINT, interrupt)
    try:
        from orchestrator.cli import main as command

        command()
    except KeyboardInterrupt:  # before a command has begun or after it has ended; during one it says so itself
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
