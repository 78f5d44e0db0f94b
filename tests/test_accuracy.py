"""An accuracy that is asked for: meshes that are refined where it pays."""

import json
import math
import signal
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from accuracy_case import PLACES, bent
from in_process import IN_PROCESS
from processes import begin

from orchestrator import run as one
from orchestrator.accuracy.loop import run
from orchestrator.accuracy.passes import GOOD, Pass, tightest
from orchestrator.config.load import Loaded, config_from
from orchestrator.config.method import Accuracy
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.results.fields.fields import read_npz
from orchestrator.results.history import read_history
from orchestrator.results.summary.summary import read_summary
from orchestrator.results.summary.lines import summary_rows
from orchestrator.scene.mesh.size_map import edge_lengths
from orchestrator.scene.mesh.gmsh_session import gmsh, session
from orchestrator.solving import solve

HERE = Path(__file__).parent


def refined(problem, path, resume=False):
    code = run(Loaded(config_from(problem)), output=path, quiet=True, resume=resume)
    return code, json.loads((path / "summary.json").read_text())


def mesh_of(elements, error, **more):
    return Pass(elements, elements, error, 0.0, error, 1.0, **{"memory": 1e8, **more})


def test_room_in_memory_and_seconds():
    done = [mesh_of(1000, 0.2, memory=3e8), mesh_of(8000, 0.1, memory=6.5e8)]  # 50 kB an element, more than 10 kB an unknown
    found = tightest(Accuracy(error=0.05, memory=1.0), done, 0.0, 64_000)
    assert found.elements == pytest.approx(8000 + 3.5e8 / 5e4)
    assert "0.65 were taken" in found.short and "64,000 elements, which take some 3.5 GB" in found.needed
    assert tightest(Accuracy(error=0.05, memory=0.1), done, 0.0, 64_000).elements == 0
    assert tightest(Accuracy(error=0.05, memory=1.0), done[:1], 0.0, 64_000).elements == pytest.approx(1000 + 7e8 / 3e4)
    seconds = tightest(Accuracy(error=0.05, memory=1.0, seconds=9.0), done, 8.0, 64_000)
    assert seconds.elements == pytest.approx(8000) and "take some 28 s" in seconds.needed
    assert math.isinf(tightest(Accuracy(error=0.05), done, 0.0, 64_000).elements)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nobody disturbs: its folder, code and summary."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, *refined(bent(0.07), folder)


def test_asked_and_reached(whole):
    folder, code, summary = whole
    found = summary["accuracy"]
    assert code == 0 and summary["converged"] and found["met"] and len(found["meshes"]) > 1
    first, last = found["meshes"][0], found["meshes"][-1]
    assert first["mesh_error"] > 0.07 > last["error"] > 0.07 / 3 and last["elements"] > first["elements"]
    assert summary["error_bound"] <= 0.007 and last["refined"] == ["bent"] and last["had"] == pytest.approx(1.0)
    assert summary["config"]["method"]["accuracy"]["error"] == 0.07
    assert config_from(summary["config"]).method.accuracy.error == 0.07
    told, (before, now) = found["numbers"]["peak_displacement"], (mesh["numbers"]["peak_displacement"] for mesh in found["meshes"][-2:])
    assert told >= abs(now - before) * last["error"] / (found["meshes"][-2]["error"] - last["error"]) * (1 - 1e-12) > 0
    assert "peak displacement ± " in dict(summary_rows(summary))["off by"]
    assert last["told"] is not None and "measured against the mesh before" in dict(summary_rows(summary))["accuracy"]
    assert 0 < summary["timing"]["meshes_before"] < summary["timing"]["total"] - summary["timing"]["startup"]
    cells = read_npz(folder).discretisation_error
    assert np.sqrt((cells**2).sum()) == pytest.approx(last["mesh_error"]) == pytest.approx(summary["discretisation_error"])


def beside_seconds(code, summary):
    meshes = [{key: value for key, value in mesh.items() if key not in ("seconds", "memory")} for mesh in summary["accuracy"]["meshes"]]
    return code, meshes, summary["peak_stress"], summary["converged"]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.long
def test_a_killed_run_goes_on(place, tmp_path, whole):
    assert begin(sys.executable, str(HERE / "accuracy_case.py"), place, str(tmp_path)).wait() == -signal.SIGKILL
    if place == "in the mesher":
        left = read_summary(tmp_path)
        assert not left["converged"] and "--resume goes on" in left["stop_reason"] and (tmp_path / "fields.npz").is_file()
    again = refined(bent(0.07), tmp_path, resume=True)
    assert beside_seconds(*again) == beside_seconds(*whole[1:])
    assert not any(path.name.startswith(Path(GOOD).name) for path in tmp_path.rglob("*"))


