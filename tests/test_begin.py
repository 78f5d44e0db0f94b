"""``orchestrator init``: what it writes can be checked and run as it stands."""

import pytest
from typer.testing import CliRunner

from orchestrator.cli import app
from orchestrator.config import load_config


def call(*words):
    return CliRunner().invoke(app, list(map(str, words)))


def test_a_beam_runs_as_it_stands(tmp_path):
    assert call("init", tmp_path / "my beam.yaml").exit_code == 0
    assert call("check", tmp_path / "my beam.yaml").exit_code == 0
    assert "run" in call("run", tmp_path / "my beam.yaml", "--output", tmp_path / "out", "--set", "output.figures=false").stdout


def test_a_cad_files_names_are_filled_in_and_pairs_found(tmp_path):
    done = call("init", tmp_path / "rod.yaml", "gmsh:as1-tu-203.stp")
    text = (tmp_path / "rod.yaml").read_text()
    assert done.exit_code == 0 and "l-bracket_2" in text and "34 pairs of parts lie on each other" in text
    assert "orchestrator check" in done.stdout
    config = load_config(tmp_path / "rod.yaml").config  # check would read the CAD model once more
    surfaces = [line for line in text.splitlines() if line.startswith("#")]
    assert all(any(entry.on in line for line in surfaces) for entry in config.boundary)


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine.yaml").write_text("precious")
    done = call("init", tmp_path / "mine.yaml")
    assert done.exit_code == 2 and "there already" in done.stderr and (tmp_path / "mine.yaml").read_text() == "precious"


@pytest.mark.parametrize("target, source, words", [("a.yaml", "nowhere.msh", "no such file"), ("no/a.yaml", None, "No such file")])
def test_files_that_are_not_there(tmp_path, target, source, words):
    done = call("init", tmp_path / target, *([tmp_path / source] if source else []))
    assert done.exit_code == 2 and words in done.stderr
