"""Studies: the framework on a tiny matrix, the listing, unknown names, the targets' arithmetic."""

import csv
import importlib
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from orchestrator.cli import app
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.studies import _REGISTRY, STUDIES, run_study


def rows_of(path):
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def tiny(slices=2):
    from orchestrator.studies.cases import beam

    return {**beam(slices), "mesh": {"beam": {"size": [8, 2, 2], "h": 1}},
            "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                         {"on": {"plane": "x", "at": 8}, "traction": [10, 0, 0]}]}


def test_listing_is_quick_and_complete():
    done = CliRunner().invoke(app, ["study"])
    assert done.exit_code == 0
    assert all(name in done.stdout and line in done.stdout for name, line in STUDIES.items())
    loaded = subprocess.run([sys.executable, "-c", "import sys, orchestrator.studies; print('numpy' in sys.modules)"],
                            capture_output=True, text=True)
    assert loaded.stdout.strip() == "False"


def test_every_study_has_its_function():
    for module, function, _ in _REGISTRY.values():
        assert callable(getattr(importlib.import_module(f"orchestrator.studies.{module}"), function))


def test_unknown_name():
    with pytest.raises(InputError, match="fig7"):
        run_study("fig6")
    done = CliRunner().invoke(app, ["study", "fig6"])
    assert done.exit_code == 2 and "study 'fig6'" in done.stderr


def test_matrix_of_two_cases(tmp_path, capsys):
    from orchestrator.studies.cases import defaults, paper, with_method
    from orchestrator.studies.framework import Case, Study
    from orchestrator.studies.scaling import picture

    study = Study("tiny", "a tiny matrix", tmp_path)
    first = study.solve(Case(with_method(tiny(), defaults()), {"case": "defaults"}))
    assert len(rows_of(tmp_path / "table.csv")) == 1  # before the next case begins
    second = study.solve(Case(with_method(tiny(), paper("none", iterations=3)), {"case": "paper"}),
                         lambda solved: {"nodes": len(solved.scene.mesh.nodes)})
    assert first.scene is second.scene
    study.target("stages", "at most 9", study.rows[0]["stages_to_true_error"], True)
    study.target("never reached", "something", None, False)
    study.figure(picture(study, "tiny"))
    study.close()

    table = rows_of(tmp_path / "table.csv")
    assert [row["case"] for row in table] == ["defaults", "paper"]
    assert table[0]["stop_reason"] == "converged" and float(table[0]["true_error"]) <= 1e-6
    assert 1 <= float(table[0]["effectivity"]) <= 5
    assert (table[1]["iterations"], table[1]["stages_to_true_error"], table[1]["nodes"]) == ("3", "", "81")
    curves = rows_of(tmp_path / "curves.csv")
    assert [c["iteration"] for c in curves if c["case"] == "2"] == ["1", "2", "3"]
    assert [row["met"] for row in rows_of(tmp_path / "targets.csv")] == ["yes", "no"]
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "a tiny matrix" in out and "never" in out and "NO" in out


def test_a_failing_case_leaves_the_others(tmp_path, monkeypatch):
    from orchestrator.studies import framework
    from orchestrator.studies.cases import defaults, with_method

    study = framework.Study("tiny", "a tiny matrix", tmp_path)
    study.solve(framework.Case(with_method(tiny(), defaults(error=1e-2)), {"case": "good"}))

    def fails(*args, **kwargs):
        raise BlackBoxError("gone")

    monkeypatch.setattr(framework, "solve", fails)
    with pytest.raises(BlackBoxError):
        study.solve(framework.Case(with_method(tiny(), defaults()), {"case": "bad"}))
    assert [row["case"] for row in rows_of(tmp_path / "table.csv")] == ["good"]


def test_first():
    from orchestrator.studies.framework import first

    history = [SimpleNamespace(iteration=i, true_error=e) for i, e in ((1, np.nan), (2, 1e-3), (3, 1e-7), (4, 1e-6))]
    assert first(history, "true_error", 1e-6).iteration == 3
    assert first(history, "true_error", 1e-9) is None


def test_alternating_beam_fills_the_box(tmp_path):
    import meshio

    from orchestrator.scene.build import build_scene
    from orchestrator.config import config_from
    from orchestrator.studies.alternating import alternating_beam

    path = alternating_beam(tmp_path, (4, 2, 2), 2.0)
    mesh = meshio.read(path)
    a, b, c, d = np.moveaxis(mesh.points[mesh.cells_dict["tetra"]], 1, 0)
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    assert len(volume) == 5 * 16 and volume.min() > 0 and volume.sum() == pytest.approx(16 * 8)
    scene = build_scene(config_from({**tiny(), "mesh": {"file": str(path)}}))
    assert [len(i.triangles) for i in scene.interfaces] == [8]
