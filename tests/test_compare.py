"""Two results folders side by side."""

import json
import shutil
from pathlib import Path

import pytest
from yaml_case import bar, call

from orchestrator.config.load import load_config
from orchestrator.results.compare import compare
from orchestrator.results.solution import Solution
from orchestrator.solving import solve


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    """Results of a bar, of one pulled by a thousandth more, and of one pulled by 1e-12 more."""
    folder = tmp_path_factory.mktemp("bars")
    for name, pull in (("one", 10.0), ("more", 10.0 * (1 + 1e-3)), ("rounded", 10.0 * (1 + 1e-12))):
        assert call("run", bar(folder, name, pull), "--quiet").exit_code == 0
    return folder


def test_what_is_beyond_the_errors_is_found_and_rounding_is_not(bars):
    found = call("compare", bars / "one", bars / "more")
    assert found.exit_code == 1 and "DIFFERENT: 10 of 13 quantities" in found.stdout
    assert {"energy", "peak stress", "peak displacement", "displacement field"} <= {
        name.partition(",")[0] for name in compare(bars / "one", bars / "more").different}
    found = call("compare", bars / "one", bars / "rounded")
    assert found.exit_code == 0 and "equal: 13 quantities" in found.stdout and "iterations" in found.stdout
    assert call("compare", bars / "one", bars).exit_code == 2


@pytest.mark.parametrize("change, name", [
    (lambda summary: summary["reactions"][0][0].__setitem__(0, summary["reactions"][0][0][0] * 1.01), "reaction xmin"),
    (lambda summary: summary.update(converged=False), "converged"), (lambda summary: summary["energy"].append(0.0), "energy"),
    (lambda summary: summary.update(peak_stress=None), "peak stress"),
    (lambda summary: summary["probes"][0]["values"]["ux"].__setitem__(0, None), "probe tip ux")],
    ids=["number", "fact", "longer", "missing", "unknown"])
def test_whatever_a_summary_says_of_the_solution_is_judged(bars, tmp_path, change, name):
    different, = compare(bars / "one", changed(bars / "one", tmp_path, change)).different
    assert different.startswith(name)


def changed(folder: Path, target: Path, change) -> Path:
    """A copy of a results folder whose summary is changed."""
    shutil.copytree(folder, target / "copy")
    summary = json.loads((target / "copy" / "summary.json").read_text())
    change(summary)
    (target / "copy" / "summary.json").write_text(json.dumps(summary))
    return target / "copy"


def test_how_it_was_reached_is_shown_and_not_judged(bars, tmp_path):
    other = changed(bars / "one", tmp_path, lambda summary: summary.update(iterations=99, timing={"total": 1e6}, versions={}))
    found = compare(bars / "one", other)
    assert not found.different and any("iterations" in line and "99" in line for line in found.lines())


def test_a_run_that_tells_a_larger_error_may_be_farther_off(bars, tmp_path):
    assert compare(bars / "one", bars / "more").different
    assert not compare(changed(bars / "one", tmp_path, lambda summary: summary.update(error_bound=2e-3)), bars / "more").different


def test_another_mesh_adds_the_meshes_errors(bars, tmp_path):
    finer = bar(tmp_path, "finer")
    assert call("run", finer, "--quiet", "--set", "mesh.box.cells=[12,3,3]").exit_code == 0
    rows = {row.name: row for row in compare(bars / "one", tmp_path / "finer").rows}
    told = [Solution.read(path).summary["discretisation_error"] for path in (bars / "one", tmp_path / "finer")]
    assert rows["energy, load step 1"].allowed == pytest.approx(sum(told), rel=0.01) and not rows["energy, load step 1"].differs
    assert "displacement field" not in {name.partition(",")[0] for name in rows}


def test_python_writes_what_the_command_line_writes(bars, tmp_path):
    solve(load_config(bars / "one.yaml").config).write(tmp_path / "python")
    files = {str(path.relative_to(bars / "one")) for path in (bars / "one").rglob("*.*") if path.is_file() and ".orchestrator" not in path.parts}
    assert files - {"state.npz"} == {str(path.relative_to(tmp_path / "python")) for path in (tmp_path / "python").rglob("*.*")
                     if path.is_file() and ".orchestrator" not in path.parts}
    assert {"fields/step_0001.vtu", "interfaces.csv", "probes.csv", "extremes.csv", "history.csv"} <= files
    Solution.read(bars / "one").write(tmp_path / "again")
    Solution.read(tmp_path / "again").write(tmp_path / "again")
    for name in ("fields.npz", "fields/step_0001.vtu", "interfaces.csv", "probes.csv", "extremes.csv"):
        for folder in ("python", "again"):
            assert (tmp_path / folder / name).read_bytes() == (bars / "one" / name).read_bytes(), (folder, name)
