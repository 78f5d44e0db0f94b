"""Summary, report and the solution object; progress and what the console shows."""

import base64
import json
import math
import io
import os
import re
import sys
from contextlib import closing
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
import results_case as case

from orchestrator.blackbox.transport.worker import Worker
from orchestrator.errors import BAD_INPUT, InputError
from orchestrator.method.events import Finished
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.progress import Progress, fraction_done
from orchestrator.results.report.report import report
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import print_summary, summary_rows
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
    """The lines of the summary, tables of each load step, pictures, the configuration; errors of a mesh and probes that are not known."""
    peak = {"value": 12.5, "at": [1.0, 2.0, 3.0], "part": "box", "load_step": 2}
    lost = {"name": "seat", "quantity": "max", "of": "stress", "at": [0.0, 0.0, 0.0], "values": {"sxx": None}, "why": "not known"}
    tip = {"name": "tip", "quantity": "point", "of": "displacement", "at": [1.0, 0.0, 0.0],
           "values": {"ux": [0.1, 0.2], "uy": [0.0, 1e-17], "uz": [0.0, 0.0]}}
    summary = case.summary(peak_stress=peak, probes=[lost, tip], reaction_names=["xmin", "pull"], reaction_kinds=["support", "load"])
    Solution(summary, case.history(), case.fields()).write(tmp_path)
    text = report(tmp_path).read_text()
    for label, told in summary_rows(read_summary(tmp_path)):
        assert f"| {label} | {told.splitlines()[0]} |" in text
    for part in ("# made_up", "12.5  (von Mises, at (1, 2, 3) of box, load step 2 of 2)", "‖u_D − u₂‖_K", "| linear stage | 0.90 | 45% |",
                 "| pull | load | 2 | (2, 0, 0) | – |", "| 2 | 0.2 | 0 | 0 |", "seat", "not known", "    name: made_up"):
        assert part in text, part
    for link in re.findall(r"\]\((.*?)\)", text):
        assert (tmp_path / link).is_file()
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 3 and "src=\"figures" not in page


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
    """Names full of Markdown's marks come through as they are, in the configuration too; the pictures in the page are the files."""
    name = "a_b_ *c* `d` <i>e</i> &amp; f|g [h](i) \\_ ```"
    Solution(case.summary(name=name, warnings=[f"{name} is odd"], config={"name": name}), case.history()).write(tmp_path)
    report(tmp_path)
    page = Reader((tmp_path / "report.html").read_text())
    assert ("h1", name) in page.texts and ("title", name) in page.texts
    assert ["run", name] in page.rows and ["warning", f"{name} is odd"] in page.rows
    assert any(tag == "code" and "```" in text for tag, text in page.texts)
    pictures = [base64.b64decode(source.removeprefix("data:image/png;base64,")) for source in page.sources]
    assert pictures == [(tmp_path / "figures" / f"{name}.png").read_bytes() for name in ("convergence", "time")]


def test_report_of_a_run_that_failed_early(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[report.__module__], "drawn", lambda draw, *job: draw(*job))  # charts alone: no process for them
    early = {"name": "early", "converged": False, "stop_reason": "interrupted", "iterations": 0, "timing": None}
    Solution(early, {}).write(tmp_path)
    assert "NOT converged" in report(tmp_path).read_text()


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


@pytest.mark.parametrize("table, left", [("extremes.csv", bytes(range(256))), ("extremes.csv", b"part,value\na,1\n")])
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
