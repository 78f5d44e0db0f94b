"""A process that judges scenes: a line of JSON in, a line of JSON out; the study ends it where a scene takes too long."""

from __future__ import annotations

import json
import os
import sys
import traceback
import warnings
from dataclasses import asdict
from pathlib import Path


def use_tests_code() -> None:
    """Makes the tests' code without a process known, ``in-process``: a scene costs half as much as with FreeFEM."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
    import in_process  # noqa: F401


def main() -> None:
    os.setsid()
    answers, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    use_tests_code()
    from benchmarks.metamorphic.judge import Verdict, judge

    for line in sys.stdin:
        asked = json.loads(line)
        try:
            verdict = judge(asked["data"], asked["relations"], asked["number"])
        except Exception:  # noqa: BLE001 - a fault of the trials themselves; the next scene is not its
            verdict = Verdict("crash", traceback.format_exc()[-600:], 0.0)
        answers.write(json.dumps(asdict(verdict)) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