@pytest.mark.parametrize("fault", ["its process is killed", "the model is spoilt"])
@pytest.mark.long
def test_a_mesh_that_cannot_be_made_leaves_the_last_result(fault, tmp_path):
    """With what the fault was; once it is mended the same command goes on."""
    path = tmp_path / "bar.brep"
    with session():
        gmsh.model.occ.addBox(0, 0, 0, 20, 10, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    problem, model = {**bent({"error": 0.4, "elements": 3000}), "mesh": {"step": str(path), "h": 5.0}, "blackbox": IN_PROCESS, "boundary": [
        {"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}, {"on": {"plane": "x", "at": 20}, "traction": [0, 0, 10]}]}, path.read_text()

    def spoil(solution):
        if fault == "the model is spoilt":
            path.write_text("nothing\n")
        else:
            mesher, = (one for one in psutil.Process().children() if "orchestrator.apart" in one.cmdline())
            mesher.kill()
        return solution

    code = run(Loaded(config_from(problem)), output=tmp_path, quiet=True, means=one.Means(judge=spoil))
    summary = read_summary(tmp_path)
    assert code == 1 and len(summary["accuracy"]["meshes"]) == 1
    assert ("its content is not what .brep stands for" if "model" in fault else "was ended by SIGKILL") in summary["stop_reason"]
    assert len(read_npz(tmp_path).cells) == summary["accuracy"]["meshes"][0]["elements"] and not (tmp_path / GOOD).exists()
    path.write_text(model)
    code, summary = refined(problem, tmp_path, resume=True)
    assert code == 0 and summary["accuracy"]["met"] and len(summary["accuracy"]["meshes"]) > 1


@pytest.mark.parametrize("dies", [True, False])
@pytest.mark.long
def test_a_mesh_that_is_not_solved_on_leaves_the_last_result(tmp_path, monkeypatch, dies):
    real, calls = one.solve, []

    def failing(config, *given, **options):
        calls.append(given)
        if len(calls) == 1:
            return real(config, *given, **options)
        if dies:
            raise BlackBoxError("the code has died")
        short = config.method.model_copy(update={"max_iterations": 1})
        return real(config.model_copy(update={"method": short}), *given, **options)

    monkeypatch.setattr(one, "solve", failing)
    code, summary = refined(bent(0.07), tmp_path)
    assert code == 1 and not summary["converged"] and summary["error_bound"] <= 0.007
    assert ("has died" if dies else "max_iterations") in summary["stop_reason"]
    assert len(read_npz(tmp_path).discretisation_error[0]) == summary["accuracy"]["meshes"][0]["elements"]
    assert len(read_history(tmp_path)["iteration"]) == summary["iterations"]
    assert not (tmp_path / GOOD).exists()
    if dies:  # and so once more
        code, again = refined(bent(0.07), tmp_path, resume=True)
        assert code == 1 and again == summary | {"timing": again["timing"]} and (tmp_path / "fields.npz").is_file()


def test_what_is_refused():
    with pytest.raises(InputError, match="error"):
        config_from(bent({"elements": 600}))
    with pytest.raises(InputError, match="beside accuracy"):
        config_from({**bent(0.05), "method": {"accuracy": 0.05, "tolerance": {"law": 1e-3}}})
    config_from({**bent(0.05), "method": {"accuracy": 0.05, "tolerance": {"error": 1e-3}}})
    parts = [{"name": name, "mesh": bent(0.05)["mesh"], "move": {"translate": [20 * k, 0, 0]}} for k, name in enumerate("ab")]
    apart = {key: value for key, value in bent(0.05).items() if key != "mesh"} | {"parts": parts, "subdomains": "groups"}
    with pytest.raises(InputError, match="no interfaces, beside method.accuracy"):
        config_from(apart)
    config_from({**apart, "interfaces": [{"between": "auto", "law": "perfect"}]})
    with pytest.raises(InputError, match="a form beside"):
        config_from({**bent(0.05), "blackbox": {"code": "freefem", "form": "mine.idp"}})
    with pytest.raises(InputError, match="orchestrator run"):
        solve(config_from(bent(0.05)))


def pushed(**law):
    """Two blocks, the upper one pushed and shifted."""
    return {
        "name": "pushed", "mesh": {"box": {"size": [1, 1, 2], "cells": [3, 3, 6]}}, "subdomains": {"slices": {"axis": "z", "count": 2}},
        "materials": [{"young": 1000.0, "poisson": 0.3}], "interfaces": [{"law": "contact", **law}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}]}


def test_one_mesh_serves_all_load_steps(tmp_path):
    """Friction; pressed at one end of the upper block, then pushed at the other: what each load step errs in is made finer."""
    problem = pushed(friction=0.3)
    problem["boundary"] = [problem["boundary"][0], *(
        {"on": {"box": [[x, 0, 2], [x + 1 / 3, 1, 2]]}, "displacement": to} for x, to in (
            (0, [[0, 0, -0.02], [0, 0, 0]]), (2 / 3, [[0, 0, 0], [0.01, 0, -0.02]])))]
    problem |= {"output": {"figures": False}, "method": {"accuracy": {"error": 0.4, "elements": 1500}, "max_iterations": 1000}}
    found = []

    def kept(solution):
        found.append(solution)
        return solution

    run(Loaded(config_from(problem)), output=tmp_path, quiet=True, means=one.Means(judge=kept))
    meshes = found[-1].summary["accuracy"]["meshes"]
    first, last = ((one.scene.mesh, np.sqrt((one.fields.discretisation_error**2).sum(axis=1))) for one in (found[0], found[-1]))
    assert len(meshes) > 1 and [one["mesh_error"] for one in (meshes[0], meshes[-1])] == pytest.approx([first[1].max(), last[1].max()])
    assert (last[1] < 0.9 * first[1]).all()
    for x in (1 / 3, 2 / 3):  # where each ends
        size = [edge_lengths(mesh.nodes, mesh.cells)[np.linalg.norm(mesh.nodes[mesh.cells].mean(axis=1) - [x, 0.5, 2], axis=1).argmin()]
                for mesh, _ in (first, last)]
        assert size[1] < 0.8 * size[0]
