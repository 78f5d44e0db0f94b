"""``orchestrator init``: what it writes can be checked and run, guesses once they are edited; ``inspect`` beside it."""


import numpy as np
import pytest
from yaml_case import call

from orchestrator.config.load import load_config
from orchestrator.scene.inspection import units_remark
from orchestrator.scene.mesh.sources import bricks


def test_a_beam_runs_as_it_stands(tmp_path):
    assert call("init", tmp_path / "my beam.yaml").exit_code == 0
    assert call("check", tmp_path / "my beam.yaml").exit_code == 0
    assert "run" in call("run", tmp_path / "my beam.yaml", "--output", tmp_path / "out", "--set", "output.figures=false").stdout


@pytest.mark.long
def test_a_cad_files_names_are_filled_in_and_pairs_found(tmp_path):
    done = call("init", tmp_path / "rod.yaml", "gmsh:as1-tu-203.stp")
    text = (tmp_path / "rod.yaml").read_text()
    assert done.exit_code == 0 and "l-bracket_2" in text and "32 pairs of parts lie on each other" in text and text.count(", force: ") == 7
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


def test_moduli_tell_units_that_do_not_fit():
    mesh = bricks(np.array([200.0, 10.0, 10.0]), np.array([4, 1, 1]), "bar")
    assert "and then is 0.2 GPa" in units_remark(mesh, [200.0]) and "then is 200 GPa" in units_remark(mesh, [2e11])
    assert "200 m is implausible" in units_remark(mesh, [2.1e11]) and "implausible" not in units_remark(mesh, [2.1e5])
    mesh.nodes *= 1e-6
    assert "implausible" in units_remark(mesh, [2.1e5]) and "takes a factor" in units_remark(mesh)
