"""Nothing computed is lost: a run that is stopped goes on as if nothing had happened, whatever stopped it."""

import errno
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from boxes import boxed
from method_case import CUBES, METIS, config
from in_process import IN_PROCESS, IN_PROCESS_PLASTIC
from processes import begin
from quick import late, quick

from orchestrator.config.load import load_config
from orchestrator.errors import InputError, InternalError, lacks_memory
from orchestrator.ending import guarded
from orchestrator.method.events import Subscriber
from orchestrator.method.stopping.softest import STEPS as SOFTNESS
from orchestrator.folders import read_arrays
from orchestrator.results.checkpoint import load_checkpoint, read_file, VERSION
from orchestrator.results.keeping import CheckpointWriter
from orchestrator.results.fingerprint import differences, digest_of, problem_of
from orchestrator.results.folder import ResultsFolder, locked
from orchestrator.results.history import HistoryWriter, read_history
from orchestrator.run import run, solve
from orchestrator.scene.build import build_scene

PRESSED = {"mesh": {"box": {"size": [2.0, 1.0, 2.0], "cells": [4, 2, 4]}}, "subdomains": {"grid": [2, 1, 2]},
           "interfaces": [{"law": "contact", "friction": 0.3}],
           "boundary": [{"on": "zmin", "displacement": [0, 0, 0]},
                        {"on": "zmax", "displacement": [[0, 0, -0.005], [0.004, 0, -0.005], [-0.004, 0, -0.006]]}]}
TURNED = {"boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
                       {"on": "xmax", "traction": [[10, 1, 0], [0, 0, 3], [1, 2, 3]]}]}
