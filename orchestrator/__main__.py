"""``python -m orchestrator``, and the console script: interrupts are seen to before anything else is imported."""

import signal

from orchestrator.interrupts import interrupt


def main() -> None:
    """Entry point."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # scripts start so what they put in the background
        signal.signal(signal.SIGINT, interrupt)
    from orchestrator.cli import main as command

    command()


if __name__ == "__main__":
    main()
