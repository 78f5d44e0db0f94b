"""Tutorials, followed to the letter: files are written, commands run, what they show comes out.

Every line that they show is found in that order, numbers within two per cent; "…" stands for lines
and words left out.
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
from helpers import ALLOWED, MPIEXEC, ROOT, call

# a fence below a line that ends with "`name`:" is a file; a console fence has commands behind $
FENCE = re.compile(r"(?:^`([\w./]+)`[^\n]*:\n+)?^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
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
    """From a partitioned mesh to ParaView's files: Debian's Python, MPI and PETSc, as `make
    cluster` installs them there."""
    if not CLUSTER.exists():
        pytest.skip("make cluster has not been run")
    follow(ROOT / "docs/tutorials/5_cluster.md", tmp_path, monkeypatch, str(CLUSTER),
           "/usr/bin/mpiexec")


def follow(path, tmp_path, monkeypatch, python, mpiexec):
    """Run a tutorial's commands with such a Python and MPI."""
    place, programs = tmp_path / "work", tmp_path / "bin"
    place.mkdir(), programs.mkdir()
    for name, call in (("orchestrator", f"{python} -m orchestrator"), ("python", python),
                       ("mpiexec", mpiexec)):
        (programs / name).write_text(f'#!/bin/sh\nexec {call} "$@"\n')
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    for name, value in {**ALLOWED, "COLUMNS": "80", "TERM": "dumb"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(place)
    done = 0
    for command, shown in followed(path):
        compare(command, shown, output_of(command))
        done += 1
    assert done >= 2


def test_every_cell_of_the_notebook(tmp_path, monkeypatch):
    """Run one after the other, in one session; each prints what is shown below it."""
    monkeypatch.chdir(tmp_path)
    session, told = {}, 0
    for number, cell in enumerate(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"], 1):
        if cell["cell_type"] == "code":
            with redirect_stdout(io.StringIO()) as printed:
                exec(compile("".join(cell["source"]), f"cell {number}", "exec"), session)
            shown = "".join("".join(output["text"]) for output in cell["outputs"]).splitlines()
            compare(f"cell {number}", shown, printed.getvalue())
            told += bool(shown)
    assert told >= 5 and (tmp_path / "push.png").is_file()
    assert call("compare", "results/python", "results/python").code == 0


def followed(path):
    """Yield every command of a tutorial and the lines that it shows; write the files above it
    here."""
    for name, language, text in FENCE.findall(path.read_text(encoding="utf-8")):
        if name:
            Path(name).write_text(text, encoding="utf-8")
            Path(name).chmod(0o755 if text.startswith("#!") else 0o644)
        elif language == "console":
            for block in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                command, *shown = block.splitlines()
                yield command, shown


def output_of(command: str) -> str:
    """What a command that succeeds prints; no figures but those that are asked for."""
    program, *words = shlex.split(command.removesuffix(MAY_FAIL))
    if program == "orchestrator":
        quick = ["--set", "output.figures=false"] if words[0] == "run" else []
        done = call(*words, *quick)
        assert done.code == command.endswith(MAY_FAIL), f"{command}\n{done.out}{done.err}"
        return done.out + done.err
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def compare(command: str, shown: list[str], printed: str) -> None:
    lines = iter(printed.splitlines())
    for wanted in filter(lambda line: line.strip(" …"), shown):
        found = any(alike(wanted, line) for line in lines)
        assert found, f"{command}\nprints no {wanted!r}\n{printed}"


def alike(wanted: str, line: str) -> bool:
    """The same words, numbers within two per cent; what is wanted may end with "…"."""
    start = wanted.rstrip().endswith("…")
    wanted = " ".join(wanted.rstrip(" …").split())
    line = " ".join(line.split())
    number = r"(-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?)"
    pattern = number.join(map(re.escape, NUMBER.split(wanted))) + ("" if start else "$")
    found = re.match(pattern, line)
    pairs = zip(NUMBER.findall(wanted), found.groups(), strict=True) if found else ()
    return bool(found) and all(close(a, b) for a, b in pairs)


def close(wanted: str, found: str) -> bool:
    one, other = (float(number.replace(",", "")) for number in (wanted, found))
    return one == pytest.approx(other, rel=0.02, abs=1e-9)
