"""Tutorials are followed to the letter: their files are written, their commands run, and what they show comes out.

Every line that they show is found in that order, numbers within two per cent; "…" stands for lines and words left out.
"""

import io
import json
import os
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from test_mpi import ALLOWED, MPIEXEC
from yaml_case import call

from benchmarks.kit.tutorials import followed
from orchestrator.results.compare import compare as compared

ROOT = Path(__file__).parents[1]
TUTORIALS = [*sorted((ROOT / "docs" / "tutorials").glob("*.md")), ROOT / "docs" / "porting.md"]
CLUSTER = ROOT / ".venv-cluster/bin/python"
NOTEBOOK = ROOT / "docs" / "tutorials" / "6_python.ipynb"
MAY_FAIL = " || true"
NUMBER = re.compile(r"(?<![\w.])-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")


@pytest.mark.parametrize("path", TUTORIALS, ids=[path.stem for path in TUTORIALS])
@pytest.mark.long
def test_every_step_of_a_tutorial(path, tmp_path, monkeypatch):
    follow(path, tmp_path, monkeypatch, sys.executable, MPIEXEC)


@pytest.mark.long
def test_ranks_in_what_the_container_has(tmp_path, monkeypatch):
    """From a partitioned mesh to ParaView's files: Debian's Python, MPI and PETSc, as `make cluster` installs them there."""
    if not CLUSTER.exists():
        pytest.skip("make cluster has not been run")
    follow(ROOT / "docs/tutorials/5_cluster.md", tmp_path, monkeypatch, str(CLUSTER), "/usr/bin/mpiexec")


def follow(path, tmp_path, monkeypatch, python, mpiexec):
    """Run a tutorial's commands with such a Python and MPI."""
    place, programs = tmp_path / "work", tmp_path / "bin"
    place.mkdir(), programs.mkdir()
    for name, call in (("orchestrator", f"{python} -m orchestrator"), ("python", python), ("mpiexec", mpiexec)):
        (programs / name).write_text(f'#!/bin/sh\nexec {call} "$@"\n')
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", str(ROOT), prepend=os.pathsep)
    for name, value in {**ALLOWED, "COLUMNS": "80", "TERM": "dumb"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(place)
    done = 0
    for command, shown in followed(path):
        compare(command, shown, output_of(command))
        done += 1
    assert done >= 2


@pytest.mark.long
def test_every_cell_of_the_notebook(tmp_path, monkeypatch):
    """Run one after the other, in one session; each prints what is shown below it."""
    monkeypatch.chdir(tmp_path)
    session, told = {}, 0
    for number, cell in enumerate(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"], 1):
        if cell["cell_type"] == "code":
            with redirect_stdout(io.StringIO()) as printed:
                exec(compile("".join(cell["source"]), f"cell {number}", "exec"), session)
            shown = [line for output in cell["outputs"] for line in "".join(output["text"]).splitlines()]
            compare(f"cell {number}", shown, printed.getvalue())
            told += bool(shown)
    assert told >= 5 and (tmp_path / "push.png").is_file()
    assert not compared("results/python", "results/python").different


def output_of(command: str) -> str:
    """What a command that succeeds prints; no figures but those that are asked for."""
    program, *words = shlex.split(command.removesuffix(MAY_FAIL))
    if program == "orchestrator":
        quick = ["--set", "output.figures=false"] if words[0] == "run" else []
        done = call(*words, *quick)
        assert done.exit_code in ((1,) if command.endswith(MAY_FAIL) else (0,)), f"{command}\n{done.output}"
        return done.output
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def compare(command: str, shown: list[str], printed: str) -> None:
    lines = iter(printed.splitlines())
    for wanted in filter(lambda line: line.strip(" …"), shown):
        assert any(alike(wanted, line) for line in lines), f"{command}\nprints no {wanted!r}\n{printed}"


def alike(wanted: str, line: str) -> bool:
    """The same words, numbers within two per cent; what is wanted may end with "…"."""
    start = wanted.rstrip().endswith("…")
    wanted = " ".join(wanted.rstrip(" …").split())
    line = " ".join(line.split())
    pattern = r"(-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?)".join(map(re.escape, NUMBER.split(wanted))) + ("" if start else "$")
    found = re.match(pattern, line)
    return bool(found) and all(close(a, b) for a, b in zip(NUMBER.findall(wanted), found.groups(), strict=True))


def close(wanted: str, found: str) -> bool:
    one, other = (float(number.replace(",", "")) for number in (wanted, found))
    return one == pytest.approx(other, rel=0.02, abs=1e-9)
