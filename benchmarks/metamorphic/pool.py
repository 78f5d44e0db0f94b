"""Processes that judge scenes, each ended and begun anew where a scene takes longer than it may."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.metamorphic.chunks import Trial

HANG = {"outcome": "hang", "said": "", "seconds": 0.0, "tried": {}, "details": {}, "variants": {}, "warnings": ""}


class Judge:
    """One process, and the trial that it is at."""

    def __init__(self) -> None:
        self.process: subprocess.Popen | None = None
        self.trial: Trial | None = None
        self.until = 0.0

    def begin(self, trial: Trial, limit: float) -> None:
        if self.process is None or self.process.poll() is not None:
            self.process = subprocess.Popen([sys.executable, "-m", "benchmarks.metamorphic.worker"], stdin=subprocess.PIPE,
                                            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=Path(__file__).parents[2])
        self.trial, self.until = trial, time.monotonic() + limit
        self.process.stdin.write(json.dumps({"data": trial.data, "relations": trial.relations, "number": trial.drawn}) + "\n")
        self.process.stdin.flush()

    def end(self) -> None:
        """Ends the process and the codes that it has started."""
        if self.process is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.kill()
            self.process.wait()
        self.process = None


def judged(trials: Iterator[Trial], workers: int, limit: float) -> Iterator[tuple[Trial, dict[str, Any]]]:
    """Every trial with its verdict, as they come; ``limit`` seconds for each."""
    judges = [Judge() for _ in range(workers)]
    try:
        for judge in judges:
            if (trial := next(trials, None)) is not None:
                judge.begin(trial, limit)
        while busy := [j for j in judges if j.trial is not None]:
            wait = max(min(j.until for j in busy) - time.monotonic(), 0.0)
            ready = select.select([j.process.stdout for j in busy], [], [], wait)[0]
            for judge in busy:
                found = None
                if judge.process.stdout in ready:
                    line = judge.process.stdout.readline()
                    found = json.loads(line) if line else {**HANG, "outcome": "crash", "said": f"exit code {judge.process.wait()}"}
                elif time.monotonic() > judge.until:
                    judge.end()
                    found = {**HANG, "said": f"{limit:g} s"}
                if found is not None:
                    done, judge.trial = judge.trial, None
                    if (trial := next(trials, None)) is not None:
                        judge.begin(trial, limit)
                    yield done, found
    finally:
        for judge in judges:
            judge.end()
