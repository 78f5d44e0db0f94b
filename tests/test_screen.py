"""What is printed: a few lines that say most, in plain text where nobody looks."""

import io
import re
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import results_case as case
from rich.console import Console

from orchestrator.blackbox.shared import LOADING
from orchestrator.method.events import Finished
from orchestrator.results import progress as progresses
from orchestrator.results.progress import EACH, Progress, Remaining, START
from orchestrator.timing import Doing, SLOW
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


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


class Often(Progress):
    every, often = 0.05, 0.02


def test_a_file_gets_lines_of_plain_text_from_time_to_time():
    stream = io.StringIO()
    with closing(Often(stream=stream, label="variant 1 of 2")) as progress:
        progress.stage("meshing")
        time.sleep(0.2)
        for i in range(1, 4):
            progress.iteration(case.iteration(i))
        time.sleep(0.2)
        progress.finished(Finished(True, "converged", 3))
    lines = stream.getvalue().splitlines()
    assert lines[0] == "0 s: variant 1 of 2 · meshing" and "\x1b" not in stream.getvalue()
    assert any("variant 1 of 2 · iteration 3 · " in line and line.endswith("→ 1e-06") for line in lines)
    with closing(Progress(quiet=True, stream=(silent := io.StringIO()))) as progress:
        progress.iteration(case.iteration(1))
    assert silent.getvalue() == ""


def test_a_terminal_counts_seconds_while_nothing_is_foreseen(monkeypatch):
    """As long as gmsh meshes, or loops are compiled; on a busy machine all takes longer."""
    with closing(Often(stream=(stream := Screen()))) as progress:
        progress.stage("meshing")
        time.sleep(1.7)
        monkeypatch.setattr(progresses.Compiled, "compiling", True)
        time.sleep(0.1)
    said = stream.getvalue()
    assert "meshing · 1 s" in said and "meshing · 2 s" in said and "meshing, compiling its loops · 2 s" in said
    assert Remaining(1000, 1, True).after == pytest.approx(SLOW * (START + EACH * 1000))


@pytest.mark.parametrize("width", [12, 40, 60, 120])
def test_a_terminal_of_any_width_has_one_line_that_fits(monkeypatch, width):
    """What matters least is left out first: the error, the time left, the share."""
    monkeypatch.setenv("COLUMNS", str(width))
    with closing(Progress(stream=(stream := Screen()))) as progress:
        progress.made(SimpleNamespace(mesh=SimpleNamespace(nodes=range(2000)), steps=1, bonded=True))
        progress.stage("assembling and factorising")
        progress.iteration(case.iteration(3))
    states = [state for state in re.split(r"\r\x1b\[2K", stream.getvalue()) if state]
    assert max(map(len, states)) < width and "\n" not in stream.getvalue()
    assert states[-1].startswith("iteration 3"[: width - 1])
    assert ("left" in states[-1]) == (width > 30) and ("→" in states[-1]) == (width > 50)


def doing(what: str, done: list[float], of: float, pieces: int, seconds: float) -> Doing:
    """Return what a black box does, ``seconds`` after it has begun."""
    now = time.monotonic()
    return Doing(what, of, pieces, 2, done, now - seconds, now)


def test_what_is_left_is_told_by_what_is_done():
    """Bodies tell how long the others take; then right-hand sides; then iterations, by their error's fall."""
    remaining, now = Remaining(30_000, 1, True), time.monotonic()
    early, late = (remaining.left(doing("assembling", [1.0] * k, 100.0, 100, 0.6 * k), now) for k in (10, 90))
    assert early - late == pytest.approx(48, rel=0.01) and LOADING * remaining.solve == pytest.approx(60, rel=0.01)
    half = remaining.left(doing("back-substitutions", [50.0] * 50, 5000.0, 100, 20.0), now)
    assert half - 20 == pytest.approx(remaining.left(doing("back-substitutions", [50.0] * 100, 5000.0, 100, 40.0), now), rel=0.01)
    unseen = Remaining(30_000, 1, True).left(doing("back-substitutions", [50.0] * 100, 5000.0, 100, 40.0), now)
    assert 0 < unseen < 1000  # assembling was over before anybody looked
    for k in range(1, 11):  # two seconds each, a factor of two each, to a thousandth
        remaining.iterated(replace(case.iteration(k), values={"iteration": k, "error_bound": 2.0 ** -k},
                                   target=("error_bound", 2.0 ** -20)), now + 2 * k)
    assert remaining.each == pytest.approx(2) and remaining.to_do == pytest.approx(10, rel=0.1)
    remaining.ended = now
    assert remaining.left(None, now) == pytest.approx(remaining.after)


DRAWS = """
import time
from orchestrator.ending import guarded
from orchestrator.results.figures.artist import Artist

def draws():
    with Artist() as artist:
        artist.begin(time.sleep, 60)
        print("drawing", flush=True)
        artist.finish()

guarded(draws)
"""


def test_an_interrupt_while_figures_are_drawn_says_what_there_is():
    """In a process of its own: interrupts are not for who runs the tests."""
    program = subprocess.Popen([sys.executable, "-c", DRAWS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
                               preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    assert program.stdout.readline() == "drawing\n"
    time.sleep(1.0)  # until it waits for the figures
    program.send_signal(signal.SIGINT)
    _, said = program.communicate(timeout=60)
    assert program.returncode == 130 and "complete but for figures: orchestrator report draws them" in said, said


@pytest.mark.long
def test_who_reads_enough_hears_no_complaint():
    done = subprocess.run(f'"{sys.executable}" -m orchestrator schema | head -c 20', shell=True, capture_output=True, text=True, cwd=ROOT)
    assert len(done.stdout) == 20 and done.stderr == ""
