"""Summary, report and the solution object; progress and what the console shows."""

import base64
import json
import math
import io
import os
import re
import shutil
import subprocess
import sys
from contextlib import closing
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
import results_case as case
from rich.console import Console

from orchestrator.blackbox.codes.freefem.code import FreeFem
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.errors import BAD_INPUT, InputError
from orchestrator.method.events import Finished
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.progress import Progress, fraction_done
from orchestrator.results.report import document
from orchestrator.results.report.report import report
from orchestrator.results.solution import Solution
from orchestrator.results.summary.screen import print_summary
from orchestrator.processes import memory_peak_mb
from orchestrator.results.summary.summary import KEYS, read_summary, versions, write_summary


def test_summary_round_trip(tmp_path):
    write_summary(ResultsFolder(tmp_path), case.summary(error_bound=np.nan, indicator=np.inf, extra=(1, 2)))
    read = read_summary(tmp_path)
    assert list(read)[:len(KEYS)] == KEYS
    assert read["error_bound"] is None and read["indicator"] is None and read["extra"] == [1, 2]
    assert read["dofs"] == 189 and read["energy"] == [0.25, 1.0]


def test_absent_keys_are_null(tmp_path):
    path = write_summary(ResultsFolder(tmp_path), {"name": "a"})
    assert set(json.loads(path.read_text())) == set(KEYS)


def test_versions_and_memory():
    assert versions({"freefem": "4.11"})["numpy"] == np.__version__
    assert versions({"freefem": "4.11"})["freefem"] == "4.11"
    assert 10 < memory_peak_mb() < 1e5
    assert math.isnan(memory_peak_mb(2**30))


def test_memory_is_counted_in_one_unit():
    """Of a process of a code as of this one: MB, not MiB."""
    itself = SimpleNamespace(process=SimpleNamespace(pid=os.getpid()), peak_mb=0.0)
    assert Worker.note_memory(itself) == pytest.approx(memory_peak_mb(), rel=1e-3)


@pytest.mark.skipif(not shutil.which("dpkg-query"), reason="needs Debian's packages")
def test_freefem_is_told_with_its_package(tmp_path, monkeypatch):
    """Debian's FreeFEM 4.11 calls itself 4.9."""
    told = FreeFem().version()
    installed = subprocess.run(["dpkg-query", "-W", "-f=${Version}", "freefem++"], capture_output=True, text=True).stdout
    assert told.endswith(f"(package freefem++ {installed})") and told[0].isdigit()
    wrapper = tmp_path / "FreeFem++"
    wrapper.write_text(f"#!/bin/sh\nexec {shutil.which('FreeFem++')} \"$@\"\n")
    wrapper.chmod(0o755)
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", str(wrapper))
    assert FreeFem().version() == told.split(" (")[0], "this one is nobody's package"


def test_printed_summary(tmp_path):
    write_figures(ResultsFolder(tmp_path), case.summary(), case.history())
    stream = io.StringIO()
    print_summary(case.summary(workers=2), tmp_path, Console(file=stream, width=200))
    text = stream.getvalue()
    for part in ("made_up", "converged", "7, 12 sweeps", "2.00e-07", "9.00e-08", "189 dofs", "3 subdomains",
                 "linear stage 0.90", "black box 1.30 s", "32 % of 2", "convergence.png"):
        assert part in text, part
    stream = io.StringIO()
    print_summary({"name": "early", "converged": False, "stop_reason": "interrupted"}, None, Console(file=stream))
    assert "NOT converged (interrupted)" in stream.getvalue()


def test_result_round_trip(tmp_path):
    first = Solution(case.summary(), case.history(), case.fields())
    first.write(tmp_path)
    second = Solution.read(tmp_path)
    assert second.converged and second.iterations == 7 and "converged after 7" in repr(second)
    np.testing.assert_array_equal(second.displacement, first.displacement)
    for name, column in first.history.items():
        np.testing.assert_array_equal(second.history[name], column)
    third = Solution.read(second.write(tmp_path / "again"))
    assert third.summary == second.summary


