"""``python -m orchestrator``, and the console script: interrupts are seen to before anything else is imported."""

import gc
import signal

from orchestrator.interrupts import interrupt


def main() -> None:
    """Entry point."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # scripts start so what they put in the background
        signal.signal(signal.SIGINT, interrupt)
    gc.set_threshold(50_000)  # modules, arrays: hardly any cycles among them; imports gain a twentieth
    from orchestrator.cli import main as command

    command()


if __name__ == "__main__":
    main()
