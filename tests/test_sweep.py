"""Sweeps: which variants there are, that each is what a run gives, what is kept between them, and how they end."""

import csv
import json
from collections import Counter
from pathlib import Path

import pytest
from yaml_case import blocks, call
from in_process import InProcessWorker

from orchestrator.errors import InputError
from orchestrator.results.compare import compare
from orchestrator.results.solution import Solution
from orchestrator.sweeps.variants import variants_of


@pytest.fixture
def loads(monkeypatch) -> Counter:
    """How often the code has loaded a model, and assembled one that it does not keep."""
    counts: Counter = Counter()
    for name in ("load", "stiffness"):
        def counted(self, *arguments, done=getattr(InProcessWorker, name), name=name):
            counts[name] += 1
            return done(self, *arguments)
        monkeypatch.setattr(InProcessWorker, name, counted)
    return counts


def table(folder: Path) -> list[dict[str, str]]:
    with open(folder / "sweep.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_variants_are_combined_or_taken_together():
    both = ["a.force=5e3,1e4", "b.force=1,[2, 3]"]
    assert [v.name for v in variants_of(both)] == ["a.force=5000,b.force=1", "a.force=5000,b.force=_2,_3_", "a.force=10000,b.force=1",
                                                  "a.force=10000,b.force=_2,_3_"]
    assert [v.values for v in variants_of(both, zipped=True)] == [{"a.force": 5e3, "b.force": 1}, {"a.force": 1e4, "b.force": [2, 3]}]
    assert variants_of(["law=contact,perfect"])[0].overrides == ['law="contact"']


@pytest.mark.parametrize("asked, zipped, found", [
    ([], False, "without --vary"), (["a=1", "a=2"], False, "varied already"), (["a=1,2", "b=1"], True, "2 values of a, 1 values of b"),
    (["a=1,1.0"], False, "twice a = 1"), (["a="], False, "--vary a="), (["a"], False, "a"),
    ([f"{k}=" + "1,2,3,4" for k in "abcdefgh"], False, "65,536")])
def test_what_is_no_sweep_is_told(asked, zipped, found):
    with pytest.raises(InputError, match=found):
        variants_of(asked, zipped)


def test_cold_variants_are_what_runs_give_and_share_what_a_code_has_made(tmp_path, loads):
    path = blocks(tmp_path)
    folder = tmp_path / "sweep"
    done = call("sweep", path, "--vary", "interfaces.0.friction=0.1,0.4", "--set", "method.start=cold", "--output", folder)
    assert done.exit_code == 0, done.output
    once = Counter(loads)
    assert call("run", path, "--set", "interfaces.0.friction=0.4", "--output", tmp_path / "alone").exit_code == 0
    assert loads - once == once  # a second one has asked for nothing
    found = compare(tmp_path / "alone", folder / "friction=0.4")
    assert not found.different and max(row.difference for row in found.rows) == 0.0
    asked = [sum(worker["calls"] for worker in Solution.read(folder / f"friction={x}").summary["workload"]["set_up"]["workers"])
             for x in (0.1, 0.4)]
    assert asked[1] < asked[0]  # loads alone: coarse fields are answered
    rows = table(folder)
    assert [row["interfaces.0.friction"] for row in rows] == ["0.1", "0.4"] and (folder / "sweep.png").is_file()
    alone = Solution.read(tmp_path / "alone").summary
    assert float(rows[1]["reaction.z = 0.x"]) == alone["reactions"][0][-1][0] != float(rows[0]["reaction.z = 0.x"])
    assert alone["codes"][0]["models"] == Solution.read(folder / "friction=0.4").summary["codes"][0]["models"] > 0


@pytest.mark.long
def test_one_that_fails_keeps_no_other_from_running_and_what_is_there_is_kept(tmp_path, loads):
    path = blocks(tmp_path)
    arguments = ["sweep", path, "--vary", "interfaces.0.friction=-1,0.1,0.3", "--output", tmp_path / "sweep"]
    done = call(*arguments)
    assert done.exit_code == 2 and "2 of 3 converged" in done.output
    assert [row["exit_code"] for row in table(tmp_path / "sweep")] == ["2", "0", "0"]
    assert "interfaces.0.friction: -1" in table(tmp_path / "sweep")[0]["why"]
    before, first = sum(loads.values()), table(tmp_path / "sweep")
    again = call(*arguments, "--resume")
    assert again.exit_code == 2 and again.output.count("(kept)") == 2 and sum(loads.values()) == before
    assert table(tmp_path / "sweep") == first

    arguments[3] = "interfaces.0.friction=0.1,0.2"  # a value more: only that is run
    assert call(*arguments, "--set", "method.tolerance.law=1e-7", "--resume").output.count("(kept)") == 0  # another problem
    notes = json.loads((tmp_path / "sweep" / "sweep.json").read_text())["variants"]
    assert [one["kept"] for one in notes] == [False, False] and len(table(tmp_path / "sweep")) == 2


def test_no_variant_that_is_valid_is_an_error_at_once(tmp_path):
    done = call("sweep", blocks(tmp_path), "--vary", "interfaces.0.frction=1,2", "--output", tmp_path / "sweep")
    assert done.exit_code == 2 and "did you mean 'friction'?" in done.stderr and not (tmp_path / "sweep").exists()