def test_report(tmp_path):
    Solution(case.summary(), case.history(), case.fields()).write(tmp_path)
    path = report(tmp_path)
    text = path.read_text()
    for part in ("# made_up", "189 dofs", "tolerance was 1e-06 on the error bound", "‖u_D − u₂‖_K", "2.00e-07",
                 "| linear stage | 0.90 | 45 % |", "| boundary[1] | 2 | 2 | 0 | 0 |", "## The answer"):
        assert part in text, part
    for link in re.findall(r"\]\((.*?)\)", text):
        assert (tmp_path / link).is_file()
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3 and "src=\"figures" not in page


class Reader(HTMLParser):
    """Takes a page apart: texts by tag, rows of the tables, alignments of cells, sources of pictures."""

    def __init__(self, page):
        super().__init__()
        self.texts, self.rows, self.aligned, self.sources, self._open = [], [], [], [], []
        self.feed(page)
        assert not self._open, "every tag is closed"

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.sources.append(dict(attributes)["src"])
        if tag in ("meta", "img", "br"):
            return
        self._open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.aligned.append(dict(attributes).get("style"))

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self._open[-1] if self._open else "", data))
        if self._open and self._open[-1] in ("td", "th"):
            self.rows[-1][-1] += data


@pytest.mark.long
def test_the_page_says_what_the_text_says(tmp_path):
    """Names full of Markdown's marks come through as they are; the pictures in the page are the files."""
    name = "a_b_ *c* `d` <i>e</i> &amp; f|g [h](i) \\_"
    steps = [[1.0, 2.0, 3.0], [-1e-7, 0.0, 12345678.0]]
    Solution(case.summary(name=name, reactions=[steps], warnings=[f"{name} is odd"],
                          acceleration="by hand"), case.history()).write(tmp_path)
    report(tmp_path)
    page = Reader((tmp_path / "report.html").read_text())
    assert ("h1", name) in page.texts and ("title", name) in page.texts and ("p", f"{name} is odd.") in page.texts
    assert ["run", name] in page.rows
    assert any(tag == "p" and text.endswith("Acceleration: by hand.") for tag, text in page.texts)
    assert ["boundary[0]", "2", "0", "0", "1.2346e+07"] in page.rows
    assert "text-align:right" in page.aligned
    pictures = [base64.b64decode(source.removeprefix("data:image/png;base64,")) for source in page.sources]
    assert pictures == [(tmp_path / "figures" / f"{name}.png").read_bytes() for name in ("convergence", "time")]
    assert ["blackbox.code", "freefem"] in page.rows and not any(tag == "pre" for tag, _ in page.texts)


@pytest.mark.long
def test_question_then_answer_then_the_rest(tmp_path):
    """Supports, loads and matter as tables; three numbers; errors that stand out; numbers that are not wrapped, on paper too."""
    config = {"name": "made_up", "mesh": {"box": {"size": [3, 1, 1], "cells": [6, 2, 2]}}, "materials": [{"young": 2e5, "poisson": 0.3}],
              "boundary": [{"on": "xmin", "displacement": [0, 0, None]},
                           {"on": {"plane": "x", "at": 3.0}, "pressure": 2.0, "history": "h"}],
              "histories": {"h": [0.5, 1.0]}, "interfaces": [{"between": ["a*", "b"], "law": "contact", "friction": 0.1}],
              "method": {"tolerance": {"error": 1e-6}, "relaxation": 0.7}, "output": {"units": {"length": "mm", "force": "N"}}}
    peak = {"value": 12.5, "at": [1.0, 2.0, 3.0], "part": "box", "load_step": 2}
    probe = {"name": "tip", "quantity": "point", "of": "displacement", "at": [1.0, 0.0, 0.0],
             "values": {"ux": [0.1, 0.2], "uy": [0, 0], "uz": [0, 1]}}
    lost = {"name": "seat", "quantity": "max", "of": "stress", "at": [0.0, 0.0, 0.0], "values": {"sxx": None}, "why": "not known"}
    Solution(case.summary(config=config, peak_stress=peak, peak_displacement=peak | {"value": 0.25}, reaction_names=["xmin", "x = 3"],
                          reaction_moments={"about": [0, 0, 0], "moments": np.ones((2, 2, 3))}, discretisation_error=0.31,
                          probes=[probe, lost]), case.history()).write(tmp_path)
    report(tmp_path)
    content = (tmp_path / "report.html").read_text()
    page = Reader(content)
    heads = [text for tag, text in page.texts if tag == "h2"]
    assert heads[:2] == ["The question", "The answer"] and heads.index("Reactions") < heads.index("How it was solved")
    for row in (["xmin", "displacement", "[0, 0, free]", ""], ["x = 3", "pressure", "2", "h"], ["1", "*", "200000", "0.3", ""],
                ["a* – b", "contact", "friction: 0.1"], ["h", "[0.5, 1]"], ["method.relaxation", "0.7"], ["2", "0.2", "0", "1"],
                ["peak stress", "12.5 MPa  (von Mises, at (1, 2, 3) of box, load step 2)"], ["x = 3", "2", "2", "0", "0", "1", "1", "1"]):
        assert row in page.rows, row
    assert any(row[0] == "peak displ." and row[1].startswith("0.25 mm") for row in page.rows)
    assert any(tag == "strong" and "31%" in text for tag, text in page.texts) and ("strong", "not known.") in page.texts
    assert "@media print" in content and 'td[style*="right"], th { white-space: nowrap }' in content
    assert "figures/probes.png" in (tmp_path / "report.md").read_text()


