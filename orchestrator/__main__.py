"""``python -m orchestrator``, and the console script: interrupts are seen to before anything else
is imported.
"""

import signal
import sys

from orchestrator.errors import INTERRUPTED
from orchestrator.ending import interrupt


def main() -> None:
    """Entry point."""
    # scripts start so what they put in the background
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, interrupt)
    try:
        from orchestrator.cli import main as command

        command()
    # before a command has begun or after it has ended; during one it says so itself
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
