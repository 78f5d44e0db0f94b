"""Random scenes and what must not change their answers; every scene that failed once; what the trials themselves can see."""

from dataclasses import replace
from pathlib import Path

import in_process  # noqa: F401 - the code that the scenes are solved by
import pytest
from quick import quick

pytest.importorskip("hypothesis")
from benchmarks.metamorphic import judge as judges  # noqa: E402
from benchmarks.metamorphic.answers import REFUSED, answer  # noqa: E402
from benchmarks.metamorphic.chunks import chunk  # noqa: E402
from boxes import boxed  # noqa: E402
from benchmarks.metamorphic.judge import FINDINGS, judge  # noqa: E402
from benchmarks.metamorphic.kept import judged_again, read  # noqa: E402
from benchmarks.metamorphic.relations import DOORS, RELATIONS  # noqa: E402
from benchmarks.metamorphic.variant import Variant  # noqa: E402

from benchmarks import registry  # noqa: E402
from orchestrator import InputError  # noqa: E402
from benchmarks.registry import run_study  # noqa: E402

KEPT = sorted((Path(__file__).parent / "scenes").glob("*.yaml"))
TWO = {"name": "two", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "histories": {"h": [0.5, 1.0]},
       "parts": [boxed("a"), boxed("b", at=[0, 0, 1])],
       "boundary": [{"on": "a/zmin", "displacement": [0, 0, 0]}, {"on": "b/zmax", "traction": [5, 0, -200], "history": "h"}],
       "interfaces": [{"between": ["a", "b"], "law": "contact", "friction": 0.2, "gap": -1e-4}],
       "method": {"tolerance": {"error": 1e-6}}, "blackbox": {"code": "in-process", "workers": 1}}


THREE = {**TWO, "parts": [*TWO["parts"], boxed("c", at=[0, 0, 2])],
         "boundary": [TWO["boundary"][0], {**TWO["boundary"][1], "on": "c/zmax"}],
         "interfaces": [{"between": ["b", "c"], "law": "perfect"}, {"between": ["a", "b"], "law": "contact", "friction": 0.3}]}
BONDED = {**THREE, "interfaces": [{"between": ["b", "c"], "law": "jump", "jump": [0, 0, 1e-4]}, {"between": ["a", "b"], "law": "perfect"}]}


FEW = ["turned askew", "other units", "renamed", "sides swapped", "solved otherwise", "said otherwise"]
MORE = [name for name in RELATIONS if name not in [*DOORS, *FEW, "mirrored"]]


@pytest.mark.parametrize("scene, relations, silent", [
    (TWO, FEW, set()), (TWO, MORE, {"cut otherwise", "solved roughly", "superposed", "after rest"}), (BONDED, FEW + MORE, set())],
    ids=["contact", "contact, more", "bonded"])
@pytest.mark.long
def test_relations_hold(scene, relations, silent):
    """Blocks pressed and sheared: all relations but those of other doors have something to say of them, and hold; with friction nothing is
    guaranteed of what is solved roughly."""
    verdict = judge(scene, relations, 1)
    assert not verdict.findings, verdict.details
    assert {k for k, v in verdict.tried.items() if v != "agree"} <= silent, verdict.tried


@pytest.mark.long
@pytest.mark.parametrize("door", quick(DOORS, *(DOORS.keys() - {"two ranks", "part as deck", "another code"})))
def test_doors_agree(door):
    """The block in the middle, bonded and in contact, as the model of another program or by another code."""
    verdict = judge(THREE, [door], 1)
    assert verdict.tried[door] == "agree", verdict.details


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.long
def test_random_scenes(seed):
    """The first scenes of two seeds, each under one relation and in one piece: never wrong, never a traceback."""
    names = [name for name in RELATIONS if name not in DOORS]
    for at, trial in enumerate(chunk(seed)[:5]):
        data = {**trial.data, "blackbox": {**trial.data["blackbox"], "code": "in-process"},
                "method": {**trial.data["method"], "max_iterations": 60}}
        verdict = judge(data, [names[(at + seed) % len(names)]], trial.drawn)
        assert not verdict.findings, (data, verdict.details)


@pytest.mark.parametrize("path", quick(KEPT, *(path for path in KEPT if path.stem == "follow_from_beside")), ids=lambda path: path.stem)
def test_scenes_that_failed(path):
    verdict = judged_again(path)
    assert not verdict.findings and verdict.outcome != "stopped", (verdict.said, verdict.details)


def test_kept_scenes_say_what_they_broke():
    for path in KEPT:
        assert read(path).relation in {*RELATIONS, "itself", "in one piece"}, path


@pytest.mark.long
def test_wrong_answers_are_seen(monkeypatch):
    """A gap forgotten in other units, half the load, a displacement off by a thousandth: none passes for the same answer."""
    def forgetful(data, rng):
        made = RELATIONS["other units"](data, rng)
        made.data["interfaces"][0]["gap"] = -1e-4 * made.length * 1.01
        return made

    def halved(data, rng):
        return Variant({**data, "histories": {"h": [0.5, 0.999]}})

    monkeypatch.setitem(RELATIONS, "forgetful", forgetful)
    monkeypatch.setitem(RELATIONS, "halved", halved)
    assert set(judge(TWO, ["forgetful", "halved"]).findings.values()) == {"disagree"}
    first = answer(TWO)
    first.solution.parts[0][:] *= 1.001
    assert judges.in_one_piece(replace(first, parts={k: 1.001 * u for k, u in first.parts.items()}))[0] == "disagree"


@pytest.mark.long
def test_the_study_in_small(tmp_path, capsys):
    """Rows as they come, tables at the end; a second run goes on where the first one ended."""
    run_study("metamorphic", tmp_path, ["scenes=2", "workers=1", "relations=1", "seed=3"])
    assert "pairs of them, never together" in capsys.readouterr().out
    rows = (tmp_path / "scenes.csv").read_text(encoding="utf-8").splitlines()
    run_study("metamorphic", tmp_path, ["scenes=3", "workers=1", "relations=1", "seed=3"], resume=True)
    assert (tmp_path / "scenes.csv").read_text(encoding="utf-8").splitlines()[: len(rows)] == rows
    assert (tmp_path / "pairs.csv").exists() and not (tmp_path / "findings").exists()


def test_what_the_study_needs_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install hypothesis"):
        run_study("metamorphic", tmp_path)


@pytest.mark.long
def test_refusals_are_no_findings_unless_the_first_scene_was_sound(monkeypatch):
    unsound = {**TWO, "boundary": TWO["boundary"][1:]}
    assert judge(unsound, ["renamed"]).outcome == REFUSED
    monkeypatch.setitem(RELATIONS, "unheld", lambda data, rng: Variant(unsound))
    assert judge(TWO, ["unheld"]).findings == {"unheld": "refused otherwise"}
    assert "refused otherwise" in FINDINGS
