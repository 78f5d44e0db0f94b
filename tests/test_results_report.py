"""Summary, report and the solution object; progress and what the console shows."""

import os
import re

import pytest
import results_case as case

from orchestrator.errors import BAD_INPUT, InputError
from orchestrator.results.figures import figures
from orchestrator.results.report.report import cited, report
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import summary_rows
from orchestrator.results.summary.summary import read_summary


@pytest.mark.long
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


def test_a_report_ends_with_what_to_cite_for_what_the_run_used():
    def names(**more):
        heading, sources = cited(more)
        return heading, [line.split(":")[0].removeprefix("- ") for line in sources.splitlines()]

    method, contact, anderson, bound, freefem, mesher = (
        "P. Oumaziz, P. Gosselet, P.-A. Boucard, M. Abbas", "P. Oumaziz, P. Gosselet, P.-A. Boucard, S. Guinard", "D. G. Anderson",
        "W. Prager, J. L. Synge", "F. Hecht", "C. Geuzaine, J.-F. Remacle")
    plain = {"config": {"mesh": {"step": None}}, "codes": [], "acceleration": None, "error_kind": None, "status_counts": None}
    assert names(**plain) == ("## To cite", [method])
    assert names(**plain | {"config": {"mesh": {"step": "a.stp"}}, "codes": [{"code": "freefem"}], "error_kind": "guaranteed"})[1] == [
        method, bound, freefem, mesher]
    assert names(**plain | {"status_counts": {"open": [1]}, "acceleration": "Anderson's acceleration"})[1] == [method, contact, anderson]


def test_report_of_a_run_that_failed_early(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "drawn", lambda draw, *job: draw(*job))  # charts alone: no process for them
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
    monkeypatch.setattr(figures, "drawn", lambda draw, *job: draw(*job))
    Solution({"name": "cut short", "converged": True, "stop_reason": "converged", "iterations": 1, "timing": None}, {}).write(tmp_path)
    (tmp_path / table).write_bytes(left)
    with pytest.raises(InputError, match=f"{table} cannot be read"):
        report(tmp_path)
