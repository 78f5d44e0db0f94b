"""Studies: the framework on a tiny matrix, the listing, unknown names, the targets' arithmetic."""

import csv
import inspect
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from in_process import IN_PROCESS
from pictures import bars, is_drawn, missing_curves, missing_points, saved_figures  # noqa: F401
from quick import late
from yaml_case import call

from benchmarks.kit.apart import apart
from benchmarks.kit.study import Case, Study, first
from benchmarks.problems import cases
from benchmarks.problems.cases import defaults, paper, with_method
from benchmarks.registry import KEPT, STUDIES, function_of, run_study
from benchmarks.studies.rivals.layers import LAYERS, layers_of
from benchmarks.studies import (
    accuracy, certified, falsified, faults, grains, prediction, ranks, scaling, stages)
from orchestrator import InputError, config_from, solve
from orchestrator.method.interface.stabilisation import ANEW


def rows_of(path):
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def tiny(slices=2):

    return {**cases.beam(slices), "blackbox": IN_PROCESS, "mesh": {"beam": {"size": [8, 2, 2], "h": 1}},
            "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                         {"on": {"plane": "x", "at": 8}, "traction": [10, 0, 0]}]}


def test_listing_is_quick_and_complete():
    done = call("study")
    assert done.exit_code == 0
    assert all(name in done.stdout and line in done.stdout for name, line in STUDIES.items())
    loaded = subprocess.run([sys.executable, "-c", "import sys, benchmarks.registry; print('numpy' in sys.modules)"],
                            capture_output=True, text=True)
    assert loaded.stdout.strip() == "False"


def test_every_study_has_its_function():
    for name in STUDIES:
        assert callable(function_of(name)) and inspect.getdoc(function_of(name))


def test_unknown_name():
    with pytest.raises(InputError, match="fig7"):
        run_study("fig6")
    done = call("study", "fig6")
    assert done.exit_code == 2 and "study 'fig6'" in done.stderr


def test_layers_hold_all_stages_of_a_run():
    timing = solve(config_from(tiny())).summary["timing"]
    assert set(timing) - {"total", "blackbox"} <= {stage for stages in LAYERS.values() for stage in stages}
    found = layers_of(timing, timing["total"] + 1.0)
    assert sum(found[layer] for layer in LAYERS) == pytest.approx(found["in all"] - found["rest"])
    assert found["rest"] >= 1.0 and found["iterations, delivery"] > 0


@pytest.mark.long
def test_matrix_of_two_cases(tmp_path, capsys, saved_figures):
    study = Study("tiny", "a tiny matrix", tmp_path)
    first = study.solve(Case(with_method(tiny(), defaults()), {"case": "defaults"}))
    assert len(rows_of(tmp_path / "table.csv")) == 1  # before the next case begins
    second = study.solve(Case(with_method(tiny(), paper("none", iterations=3)), {"case": "paper"}),
                         lambda solved: {"nodes": len(solved.scene.mesh.nodes)})
    assert first.scene is second.scene
    study.target("stages", "at most 9", study.rows[0]["stages_to_true_error"], True)
    study.target("never reached", "something", None, False)
    study.figure(stages.picture(study, "tiny"))
    study.close()

    table = rows_of(tmp_path / "table.csv")
    assert [row["case"] for row in table] == ["defaults", "paper"]
    assert table[0]["stop_reason"] == "converged" and float(table[0]["true_error"]) <= 1e-6
    assert 1 <= float(table[0]["effectivity"]) <= 5
    assert (table[1]["iterations"], table[1]["stages_to_true_error"], table[1]["nodes"]) == ("3", "", "81")
    curves = rows_of(tmp_path / "curves.csv")
    assert [c["iteration"] for c in curves if c["case"] == "2"] == ["1", "2", "3"]
    assert [row["met"] for row in rows_of(tmp_path / "targets.csv")] == ["yes", "no"]
    figure, = saved_figures
    assert is_drawn(tmp_path / "tiny.png", figure)
    assert not missing_curves(figure, tmp_path / "curves.csv", "true_error")
    assert not missing_curves(figure, tmp_path / "curves.csv", "error_bound")
    out = capsys.readouterr().out
    assert "a tiny matrix" in out and "never" in out and "NO" in out


def test_a_failing_case_leaves_the_others(tmp_path):
    study = Study("tiny", "a tiny matrix", tmp_path)
    study.solve(Case(with_method(tiny(), defaults(error=1e-2)), {"case": "good"}))
    with pytest.raises(InputError):
        study.solve(Case({**tiny(), "materials": []}, {"case": "bad"}))
    assert [row["case"] for row in rows_of(tmp_path / "table.csv")] == ["good"]


# --- contact: each study on a problem that takes a second ---------------------------------------------------


@pytest.mark.long
def test_scaling_of_tiny_cubes(tmp_path, monkeypatch, saved_figures):
    """The whole study on cubes of two elements a side, macro problems of a few."""
    monkeypatch.setattr(scaling, "without_ranks", lambda: "not in this test")
    monkeypatch.setattr(scaling, "measure_macro", lambda: prediction.measure_macro((2, 3)))
    study = Study("scaling", "tiny", tmp_path)
    scaling.run(study, elements=2, repeats=1)
    study.close()
    table = rows_of(tmp_path / "table.csv")
    assert [r["case"] for r in table] == ["strong", "strong", "weak", "weak"]
    assert [r["workers"] for r in table] == ["1", "2", "1", "2"]
    assert float(table[0]["efficiency"]) == 1 and 0.5 <= float(table[1]["balance"]) <= 1
    assert all(float(r["over_floor"]) > 1 and 0 < float(r["idle"]) < 1 for r in table)
    text = (tmp_path / "prediction.md").read_text()
    assert "100,000 subdomains" in text and "macro problem: borders" in text and "iterations: linear stage" in text
    assert is_drawn(tmp_path / "scaling.png", saved_figures[-1])
    assert bars(saved_figures[-1]) == pytest.approx([float(row["efficiency"]) for row in table], rel=1e-5)


def test_four_ranks_are_predicted_part_by_part_from_one_and_two():
    """A further rank costs what the second one did, in the iterations in each of them; runs may differ in their number."""
    known = {"codes": 7.0, "set_up": 1.0, "iterating": 20.0, "all_else": 2.0}
    rows = [{"ranks": 1, "iterations": 10, **known}, {"ranks": 2, "iterations": 12, **known, "set_up": 1.5, "iterating": 30.0, "all_else": 2.2}]
    assert ranks.predicted(rows, 4) == pytest.approx({"codes": 7.0, "set_up": 2.5, "iterating": 10 * (2.0 + 3 * 0.5), "all_else": 2.6})


@pytest.mark.long
def test_kernels_of_two_grains(tmp_path, monkeypatch, saved_figures):
    """One rank alone, two kernels of OpenBLAS: the same fields and reactions; what was set for the study is set for its runs alone."""
    monkeypatch.setattr(ranks, "without_ranks", lambda: "not in this test")
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Nehalem")
    study = Study("ranks", "tiny", tmp_path)
    ranks.run(study, ranks.Settings(counts=[2], elements=2, kernels=["Haswell", "Nehalem"]))
    study.close()
    table = rows_of(tmp_path / "table.csv")
    assert [(r["kernel"], r["ranks"], r["stop_reason"]) for r in table] == [("Haswell", "1", "converged"), ("Nehalem", "1", "converged")]
    assert float(table[0]["fields"]) == 0 and float(table[1]["fields"]) <= ranks.AGREE
    assert all(row["cpu"] == pytest.approx(sum(row[part] for part in ranks.PARTS)) for row in study.rows)
    assert all(target.met for target in study.targets) and os.environ["OPENBLAS_CORETYPE"] == "Nehalem"
    assert is_drawn(tmp_path / "ranks.png", saved_figures[-1])


@pytest.mark.long
def test_faults_of_a_tiny_beam(tmp_path, monkeypatch, saved_figures):
    """A run that is killed is resumed and compared; what could not be tried is a target that is not met."""
    monkeypatch.setattr(faults, "without_ranks", lambda: "not in this test")
    study = Study("faults", "tiny", tmp_path)
    faults.run(study, {"beam": {**tiny(), "blackbox": {}}}, kills=1, stages=0)
    (row,) = rows_of(tmp_path / "table.csv")
    assert row["fault"] == "killed" and row["exit"] == "0" and float(row["difference"]) <= faults.SAME
    met = {target.what: target.met for target in study.targets}
    assert all(well for what, well in met.items() if what.startswith("killed") and "two ranks" not in what)
    assert met["disk full"] is False and any("two ranks" in what for what in met), "what was not tried is not met"
    assert (tmp_path / "faults.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind, number, ends", [late("stiffness", 0, "refused"), ("fields", 1, "refused"), ("traces", 3, None),
                                                late("load", 0, "converged")])
def test_a_falsified_reply_is_never_silently_wrong(tmp_path, monkeypatch, kind, number, ends):
    """A real process between the pipes: what a thousandth in one reply leads to, beside a sound solution."""
    small = {**falsified.PROBLEMS["bonded"], "mesh": {"box": {"size": [4.0, 1.0, 1.0], "cells": [4, 1, 1]}}}
    monkeypatch.setitem(falsified.PROBLEMS, "small", small)
    study = Study("falsified", "one fault", tmp_path)
    exact = solve(config_from(falsified.problem("small")), study.scene(falsified.problem("small")))
    fault = {"kind": kind, "how": "reply" if kind == "fields" else "entry", "number": number, "size": 1e-3, "seed": 5}
    falsified.attempt(study, "small", fault, exact, falsified.TOLERANCE)
    (row,) = study.rows
    assert row["silent_wrong"] == "no" and ends in (None, row["outcome"]), row
    assert row["outcome"] != "refused" or row["message"].startswith("guard: ")


# --- grains: runs in processes of their own, kept ------------------------------------------------------------


def grains_study(folder, **settings):
    study = Study("grains", "few grains", folder, resume=True)
    grains.run(study, grains.Settings(elements=2.0, seeds=[1], figures=False, **settings))
    study.close()
    return study


@pytest.mark.long
def test_grains_are_kept_and_not_repeated(tmp_path, saved_figures):
    first = grains_study(tmp_path, counts=[10])
    (row,), folder = first.rows, tmp_path / "grains-10-free-seed-1-0.0001"
    summary = json.loads((folder / "summary.json").read_text())
    coarse = next(stage["seconds"] for stage in summary["workload"]["iterations"]["stages"] if stage["stage"] == "coarse")
    assert rows_of(tmp_path / "table.csv")[0]["stop_reason"] == "converged" and row["iterations"] == summary["iterations"]
    assert row["newton_steps"] == summary["newton_steps"] >= 4  # one per load step at least
    assert 0 < row["coarse_share"] == coarse / row["iterating"] < 1 and row["per_grain"] == row["seconds"] / 10
    assert row["spring_epsilon"] == pytest.approx(ANEW) and 0 < row["spring_force"] < 1e-3 and row["live_by_springs"] <= 1
    assert row["far"] == 0 == len(summary["far_bodies"])  # the top moves by a thousandth
    assert row["unsolved"] + summary["coarse_ends"]["tolerance"] == 4 * row["iterations"]  # a solve per load step
    assert row["cpu_per_grain"] > row["code_per_grain"] > 0  # those of FreeFEM, and of more
    assert not (folder / "fields.npz").exists()

    # what is kept is not run again, what is asked otherwise is
    (folder / "summary.json").unlink()
    again = grains_study(tmp_path, counts=[10, 4])
    assert again.rows[1] == row and again.rows[0]["grains"] == 4 and not (folder / "summary.json").exists()
    assert again.targets[0].met
    assert is_drawn(tmp_path / "grains.png", saved_figures[-1])
    assert not missing_points(saved_figures[-1], [(r["grains"], r["iterations"]) for r in again.rows])
    # a run that fails is a row with its reason
    failed = grains_study(tmp_path, counts=[4], method={"acceleration": "andersen"})
    assert failed.rows[0]["stop_reason"] == "failed" and "did you mean 'anderson'" in failed.rows[0]["failure"]
    assert [target.met for target in failed.targets] == [False]


@pytest.mark.long
def test_certified_scenes_are_kept_and_judged(tmp_path, capsys, saved_figures):
    asked = ["scenes=1", "first=2", "held=1", "code=in-process", "follow=false"]
    run_study("certified", tmp_path, asked)
    rows = rows_of(tmp_path / "table.csv")
    assert [row["scene"] for row in rows] == ["2", "held-2"] and all(row["stop_reason"] == "converged" for row in rows)
    assert all(float(row["true_error"]) <= float(row["asked"]) for row in rows if row["error_kind"] == "guaranteed")
    assert is_drawn(tmp_path / "certified.png", saved_figures[-1])
    run_study("certified", tmp_path, asked, resume=True)
    assert rows_of(tmp_path / "table.csv") == rows


@pytest.mark.long
def test_accuracies_are_compared_with_true_errors(tmp_path, saved_figures):
    run_study("accuracy", tmp_path, ["cases=[hole]", "elements=[P2]", "asked={P2: [0.1]}", "reference={hole: 3000}"])
    rows = rows_of(tmp_path / "table.csv")
    assert [row["mesh"] for row in rows] == ["uniform", "uniform", "1"] and all(0.7 < float(row["effectivity"]) < 1.5 for row in rows)
    first, *others = rows_of(tmp_path / "targets.csv")
    assert not any("falls as" in target["target"] for target in others)  # of one mesh there is no rate
    assert first["target"] == "hole, P2, 10%" and (first["met"] == "yes") == (accuracy.LEAST * 0.1 <= float(rows[-1]["true_error"]) <= 0.1)
    assert is_drawn(tmp_path / "accuracy.png", saved_figures[-1]) and float(rows[-1]["true_error"]) < 0.05
    one, finer = (solve(config_from(accuracy.problem(tmp_path, "hole", *how))) for how in (("P1", 0.25), ("P2", 0.1)))
    assert apart(one, one) < 1e-9
    energies = [solved.summary["energy"][-1] for solved in (one, finer)]
    assert apart(one, finer) == pytest.approx(np.sqrt(1 - energies[0] / energies[1]), rel=0.03)  # all but orthogonal


def test_what_a_study_may_be_told(tmp_path):
    for name, asked, message in (("grains", {"overrides": ["cunts=[3]"]}, "did you mean 'counts'"),
                                 ("grains", {"overrides": ["counts=[1]"]}, "greater than or equal to 2"),
                                 ("grains", {"overrides": ["counts"]}, "key=value"),
                                 ("fig7", {"overrides": ["counts=[3]"]}, "fig7 has no settings"),
                                 ("fig7", {"resume": True}, "fig7 keeps no runs")):
        with pytest.raises(InputError, match=message):
            run_study(name, tmp_path / "none", **asked)
    assert not (tmp_path / "none").exists()
    assert KEPT == {name for name in STUDIES if re.search(r"study\.(kept|resume)\b", inspect.getsource(inspect.getmodule(function_of(name))))}
