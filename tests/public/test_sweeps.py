"""Runs that begin with what others have ended with: the same answers, in fewer iterations, and told; misfits are refused."""

import json

import numpy as np
import pytest
from helpers import CONFIGS, call, run

import orchestrator

TOLERANCE = 1e-4


def forces(summary: dict) -> np.ndarray:
    return np.concatenate([np.ravel(summary["reactions"]), np.ravel([bolt["force"] for bolt in summary["bolts"] or []])])


def alike(one: dict, other: dict) -> bool:
    """Whether forces agree to the sum of both errors, relative to the largest."""
    allowed = one["error_bound"] + other["error_bound"]
    return np.abs(forces(one) - forces(other)).max() <= allowed * np.abs(forces(one)).max()


def summary_of(folder) -> dict:
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Three frictions of bolts in a flange, there, back, and each from zero: friction → summary, of each sweep."""
    found = {}
    for name, frictions, start in (("there", [0.14, 0.15, 0.16], "near"), ("back", [0.16, 0.15, 0.14], "near"),
                                   ("cold", [0.14, 0.15, 0.16], "cold")):
        folder = tmp_path_factory.mktemp(name)
        rows = orchestrator.sweep(CONFIGS / "bolts.yaml", {"interfaces.0.friction": frictions}, output=folder,
                                  overrides=["blackbox.workers=1", f"method.start={start}"])
        assert len(rows) == 3
        found[name] = {x: summary_of(folder / f"friction={x}") for x in frictions}
    return found


def test_a_variant_that_begins_with_others_agrees_with_one_from_zero(swept):
    """Both orders, within the errors that both tell; fewer iterations but for the first."""
    for name, first in (("there", 0.14), ("back", 0.16)):
        for friction, summary in swept[name].items():
            cold = swept["cold"][friction]
            assert summary["converged"] and summary["error_bound"] <= TOLERANCE and alike(summary, cold)
            assert cold["started_from"] is None
            if friction == first:
                assert summary["started_from"] is None and summary["iterations"] == cold["iterations"]
            else:
                assert summary["iterations"] <= 0.75 * cold["iterations"]
                assert any("several solutions" in warning for warning in summary["warnings"])


def test_a_variant_says_where_it_began(swept):
    near, line = swept["there"][0.15]["started_from"], swept["there"][0.16]["started_from"]
    assert [(one["run"].rpartition("=")[2], one["share"]) for one in near] == [("0.14", 1.0)]
    assert [one["run"].rpartition("=")[2] for one in line] == ["0.15", "0.14"]
    assert [one["share"] for one in line] == pytest.approx([2.0, -1.0])


BAR = {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
       "materials": [{"young": 200e3, "poisson": 0.3}],
       "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [-10, 0, 0.3], "history": "pull"}],
       "histories": {"pull": [1.0]}, "interfaces": [{"law": "contact", "friction": 0.3, "gap": -1e-4}],
       "output": {"figures": False}, "blackbox": {"workers": 1}}


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bar")
    (folder / "bar.yaml").write_text(json.dumps(BAR))
    run(folder / "bar.yaml", folder / "first")
    return folder


def test_a_run_from_its_own_end_takes_an_iteration_and_other_moduli_keep_forces(bar, tmp_path):
    """Twice the modulus, half the interference: forces are the same, and displacements half; the state has another k."""
    again = run(bar / "bar.yaml", tmp_path / "again", flags=["--start-from", bar / "first"])
    assert again["iterations"] == 1 and again["started_from"] == [{"run": str(bar / "first"), "share": 1.0}]
    first = summary_of(bar / "first")
    assert alike(first, again)
    stiff = ["materials.0.young=400e3", "interfaces.0.gap=-5e-5"]
    cold, warm = (run(bar / "bar.yaml", tmp_path / name, *stiff, flags=flags)
                  for name, flags in (("cold", ()), ("warm", ["--start-from", bar / "first"])))
    assert warm["iterations"] < cold["iterations"] and alike(warm, cold)


@pytest.mark.parametrize("change, named", [
    ("histories.pull=[0.5, 1.0]", "load steps"), ("mesh.box.cells=[8, 2, 4]", "subdomain"),
    ("subdomains.slices.count=2", "interface")])
def test_a_state_that_does_not_fit_is_refused(bar, tmp_path, change, named):
    done = call("run", bar / "bar.yaml", "--set", change, "--output", tmp_path, "--start-from", bar / "first")
    assert done.code == 2 and named in done.err and "--start-from" in done.err and "cure" in done.err


def test_a_folder_without_a_state_is_refused(bar, tmp_path):
    done = call("run", bar / "bar.yaml", "--output", tmp_path / "out", "--start-from", tmp_path)
    assert done.code == 2 and "state.npz" in done.err


def test_a_run_does_not_begin_with_what_it_writes_over(bar):
    done = call("run", bar / "bar.yaml", "--output", bar / "first", "--start-from", bar / "first")
    assert done.code == 2 and "another one with --output" in done.err and (bar / "first" / "summary.json").is_file()


def test_a_variant_that_does_not_converge_ends_as_it_does_from_zero(tmp_path):
    """Friction that holds nothing: the loads are beyond what is carried, wherever it begins. Plain data will do."""
    rows = orchestrator.sweep(BAR, {"interfaces.0.friction": [0.3, 0.29, 0.001]}, output=tmp_path)
    rows = rows if isinstance(rows, list) else rows.to_dict("records")
    assert [row["exit_code"] for row in rows] == [0, 0, 1] and [row["started_from"] for row in rows] == ["", "friction=0.3", ""]
    assert rows[1]["iterations"] < rows[0]["iterations"] and rows[2]["why"] == "limit load"
    summary = summary_of(tmp_path / "friction=0.001")
    assert summary["started_from"] is None and summary["stop_reason"] == "limit load"


def test_a_sweep_is_a_table_of_pandas_where_that_is_installed(tmp_path):
    """Numbers to compute with, a row per variant: twice the modulus, half the displacement; one that is no configuration has none."""
    pandas = pytest.importorskip("pandas")
    bonded = {**BAR, "interfaces": [{"law": "perfect"}]}
    table = orchestrator.sweep(bonded, {"materials.0.young": [200e3, 400e3], "materials.0.poisson": [0.3, 0.7]}, output=tmp_path)
    assert isinstance(table, pandas.DataFrame) and table["exit_code"].tolist() == [0, 2, 0, 2]
    assert table["materials.0.young"].tolist() == [200e3, 200e3, 400e3, 400e3] and "poisson" in table["why"][1]
    moved = table["peak_displacement"]
    assert moved.dtype == float and moved.isna().tolist() == [False, True, False, True]
    assert moved[0] == pytest.approx(2 * moved[2], rel=1e-5)
    read = pandas.read_csv(tmp_path / "sweep.csv")
    pandas.testing.assert_series_equal(read["peak_displacement"], moved)


def test_load_steps_that_follow_from_others_need_no_state(tmp_path):
    """Bonded: one load step of two is solved, or both; what one variant has solved does not fit the other, which begins at zero."""
    data = {**BAR, "interfaces": [{"law": "perfect"}], "boundary": [
        BAR["boundary"][0], {"on": "xmax", "traction": [10, 0, 0], "history": "pull"}, {"on": "ymax", "traction": [0, 1, 0], "history": "lift"}],
        "histories": {"pull": [1.0, 2.0], "lift": [1.0, 2.0]}}
    rows = orchestrator.sweep(data, {"histories.lift": [[1.0, 2.0], [1.0, 2.5], [1.0, 2.6]]}, output=tmp_path)
    rows = rows if isinstance(rows, list) else rows.to_dict("records")
    assert [row["exit_code"] for row in rows] == [0, 0, 0]
    assert [row["started_from"] for row in rows] == ["", "", rows[1]["variant"]]
