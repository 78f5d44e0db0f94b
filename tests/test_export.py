"""Tables for spreadsheets and for pandas."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from yaml_case import call

from orchestrator import optional
from orchestrator.results.folder import ResultsFolder


def folder(path: Path) -> Path:
    ResultsFolder(path).write_table("interfaces.csv", [["interface", "fx"], ["a | b", 1.5], ["b | c", ""]])
    ResultsFolder(path).write_table("probes.csv", [["load_step", "tip.ux"], [1, 0.25]])
    return path


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(optional, "find_spec", lambda name: None)
    done = call("export", folder(tmp_path), tmp_path / "out.xlsx")
    assert done.exit_code == 2 and "pandas is not installed" in done.stderr and "latin-orchestrator[tables]" in done.stderr
    assert call("export", tmp_path, tmp_path / "out.ods").exit_code == 2


@pytest.mark.skipif(not (find_spec("pandas") and find_spec("openpyxl") and find_spec("pyarrow")), reason="needs the extra [tables]")
def test_tables_are_the_same_in_a_workbook_and_in_files(tmp_path):
    import pandas

    assert call("export", folder(tmp_path), tmp_path / "out.xlsx").exit_code == 0
    book = pandas.read_excel(tmp_path / "out.xlsx", sheet_name=None)
    assert list(book) == ["interfaces", "probes"] and book["interfaces"]["fx"].tolist()[0] == 1.5 and book["interfaces"]["fx"].isna()[1]
    assert call("export", tmp_path, tmp_path / "out.parquet").exit_code == 0
    assert pandas.read_parquet(tmp_path / "out-probes.parquet")["tip.ux"].tolist() == [0.25]
    (tmp_path / "empty").mkdir()
    assert call("export", tmp_path / "empty", tmp_path / "out.xlsx").exit_code == 2