def test_lines_of_a_cell_are_rows_of_the_table():
    assert document.table(("", "x"), [("a", "1\n2"), ("b", "3")], numeric=True).splitlines()[1:] == [
        "| --- | ---: |", "| a | 1 |", "|  | 2 |", "| b | 3 |"]


def test_report_of_a_run_that_failed_early(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[report.__module__], "drawn", lambda draw, *job: draw(*job))  # charts alone: no process for them
    early = {"name": "early", "converged": False, "stop_reason": "interrupted", "iterations": 0, "timing": None}
    Solution(early, {}).write(tmp_path)
    assert "WITHOUT" in report(tmp_path).read_text()


@pytest.mark.parametrize("content", [None, "", "[]", '{"name": "some other tool"}'])
def test_report_of_a_foreign_folder(tmp_path, content):
    directory = tmp_path / "there"
    if content is not None:
        directory.mkdir()
        if content:
            (directory / "summary.json").write_text(content)
    with pytest.raises(InputError) as caught:
        report(directory)
    assert caught.value.exit_code == BAD_INPUT and str(directory) in str(caught.value)
    assert not directory.exists() or os.listdir(directory) in ([], ["summary.json"])


@pytest.mark.parametrize("table, left", [("interfaces.csv", b"interface,side_1,side_2,law,load_step,fx\na | b,a,b,contact"),
                                         ("extremes.csv", bytes(range(256))), ("extremes.csv", b"part,value\na,1\n")])
def test_report_of_tables_that_are_not_whole(table, left, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[report.__module__], "drawn", lambda draw, *job: draw(*job))
    Solution({"name": "cut short", "converged": True, "stop_reason": "converged", "iterations": 1, "timing": None}, {}).write(tmp_path)
    (tmp_path / table).write_bytes(left)
    with pytest.raises(InputError, match=f"{table} cannot be read"):
        report(tmp_path)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def run(progress):
    with closing(progress):
        progress.stage("factorising")
        for i in range(1, 6):
            progress.iteration(case.iteration(i))
        progress.finished(Finished(True, "converged", 5))


def test_progress_on_a_terminal():
    stream = Terminal()
    run(Progress(stream=stream))
    text = stream.getvalue()
    for part in ("factorising", "iteration 4", "error bound 2.0e-04", "1e-06", "9 sweeps", "left", "converged after 5"):
        assert part in text, part


def test_quiet_when_asked_or_not_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    stream = Terminal()
    run(Progress(quiet=True, stream=stream))
    run(Progress())  # pytest has captured standard output
    assert stream.getvalue() == "" and capsys.readouterr() == ("", "")


def test_no_control_characters_under_mpiexec(monkeypatch):
    """Open MPI gives ranks a terminal, even where it writes to a file itself."""
    for name, value in {"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0", "TERM": "xterm", "COLORTERM": "truecolor"}.items():
        monkeypatch.setenv(name, value)
    stream = Terminal()
    monkeypatch.setattr("sys.stdout", stream)
    run(Progress(stream=stream))
    print_summary(case.summary(workers=2))
    assert "converged" in stream.getvalue() and "\x1b" not in stream.getvalue()


def test_progress_is_counted_in_orders_of_magnitude():
    assert fraction_done([1.0, 1e-1, 1e-2, 1e-3], 1e-6) == pytest.approx(0.5) and fraction_done([math.nan], 1e-6) == 0
