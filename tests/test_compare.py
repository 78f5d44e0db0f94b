"""Two results folders beside each other."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import results_case as case
from yaml_case import bar, call

from orchestrator.config.load import load_config
from orchestrator.results.compare.compare import compare
from orchestrator.results.compare.picture import difference
from orchestrator.results.compare.quantities import Quantity, Scales, numbers_differ
from orchestrator.results.solution import Solution
from orchestrator.solving import solve


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    """Results of a bar, of one pulled by 1e-6 more, and of one pulled by 1e-12 more."""
    folder = tmp_path_factory.mktemp("bars")
    for name, pull in (("one", 10.0), ("more", 10.0 * (1 + 1e-6)), ("rounded", 10.0 * (1 + 1e-12))):
        assert call("run", bar(folder, name, pull), "--quiet").exit_code == 0
    return folder


def test_a_millionth_is_found_and_rounding_is_not(bars):
    found = call("compare", bars / "one", bars / "more")
    assert found.exit_code == 1 and "DIFFERENT" in found.stdout
    assert "configuration: boundary[1].traction: [10.0, 0.0, 0.0], now [10.00001, 0.0, 0.0]" in found.stdout
    beyond = {d.name for d in compare(bars / "one", bars / "more").beyond}
    assert {"displacement", "stress", "nodal_stress", "reactions", "energy", "peak_stress", "probes.csv: tip.ux", "extremes.csv: stress",
            "interfaces.csv: fx"} <= beyond
    found = call("compare", bars / "one", bars / "rounded")
    assert found.exit_code == 0 and "alike" in found.stdout
    assert call("compare", bars / "one", bars / "more", "--tolerance", "1e-5").exit_code == 0
    assert max(d.share for d in compare(bars / "one", bars / "one").found) == 0.0


@pytest.mark.parametrize("change", [
    lambda summary: summary["reactions"][0][0].__setitem__(0, summary["reactions"][0][0][0] * (1 + 1e-6)),
    lambda summary: summary.update(converged=False),
    lambda summary: summary["energy"].append(0.0),
    lambda summary: summary.update(peak_stress=None)], ids=["number", "fact", "longer", "missing"])
def test_whatever_a_summary_says_of_the_solution_is_judged(bars, tmp_path, change):
    shutil.copytree(bars / "one", tmp_path / "copy")
    summary = json.loads((tmp_path / "copy" / "summary.json").read_text())
    change(summary)
    (tmp_path / "copy" / "summary.json").write_text(json.dumps(summary))
    assert len(compare(bars / "one", tmp_path / "copy").beyond) == 1


def test_how_it_was_reached_is_told_and_not_judged(bars, tmp_path):
    shutil.copytree(bars / "one", tmp_path / "copy")
    summary = json.loads((tmp_path / "copy" / "summary.json").read_text())
    summary |= {"iterations": summary["iterations"] + 1, "error_bound": 1e-9, "timing": {"total": 1e6}, "versions": {}}
    (tmp_path / "copy" / "summary.json").write_text(json.dumps(summary))
    found = compare(bars / "one", tmp_path / "copy")
    assert not found.beyond and any(f"iterations {summary['iterations'] - 1}" in line for line in found.told)


def test_one_value_of_a_table_and_what_is_missing(bars, tmp_path):
    shutil.copytree(bars / "one", tmp_path / "copy")
    path = tmp_path / "copy" / "interfaces.csv"
    rows = list(csv.reader(path.open()))
    k = rows[0].index("fx")
    rows[2][k] = repr(float(rows[2][k]) * (1 + 1e-6))
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    found, = compare(bars / "one", tmp_path / "copy").beyond
    assert found.name == "interfaces.csv: fx" and found.share == pytest.approx(1e-6, rel=1e-5) and found.where.startswith(rows[2][0])
    (tmp_path / "copy" / "probes.csv").unlink()
    for file in (tmp_path / "copy" / "fields").glob("*.vtu"):
        file.unlink()
    assert {"probes.csv", "fields/"} <= {d.name for d in compare(bars / "one", tmp_path / "copy").beyond}
    assert call("compare", bars / "one", tmp_path).exit_code == 2


def test_small_numbers_count_by_themselves_and_rounding_of_large_ones_does_not():
    large, scales = np.array([1e6, 1.0, 0.0]), Scales()
    scales.take([Quantity("f", "force", large)])
    alike = numbers_differ(Quantity("f", "force", large), Quantity("f", "force", large + [0, 0, 1e-6]), scales)
    assert alike.share == pytest.approx(1e-10) and alike.of_largest == pytest.approx(1e-12)
    assert numbers_differ(Quantity("f", "force", large), Quantity("f", "force", large * [1, 1 + 1e-3, 1]), scales).share > 1e-9
    nan = np.array([np.nan, 1.0, 2.0])
    assert numbers_differ(Quantity("g", "g", nan), Quantity("g", "g", nan.copy()), scales).share == 0.0
    assert numbers_differ(Quantity("g", "g", nan), Quantity("g", "g", np.ones(3)), scales).share == np.inf


def test_the_picture_shows_the_difference_of_the_fields():
    one = case.fields()
    other = difference(one, type(one)(**{**vars_of(one), "displacement": 1.5 * one.displacement}))
    assert np.allclose(other.stress(1), 0.5 * one.stress(1))


def vars_of(fields) -> dict[str, object]:
    return {name: getattr(fields, name) for name in type(fields).__dataclass_fields__}


@pytest.mark.long
def test_the_picture_is_drawn(bars, tmp_path):
    assert call("compare", bars / "one", bars / "more", "--output", tmp_path / "found").exit_code == 1
    assert {"compare.csv", "difference.png"} <= {path.name for path in (tmp_path / "found").iterdir()}
    assert "no picture: displacements do not differ" in call("compare", bars / "one", bars / "one", "--output", tmp_path / "same").stdout


def test_python_writes_what_the_command_line_writes(bars, tmp_path):
    config = load_config(bars / "one.yaml").config
    solve(config).write(tmp_path / "python")
    files = {str(path.relative_to(bars / "one")) for path in (bars / "one").rglob("*.*") if path.is_file() and ".orchestrator" not in path.parts}
    assert files == {str(path.relative_to(tmp_path / "python")) for path in (tmp_path / "python").rglob("*.*")
                     if path.is_file() and ".orchestrator" not in path.parts}
    assert {"fields/step_0001.vtu", "interfaces.csv", "probes.csv", "extremes.csv", "history.csv"} <= files
    assert not compare(bars / "one", tmp_path / "python", tolerance=0.0).beyond
    Solution.read(bars / "one").write(tmp_path / "again")
    assert not compare(bars / "one", tmp_path / "again", tolerance=0.0).beyond
    Solution.read(tmp_path / "again").write(tmp_path / "again")
    assert not compare(bars / "one", tmp_path / "again", tolerance=0.0).beyond