APART = {"mesh": None, "subdomains": "groups", "parts": [boxed("low", [2, 1, 1], [4, 2, 2]), boxed("up", [2, 1, 1], [5, 3, 2], [0, 0, 1])]}
FORGETFUL = "bonded, three directions kept"
CASES = {
    "bonded": {**METIS, **TURNED},
    FORGETFUL: {**CUBES, **TURNED, "method": {"memory": 3}},
    "relaxation": {**METIS, **TURNED, "method": {"acceleration": "none", "tolerance": {"indicator": 1e-7}}},
    "tolerance from the mesh's error": {**METIS, **TURNED, "method": {"tolerance": {"error": "auto", "fraction": 1e-4}}},
    "contact": PRESSED,
    "contact, step by step": {**PRESSED, "method": {"increment": 1}},
    "contact, four differences kept": {**PRESSED, "method": {"memory": 4}},
    "nonlinear, step by step": {**PRESSED, "boundary": [PRESSED["boundary"][0], {"on": "zmax", "displacement": [
        [0, 0, -0.005], [0.004, 0, -0.005]]}], "blackbox": [IN_PROCESS, {**IN_PROCESS_PLASTIC, "on": "block 0-0-0"}]},
    "bonded, nodes that do not match": {**TURNED, **APART, "interfaces": [{"law": "perfect"}], "boundary": [
        {"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
        {"on": {"plane": "z", "at": 2.0}, "traction": [[10, 1, 0], [0, 0, 3], [1, 2, 3]]}]},
    "contact, nodes that do not match": {**PRESSED, **APART, "boundary": [
        {**entry, "on": {"plane": "z", "at": at}} for entry, at in zip(PRESSED["boundary"], (0.0, 2.0))]},
    "contact, sides that slide on": {**APART, "interfaces": [{"law": "contact", "friction": 0.3, "pairing": "follow"}], "boundary": [
        {"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
        {"on": {"plane": "z", "at": 2.0}, "displacement": [[0.3, 0, -0.03], [0.6, 0.1, -0.03]]}]},
}


class Stop(Subscriber):
    """Interrupts after an iteration."""

    def __init__(self, iteration):
        self.at = iteration

    def iteration(self, event):
        if event.iteration == self.at:
            raise KeyboardInterrupt


def stopped_and_resumed(tmp_path, made, scene, stops):
    """The solution of a run that is interrupted after each of some iterations, and the iterations told, in order."""
    folder, key, told, start = ResultsFolder(tmp_path), "key", [], None

    class Told(Subscriber):
        def iteration(self, event):
            told.append(event)

    for stop in stops:
        keeper = CheckpointWriter(folder, key, start)
        with pytest.raises(KeyboardInterrupt):
            solve(made, scene, [keeper, Told(), Stop(stop)], start=start)
        start = load_checkpoint(folder, key)
        assert start.iteration == stop
    return solve(made, scene, [Told()], start=start), told


@pytest.mark.parametrize("case", quick(CASES, "contact"))
def test_a_stopped_run_goes_on_as_if_nothing_had_happened(tmp_path, case):
    """The same iterations, the same values to the last bit but rounding, wherever it was stopped.

    Rounding is that of what is iterated upon, of order one: measures that have fallen by 1e7 keep it as it is.
    """
    made = config(**CASES[case])
    scene = build_scene(made)
    whole = solve(made, scene)
    assert whole.iterations > 9
    stops = sorted({1, whole.iterations // 2, whole.iterations - 1})
    resumed, told = stopped_and_resumed(tmp_path, made, scene, stops)
    if case == FORGETFUL:  # what has been forgotten had brought it where it was
        assert abs(len(told) - whole.iterations) <= 1 and resumed.converged
        assert np.abs(resumed.displacement - whole.displacement).max() <= 1e-6 * np.abs(whole.displacement).max()
        return
    assert [event.iteration for event in told] == list(range(1, whole.iterations + 1))
    for name in ("residual", "indicator", "sweeps"):
        theirs, ours = ([getattr(e, name) for e in events] for events in (whole.iterated.history, told))
        theirs, ours = np.array(theirs[-len(ours):]), np.array(ours[-len(theirs):])
        if name == "sweeps":  # how soft subdomains are is not kept: who goes on may have to ask their codes again
            asked = SOFTNESS / scene.steps
            ours -= asked * np.clip(np.round((ours - theirs) / asked), 0, len(stops))
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-13 * max(1.0, np.nanmax(theirs)))
    assert np.all(np.diff([event.seconds for event in told]) > 0), "seconds go on"
    scale = np.abs(whole.displacement).max()
    assert np.abs(resumed.displacement - whole.displacement).max() <= 1e-12 * scale
    np.testing.assert_allclose(resumed.energy, whole.energy, rtol=1e-12)


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """A folder with the checkpoint of an interrupted run, its configuration and scene, and the undisturbed solution."""
    made = config(**PRESSED)
    scene, folder = build_scene(made), tmp_path_factory.mktemp("interrupted")
    keeper = CheckpointWriter(ResultsFolder(folder), "key")
    with pytest.raises(KeyboardInterrupt):
        solve(made, scene, [keeper, Stop(11)])
    return folder, made, scene, solve(made, scene)


@pytest.mark.parametrize("damage", quick(["cut short", "a bit flipped"], "a bit flipped"))
def test_damaged_records_are_computed_again(tmp_path, interrupted, damage):
    """A file whose sum is wrong counts as if it had never been written."""
    folder, made, scene, whole = interrupted
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    last = sorted((tmp_path / "checkpoint").glob("iteration-*"))[-1]
    content = bytearray(last.read_bytes())
    if damage == "cut short":
        content = content[:-7]
    else:
        content[len(content) // 2] ^= 4
    last.write_bytes(content)
    start = load_checkpoint(tmp_path, "key")
    assert start.iteration == 10
    resumed = solve(made, scene, start=start)
    assert resumed.iterations == whole.iterations
    assert np.abs(resumed.displacement - whole.displacement).max() <= 1e-12 * np.abs(whole.displacement).max()


@pytest.mark.parametrize("seed", quick(range(4), 0))
def test_bytes_that_a_disk_has_spoilt_change_no_answer(tmp_path, interrupted, seed):
    """Bits flipped anywhere in a checkpoint's files, their beginnings more often: what is read all the same is what was written."""
    folder, draw, sums = interrupted[0], np.random.default_rng(seed), set()
    whole = load_checkpoint(folder, "key")
    known = {x.iteration: x for x in (read_file(file)[1] for file in (folder / "checkpoint").glob("iteration-*"))}
    files = sorted((folder / "checkpoint").glob("*.npz"))
    assert len(files) > 1 and whole.iteration == 11
    for number in range(50):
        shutil.rmtree(tmp_path / "checkpoint", ignore_errors=True)
        shutil.copytree(folder / "checkpoint", tmp_path / "checkpoint")
        file = tmp_path / "checkpoint" / files[draw.integers(len(files))].name
        content = bytearray(file.read_bytes())
        content[draw.integers(60) if number % 2 else draw.integers(len(content))] ^= 1 << draw.integers(8)
        file.write_bytes(content)
        told = []
        start = load_checkpoint(tmp_path, "key", warn=told.append)
        assert start is None or start.iteration <= whole.iteration
        assert all("damaged" in sentence for sentence in told) and len(told) < 2
        for ours in start.latest if start else []:
            true = known[ours.iteration]
            read = ours.of_rank({name.partition("/")[0]: np.arange(width) for name, width in ours.widths.items()})
            assert ours.notes == true.notes
            assert read.arrays.keys() == {name for name in true.arrays if not name.startswith("columns/")}
            assert all(np.array_equal(array, true.arrays[name]) for name, array in read.arrays.items())
        sums.add(None if start is None else start.iteration)
    assert len(sums) > 2


def test_an_array_that_its_header_shortens_is_found(tmp_path):
    """One bit makes (2048,) of it (2008,), and whoever reads 2008 numbers does not come to the end, where the checksum is."""
    file = tmp_path / "arrays.npz"
    np.savez(file, whole=np.arange(2048.0))
    assert np.array_equal(read_arrays(file)["whole"], np.arange(2048.0))
    content = file.read_bytes()
    file.write_bytes(content.replace(b"(2048,)", b"(2008,)"))
    assert len(np.load(file)["whole"]) == 2008
    with pytest.raises(zipfile.BadZipFile, match="CRC"):
        read_arrays(file)


def test_what_cannot_be_resumed_is_refused(tmp_path, interrupted):
    folder, made, scene, _ = interrupted
    with pytest.raises(InputError, match="another problem"):
        load_checkpoint(folder, "lock")
    with pytest.raises(InputError, match="no checkpoint"):
        load_checkpoint(tmp_path / "nowhere", "key")
    start = load_checkpoint(folder, "key")
    other = config(**PRESSED | {"subdomains": {"grid": [2, 1, 1]}})
    with pytest.raises(InputError, match="columns"):
        solve(other, start=start)
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    last = sorted((tmp_path / "checkpoint").glob("iteration-*"))[-1]
    arrays = dict(np.load(last))
    arrays["trace/s"][0, 3] = np.nan
    np.savez(last, **arrays)
    with pytest.raises(InputError, match="not finite"):
        solve(made, scene, start=load_checkpoint(tmp_path, "key"))


def test_killed_while_the_first_record_was_written(tmp_path, interrupted):
    """Nothing whole is there: the run begins at its beginning."""
    path = tmp_path / "checkpoint"
    shutil.copytree(interrupted[0] / "checkpoint", path)
    for file in path.iterdir():
        file.write_bytes(file.read_bytes()[:300])
    assert load_checkpoint(tmp_path, "key") is None


def test_fingerprint_allows_for_what_changes_no_state():
    made = config().complete()
    for key, value in {"timeout": 5.0, "workers": 3, "transport": "file"}.items():
        assert problem_of({**made, "blackbox": {**made["blackbox"], key: value}}) == problem_of(made)
    assert problem_of({**made, "materials": []}) != problem_of(made)


# What a configuration names, files that are read with it, and which of them changes; names of files as they stand below a folder.
FILES = {
    "a mesh's surfaces": ({"mesh": {"file": "plate.msh"}}, {"plate.msh": ""}, "plate.msh"),
    "a solid": ({"mesh": {"step": "plate.stp"}}, {"plate.stp": ""}, "plate.stp"),
    "an included mesh": ({"mesh": {"file": "all.inp"}}, {"all.inp": "*NODE\n*INCLUDE, INPUT=sub/bolts.inp\n", "sub/bolts.inp": ""},
                         "sub/bolts.inp"),
    "one included by that": ({"mesh": {"file": "all.inp"}}, {
        "all.inp": "*Include,input = 'sub/bolts.inp'\r\n", "sub/bolts.inp": "*INCLUDE, INPUT=nut.inp", "sub/nut.inp": ""}, "sub/nut.inp"),
    "a part's mesh": ({"parts": [{"mesh": {"file": "a.msh"}}, {"mesh": {"file": "b.msh"}}]}, {"a.msh": "", "b.msh": ""}, "b.msh"),
    "temperatures": ({"loads": [{"temperature": {"file": "warm.csv"}}]}, {"warm.csv": ""}, "warm.csv"),
    "a matrix": ({"parts": [{"matrix": {"stiffness": "k.mtx", "nodes": "n.csv"}}]}, {"k.mtx": "", "n.csv": ""}, "k.mtx"),
    "a matrix's nodes": ({"parts": [{"matrix": {"stiffness": "k.mtx", "nodes": "n.csv"}}]}, {"k.mtx": "", "n.csv": ""}, "n.csv"),
    "a matrix's loads": ({"parts": [{"matrix": {"loads": ["f.mtx", "g.mtx"]}}]}, {"f.mtx": "", "g.mtx": ""}, "g.mtx"),
    "facets": ({"parts": [{"program": {"run": "solve.sh", "facets": "faces.csv"}}]}, {"solve.sh": "", "faces.csv": ""}, "faces.csv"),
    "a deck": ({"parts": [{"deck": {"calculix": "pump.inp"}}]}, {"pump.inp": ""}, "pump.inp"),
    "a deck's matter": ({"parts": [{"deck": {"calculix": "pump.inp"}}]}, {
        "pump.inp": "*MATERIAL, NAME=STEEL\n  *INCLUDE,INPUT=steel.mat\n", "steel.mat": ""}, "steel.mat"),
    "a deck's loads": ({"parts": [{"deck": {"loads": ["step.txt"]}}]}, {"step.txt": "*INCLUDE, INPUT=forces.txt", "forces.txt": ""},
                       "forces.txt"),
    "a program": ({"parts": [{"program": {"run": "solve.sh"}}]}, {"solve.sh": ""}, "solve.sh"),
    "a program's module": ({"parts": [{"program": {"run": "solve.py"}}]}, {"solve.py": "from model import K", "model.py": ""}, "model.py"),
    "an argument": ({"parts": [{"program": {"run": "solve.sh", "arguments": ["-n", "k.npy"]}}]}, {"solve.sh": "", "k.npy": ""}, "k.npy"),
    "an argument's value": ({"parts": [{"program": {"arguments": ["--table=k.npy"]}}]}, {"k.npy": ""}, "k.npy"),
    "a form": ({"blackbox": {"form": "matter.idp"}}, {"matter.idp": ""}, "matter.idp"),
    "what a form includes": ({"blackbox": [{"form": "matter.txt"}]}, {
        "matter.txt": '// matter\ninclude "sub/law.idp"\n', "sub/law.idp": 'include "constants.idp"', "constants.idp": ""},
        "constants.idp"),
    "a solver": ({"blackbox": {"code": "mine.py:Solver"}}, {"mine.py": ""}, "mine.py"),
    "a solver's package": ({"blackbox": {"code": "mine.py"}}, {"mine.py": "import os, laws.creep as creep\n", "laws/creep.py": ""},
                           "laws/creep.py"),
    "a module beside": ({"blackbox": {"code": "mine.py"}}, {"mine.py": "    from . import (law, other)\n", "law.py": ""}, "law.py"),
}


@pytest.mark.parametrize("case", FILES)
def test_a_changed_file_is_another_problem(tmp_path, monkeypatch, case):
    """Whatever file a configuration names, and whatever is read with it: which one has changed is said."""
    named, files, changed = FILES[case]
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = problem_of(named)
    for name in files:
        (tmp_path / name).touch()
    assert problem_of(named) == before, "written anew as it was: the same problem"
    with open(changed, "a") as file:
        file.write("2")
    told, = differences(before, problem_of(named))
    assert changed in told and "another one" in told


def test_a_solver_in_a_module_is_known_by_its_file():
    known = problem_of({"blackbox": {"code": "orchestrator.blackbox.codes.template:Solver"}})["blackbox.code"]
    assert known.startswith("content of template.py:Solver: ")


# ---- whole runs ------------------------------------------------------------------------------------------


def loaded(tmp_path, **changes):
    """A configuration from a file, as ``run`` wants it."""
    path = tmp_path / "case.yaml"
    path.write_text(json.dumps({
        "name": "case", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "output": {"figures": False}, "method": {"tolerance": {"law": 1e-4}}, **PRESSED, **changes}))
    return load_config(path)


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Displacements and numbers of the iterations of a run that nothing disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run(loaded(folder), output=folder / "out", quiet=True) == 0
    return np.load(folder / "out" / "fields.npz")["displacement"], read_history(folder / "out")["iteration"]


def same_result(folder, undisturbed):
    displacement, iterations = undisturbed
    np.testing.assert_allclose(np.load(folder / "fields.npz")["displacement"], displacement, rtol=0, atol=1e-15)
    assert np.array_equal(read_history(folder)["iteration"], iterations)


@pytest.mark.long
def test_a_converged_run_outlives_its_writing(tmp_path, undisturbed):
    """Fields that cannot be written: told, the checkpoint stays, and ``resume`` does nothing but write."""
    out, case = tmp_path / "out", loaded(tmp_path)

    def spoil(writer, event, told=HistoryWriter.iteration):
        told(writer, event)
        (out / "fields").write_text("a file where a folder should be")

    with pytest.MonkeyPatch.context() as patch, pytest.raises(InputError, match="cannot write"):
        patch.setattr(HistoryWriter, "iteration", spoil)
        run(case, output=out, quiet=True)
    assert "--resume writes them" in summary_of(out)["stop_reason"] and (out / "checkpoint").is_dir()
    before = read_history(out)
    (out / "fields").unlink()
    assert run(case, output=out, resume=True, quiet=True) == 0
    assert summary_of(out)["converged"] and not (out / "checkpoint").exists()
    after = read_history(out)
    assert all(np.array_equal(before[name], after[name], equal_nan=True) for name in before), "no iteration more"
    same_result(out, undisturbed)


@pytest.mark.parametrize("name", ["fields", "figures", "checkpoint"])
def test_a_file_where_a_folder_should_be(tmp_path, name):
    """Told before anything is computed."""
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match=f"{name} is no folder"):
        run(loaded(tmp_path), output=tmp_path, quiet=True)
    assert (tmp_path / name).read_text() == "mine" and not (tmp_path / "history.csv").exists()


@pytest.fixture
def disk(tmp_path):
    """A small file system of its own, and what fills it but for some bytes."""
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", place],
                                      capture_output=True).returncode:
        pytest.skip("no small disk can be mounted here")

    def fill(left):
        (place / "ballast").write_bytes(b"")
        size = os.statvfs(place)
        (place / "ballast").write_bytes(b"x" * max(0, size.f_bavail * size.f_frsize - left))

    try:
        yield place, fill
    finally:
        subprocess.run(["umount", "-l", place], check=True)


@pytest.mark.parametrize("left", quick([16, 60, 120, 200, 300, 450, 700], 300))
def test_a_full_disk_loses_nothing_that_has_converged(tmp_path, disk, left, undisturbed):
    """However many kB are left: the run iterates to its end, and with room again ``resume`` has the same result."""
    place, fill = disk
    case = loaded(tmp_path)
    fill(left * 1024)
    try:
        code = run(case, output=place / "out", quiet=True)
    except InputError as error:
        code, told = error.exit_code, str(error)
        assert "disk full" in told and "--resume" in told
    assert code in (0, 2)
    (place / "ballast").unlink()
    if code:
        assert run(case, output=place / "out", resume=True, quiet=True) == 0
    same_result(place / "out", undisturbed)
    assert summary_of(place / "out")["converged"] and not (place / "out" / "checkpoint").exists()


@pytest.mark.parametrize("after", [late(False), True], ids=["before", "after"])
@pytest.mark.parametrize("kind", [CheckpointWriter, HistoryWriter])
@pytest.mark.long
def test_interrupted_while_an_iteration_is_noted(tmp_path, monkeypatch, kind, after):
    """One record has the iteration, the other one perhaps not: resumed, none is missing in the history, none twice."""
    case, out, note = loaded(tmp_path), tmp_path / "out", kind.iteration

    def interrupted(self, event):
        if after:
            note(self, event)
        if event.iteration == 4:
            raise KeyboardInterrupt
        if not after:
            note(self, event)

    with monkeypatch.context() as patch:
        patch.setattr(kind, "iteration", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(case, output=out, quiet=True)
    assert run(case, output=out, resume=True, quiet=True) == 0
    iterations = read_history(out)["iteration"].tolist()
    assert len(iterations) > 5 and iterations == list(range(1, len(iterations) + 1))


@pytest.mark.parametrize("kind", quick([MemoryError, SystemError, ZeroDivisionError], MemoryError))
def test_any_error_leaves_what_has_been_computed(tmp_path, monkeypatch, kind):
    """One message, the traceback in a file, history, summary and checkpoint; then it goes on."""
    from orchestrator.method.local_stage import LawStage

    case, out, stage, calls = loaded(tmp_path), tmp_path / "out", LawStage.__call__, []

    def failing(self, fields):
        calls.append(1)
        if len(calls) == 9:
            raise kind("out of the blue")
        return stage(self, fields)

    monkeypatch.setattr(LawStage, "__call__", failing)
    with pytest.raises(InternalError, match="out of the blue") as caught:
        run(case, output=out, quiet=True)
    assert caught.value.exit_code == (3 if kind is MemoryError else 1) and str(out / "traceback.txt") in str(caught.value)
    assert ("too little memory" in str(caught.value)) == (kind is MemoryError)
    assert "failing" in (out / "traceback.txt").read_text()
    summary = summary_of(out)
    assert not summary["converged"] and summary["iterations"] == 8 and "out of the blue" in summary["stop_reason"]
    assert len(read_history(out)["iteration"]) == 8
    assert run(case, output=out, resume=True, quiet=True) == 0


@pytest.mark.parametrize("megabytes", quick([300, 700, 1100], 1100))
def test_a_limit_below_what_any_run_takes_is_told_at_once(tmp_path, megabytes):
    """OpenBLAS would wait for ever for its buffers."""
    child = begin(sys.executable, "-m", "orchestrator", "run", loaded(tmp_path).source.file, "--output", str(tmp_path / "out"),
                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20,) * 2))
    _, told = child.communicate(timeout=60)
    assert child.returncode == 2 and "addresses for a process" in told and "ulimit" in told and not (tmp_path / "out").exists()


@pytest.mark.parametrize("error, lacks", [
    (MemoryError(), True), (OSError(errno.ENOMEM, "Cannot allocate memory"), True), (RuntimeError("can't start new thread"), True),
    (ImportError("libvtkCommonCore.so: failed to map segment from shared object"), True), (Exception("std::bad_alloc"), True),
    (OSError(errno.ENOENT, "no such file"), False), (RuntimeError("out of the blue"), False), (ImportError("no module named x"), False)])
def test_a_want_of_memory_is_told_as_such(error, lacks, capsys):
    """By whatever it was noticed, also behind another error; outside runs too, with exit code 3."""
    def action():
        try:
            raise error
        except Exception as cause:
            raise OSError("could not find shared object") from cause

    assert lacks_memory(error) == lacks
    with pytest.raises(SystemExit if lacks else OSError) as caught:
        guarded(action)
    if lacks:
        assert caught.value.code == 3 and "too little memory" in capsys.readouterr().err


def test_one_run_in_a_folder(tmp_path):
    """The second is told which process holds it; a lock whose holder is dead is none."""
    folder = ResultsFolder(tmp_path)
    with locked(folder):
        with pytest.raises(InputError, match=f"process {os.getpid()} on "):
            with locked(folder):
                pass
    (tmp_path / ".orchestrator" / "holder.json").write_text(json.dumps({"pid": 1, "host": "elsewhere", "since": "long ago"}))
    with locked(folder):
        pass


def aged(folder: Path) -> None:
    """Make a checkpoint one of an earlier version."""
    problem = json.loads((folder / "problem.json").read_text()) | {"version of checkpoints": "7"}
    (folder / "problem.json").write_text(json.dumps(problem))
    for file in folder.glob("iteration-*.npz"):
        with np.load(file) as kept:
            arrays = dict(kept)
        about = json.loads(bytes(arrays["about"])) | {"problem": digest_of(problem)}
        np.savez(file, **arrays | {"about": np.frombuffer(json.dumps(about).encode(), np.uint8)})


def test_resumed_with_another_file(tmp_path, monkeypatch):
    """Refused, and the message says which file it was; with the old one it goes on."""
    (tmp_path / "warm.csv").write_text("".join(f"{x}, {y}, {z}, 20.5\n" for x, y, z in itertools.product(
        (0, 0.5, 1, 1.5, 2), (0, 0.5, 1), (0, 0.5, 1, 1.5, 2))))
    case = loaded(tmp_path, materials=[{"young": 200e3, "poisson": 0.3, "expansion": 1e-5}], loads=[{"temperature": {"file": "warm.csv"}}])
    note, out, before = CheckpointWriter.iteration, tmp_path / "out", (tmp_path / "warm.csv").read_text()

    def interrupted(self, event):
        note(self, event)
        if event.iteration == 4:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(CheckpointWriter, "iteration", interrupted)
        run(case, output=out, quiet=True)
    (tmp_path / "warm.csv").write_text(before.replace("20.5", "60.5"))
    with pytest.raises(InputError, match=r"another problem: loads\[0\].temperature.file \(content of warm.csv\) is another one"):
        run(case, output=out, resume=True, quiet=True)
    (tmp_path / "warm.csv").write_text(before)
    shutil.copytree(out, old := tmp_path / "old")
    aged(old / "checkpoint")
    with pytest.raises(InputError, match=f"version of checkpoints: 7, now {VERSION}"):
        run(case, output=old, resume=True, quiet=True)
    assert run(case, output=out, resume=True, quiet=True) == 0


def test_killed_before_the_first_iteration(tmp_path):
    """There is nothing to go on from: ``resume`` begins at the beginning."""
    out, case = tmp_path / "out", loaded(tmp_path)

    class Killed(BaseException):
        pass

    def killed(*_, **__):
        raise Killed

    with pytest.MonkeyPatch.context() as patch, pytest.raises(Killed):
        patch.setattr("orchestrator.solving.build_scene", killed)
        run(case, output=out, quiet=True)
    assert run(case, output=out, resume=True, quiet=True) == 0
