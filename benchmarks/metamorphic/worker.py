"""A process that judges scenes: a line of JSON in, a line of JSON out; the study ends it where a scene takes too long."""

from __future__ import annotations

import json
import os
import sys
import warnings
from dataclasses import asdict
from pathlib import Path


def main() -> None:
    sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))  # the tests' code without a process
    os.setsid()
    answers, sys.stdout = sys.stdout, sys.stderr
    warnings.simplefilter("ignore")
    import in_process  # noqa: F401

    from benchmarks.metamorphic.judge import judge

    for line in sys.stdin:
        asked = json.loads(line)
        answers.write(json.dumps(asdict(judge(asked["data"], asked["relations"], asked["number"]))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
