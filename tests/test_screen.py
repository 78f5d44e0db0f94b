"""What is printed: a few lines that say most, in plain text where nobody looks."""

import io
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import results_case as case
from rich.console import Console

from orchestrator.method.events import Finished
from orchestrator.results import progress as progresses
from orchestrator.results.progress import Progress
from orchestrator.results.summary.screen import BRIEF, brief, print_summary
from orchestrator.results.summary.words import summary_rows
from orchestrator.scene.mesh.geometry import format_point

ROOT = Path(__file__).parents[1]
MANY = {"load_steps": 3, "reaction_names": [f"bolt_{k}" for k in range(30)], "reaction_kinds": ["support", "load"] * 15,
        "reactions": [[[1.0, 2.0, 3.0]] * 3] * 30, "warnings": [f"warning {k}: " + "words " * 60 for k in range(20)],
        "advice": ["advice " * 40] * 3, "converged": False, "stop_reason": "max_iterations",
        "probes": [{"name": f"p{k}", "quantity": "point", "of": "displacement", "values": {"ux": [1.0], "uy": [-3e-17]}}
                   for k in range(40)]}


def printed(summary, width: int = 80, **how) -> list[str]:
    stream = io.StringIO()
    print_summary(summary, "results/there", Console(file=stream, width=width), **how)
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("width", [50, 80, 200])
def test_any_summary_is_told_in_a_few_lines(width):
    lines = printed(case.summary(workers=2, **MANY), width, verbose=False)
    assert len(lines) <= 25 and max(map(len, lines)) <= width
    text = "\n".join(lines)
    for label in ("result", "reactions", "loads", "warning", "what to do", "more", "--verbose"):
        assert label in text, label
    assert len(printed(case.summary(workers=2, **MANY), width, verbose=True)) > 100


def test_a_short_one_is_told_whole_and_details_on_request():
    few, all_of_it = printed(case.summary(workers=2), verbose=False), printed(case.summary(workers=2), verbose=True)
    assert any(line.startswith("codes") or line.startswith("workers") or "black box" in line for line in all_of_it)
    assert not any("black box" in line for line in few)
    assert {label for label, _ in summary_rows(case.summary(**MANY))} & set(BRIEF) >= {"result", "reactions", "loads", "probes", "warning"}
    assert brief([("result", "converged")], 60, 20, "there") == [("result", "converged")]  # nothing left out, nothing said


def test_supports_and_loads_are_told_apart_at_the_last_step():
    rows = dict(summary_rows({"load_steps": 3, "reaction_names": ["foot", "neck"], "reaction_kinds": ["support", "load"],
                              "reactions": [[[0, 0, 1], [0, 0, 2], [1e-13, 0, 3]], [[0, 0, -1], [0, 0, -2], [0, 0, -3]]]}))
    unloaded = dict(summary_rows({"load_steps": 2, "reaction_names": ["foot"], "reactions": [[[0, 0, 9.0], [1e-12, 0, -2e-12]]]}))
    assert unloaded["reactions"] == "foot: (0, 0, 0)  (load step 2 of 2)"
    assert rows["reactions"] == "foot: (0, 0, 3)  (load step 3 of 3)" and rows["loads"] == "neck: (0, 0, -3)  (load step 3 of 3)"


def test_numbers_are_rounded_to_what_is_known():
    assert format_point(np.array([82.0, -9.0964e-15, 8.0])) == "(82, 0, 8)" and format_point(np.zeros(3)) == "(0, 0, 0)"
    peak = {"value": 12.5, "at": [82.0, -9.0964e-15, 8.0], "part": "", "load_step": 1}
    assert "at (82, 0, 8)" in dict(summary_rows({"peak_stress": peak}))["peak stress"]
    assert "uy 0" in dict(summary_rows(MANY))["probes"]


def test_a_file_gets_lines_of_plain_text(monkeypatch):
    monkeypatch.setattr(progresses, "EVERY", 0.0)
    stream = io.StringIO()
    with closing(Progress(stream=stream)) as progress:
        progress.stage("factorising")
        for i in range(1, 4):
            progress.iteration(case.iteration(i))
        progress.finished(Finished(True, "converged", 3))
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3 and all("iteration" in line and "→ 1e-06" in line for line in lines) and "\x1b" not in stream.getvalue()
    with closing(Progress(quiet=True, stream=(silent := io.StringIO()))) as progress:
        progress.iteration(case.iteration(1))
    assert silent.getvalue() == ""


def test_who_reads_enough_hears_no_complaint():
    done = subprocess.run(f'"{sys.executable}" -m orchestrator schema | head -c 20', shell=True, capture_output=True, text=True, cwd=ROOT)
    assert len(done.stdout) == 20 and done.stderr == ""
