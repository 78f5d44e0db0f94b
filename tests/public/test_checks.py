"""Checks of what is delivered: bolts clamp what is under their heads."""

import re

import gmsh
import pytest
from helpers import call, run

FORCE = 16000.0


@pytest.fixture(scope="module")
def screwed(tmp_path_factory):
    """Return the path of a configuration by ``init`` of a plate that a bolt holds on a block with a thread."""
    folder = tmp_path_factory.mktemp("screwed")
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 0)
    o = gmsh.model.occ
    o.cut([(3, o.addBox(-15, -15, -16, 30, 30, 16))], [(3, o.addCylinder(0, 0, -16, 0, 0, 16, 4))])
    o.cut([(3, o.addBox(-12, -12, 0, 24, 24, 10))], [(3, o.addCylinder(0, 0, 0, 0, 0, 10, 4.5))])
    o.fuse([(3, o.addCylinder(0, 0, -14, 0, 0, 24, 4))], [(3, o.addCylinder(0, 0, 10, 0, 0, 6, 6.5))])
    o.synchronize()
    gmsh.write(str(folder / "screwed.step"))
    gmsh.finalize()
    assert call("init", folder / "screwed.yaml", folder / "screwed.step").code == 0
    text = (folder / "screwed.yaml").read_text()
    text = re.sub(r", h: {[^}]*}", ", h: {curvature: 8, max: 8}", text)
    text = re.sub(r" *# EDIT.*", "", text)
    text = re.sub(r"  - {on: \"bolt_1:\d\".*\n", "", text)  # tightened alone
    text = re.sub(r"(tighten|pull): +\[.*\n", r"\1: [1]\n", text).replace("element: auto", "element: P1, workers: 1")
    (folder / "screwed.yaml").write_text(text)
    return folder / "screwed.yaml"


def test_nothing_runs_until_the_guesses_of_init_are_edited(screwed):
    """Supports, forces and frictions that a program has guessed are nobody's problem."""
    path = screwed.with_name("guessed.yaml")
    path.write_text(screwed.read_text() + "# EDIT: the friction\n")
    for command in ("check", "run"):
        done = call(command, path)
        assert done.code == 2 and "EDIT: the friction, a guess of orchestrator init" in done.err
    line = len(path.read_text().splitlines())
    assert f"guessed.yaml:{line}" in done.err and "1 problem in the input" in done.err


def test_init_writes_a_cut_between_head_and_thread(screwed):
    at = re.search(r"force: 16000, .*cut: {plane: z, at: ([-\d.]+)}", screwed.read_text())
    assert at and 0 < float(at[1]) < 10


@pytest.mark.long
def test_what_a_cut_carries_arrives_under_the_head(screwed, tmp_path):
    text = screwed.read_text()
    auto = screwed.with_name("auto.yaml")
    auto.write_text(re.sub(r", cut: {[^}]*}", "", text))
    done = call("check", auto)
    assert done.code == 0 and (place := re.search(r"bolt_1 +\(0, 0, ([-\d.]+)\)", done.out)) and 0 < float(place[1]) < 10
    summary = run(auto, tmp_path / "out")
    head, = (face for face in summary["contact_faces"] if face["kind"] == "head")
    assert head["normal"][0] == pytest.approx(FORCE, rel=1e-4) and 0 < summary["bolts"][0]["cut"][2] < 10


def test_a_cut_within_the_thread_is_refused_or_found_out(screwed, tmp_path):
    done = call("check", screwed, "--set", "bolts.0.cut={plane: z, at: -8}")
    assert done.code == 2 and "bonded to solid_1" in done.out + done.err
    summary = run(screwed, tmp_path / "out", "bolts.0.cut={plane: [0.1, 0, 1], at: [0, 0, -8]}", code=1)
    assert summary["stop_reason"].startswith("check: of 16000 at the cut of bolt_1")
