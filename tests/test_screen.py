"""What is printed: a few lines that say most, in plain text where nobody looks."""

import io
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
import results_case as case
from rich.console import Console

from orchestrator.method.events import Finished
from orchestrator.results import progress as progresses
from orchestrator.results.progress import Progress
from orchestrator.results.summary.lines import print_summary, summary_rows

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
def test_verdict_and_advice_are_told_whole_at_any_width(width):
    """Lines are wrapped, not cut; of lists the first entries, but verdict and advice to their ends."""
    slides = "a | b slips from load step 5, at about 10,150 N on pull, between 9,000 and 12,000 N, with 98% of what friction can hold"
    face = {"name": "a | b", "kind": "plane", "capacity": [1.0] * 5, "normal": [1.0] * 5, "used": [0.98] * 5,
            "slips": {"step": 5, "on": "pull", "of": "force", "before": 9000, "load": 12000, "at": 10150}}
    advice = [f"advice {k} " + "of many words " * 20 + f"end {k}" for k in range(9)]
    units = {"output": {"units": {"length": "mm", "force": "N"}}}
    lines = printed(case.summary(**MANY | {"converged": True, "contact_faces": [face], "advice": advice, "config": units}), width, verbose=False)
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    assert slides in text and all(f"end {k}" in text for k in range(9)) and "warning 5" in text and "warning 6" not in text
    assert "… and 14 more in summary.json" in text and "warning 19" in " ".join(printed(case.summary(**MANY), width, verbose=True))


def test_verdict_first_then_answers_then_errors_then_cost():
    labels = [label for label, _ in summary_rows(case.summary(workers=2, **MANY), brief=True)]
    assert labels == ["run", "result", "what to do", "reactions", "loads", "probes", "error bound", "true error", "warning",
                      "size", "time"]
    every = [label for label, _ in summary_rows(case.summary(workers=2, **MANY))]
    assert [label for label in every if label in labels] == labels and "stages" in every


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


@pytest.mark.long
def test_who_reads_enough_hears_no_complaint():
    done = subprocess.run(f'"{sys.executable}" -m orchestrator schema | head -c 20', shell=True, capture_output=True, text=True, cwd=ROOT)
    assert len(done.stdout) == 20 and done.stderr == ""
