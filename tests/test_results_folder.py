"""Folder, history, checkpoint: what is on disk is whole, and what goes wrong is said."""

import json
import os
import shutil
import subprocess
from contextlib import closing

import numpy as np
import pytest
import results_case as case

from orchestrator.errors import BAD_INPUT, InputError
from orchestrator.method.events import HISTORY_COLUMNS, Finished
from orchestrator.results.fields.files import write_fields
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.results.checkpoint import begun
from orchestrator.results.history import HistoryWriter, read_history, write_history
from orchestrator.results.summary.summary import jsonable, write_summary


def the_problem(caught):
    assert caught.value.exit_code == BAD_INPUT
    (problem,) = caught.value.problems
    assert problem.path == DIRECTORY_KEY and problem.found and problem.expected and problem.cure
    return problem


def leftovers(path):
    return [p for p in path.rglob("*") if p.name.endswith("-part")]


@pytest.fixture
def tiny_disk(tmp_path):
    """A file system of 128 kB of its own."""
    if os.name != "posix" or os.geteuid() != 0:
        pytest.skip("mounting a small disk needs root")
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", disk], capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"no small disk can be mounted here: {mounted.stderr.strip()}")
    try:
        yield disk
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


def fill(disk):
    size = os.statvfs(disk)
    free = size.f_bavail * size.f_frsize
    (disk / "ballast").write_bytes(b"x" * free)


def test_folder_below_a_file_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    for place in ("file", "file/below"):
        with pytest.raises(InputError) as caught:
            ResultsFolder(tmp_path / place)
        assert "cannot write" in the_problem(caught).found


def test_read_only_folder_is_an_input_error(tiny_disk):
    subprocess.run(["mount", "-o", "remount,ro", tiny_disk], check=True)
    for place in (tiny_disk, tiny_disk / "new"):
        with pytest.raises(InputError) as caught:
            ResultsFolder(place)
        assert "Read-only" in the_problem(caught).found


def test_failed_writing_keeps_the_old_file(tmp_path):
    folder = ResultsFolder(tmp_path)
    folder.write("summary.json", "old")
    with pytest.raises(KeyboardInterrupt):
        with folder.replacing("summary.json") as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt
    assert (tmp_path / "summary.json").read_text() == "old"
    assert not leftovers(tmp_path)


RUN = ("summary.json", "fields.npz", "fields/step_0001.vtu", "figures/time.png", "report.md", "table.csv")
THEIRS = ("notes.txt", "figures/holiday.png", "fields/measured.vtu", "report.html", "checkpoint/notes.log", "fields/step_a.vtu",
          ".mine.part", "parts/pump/measured.csv")


def left_in(folder):
    """Names of all files but the list of them."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if not p.is_dir()} - {".orchestrator/manifest"}


def a_run_in(path, names=RUN):
    folder = ResultsFolder(path)
    for name in names:
        folder.write(name, f"{name} of a run")
    return folder


def put(path, names=THEIRS):
    for name in names:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_text("mine")


@pytest.mark.parametrize("copied", [False, True])
def test_a_fresh_run_removes_what_runs_have_written_and_nothing_else(tmp_path, copied):
    """Also in a folder that was copied since, where files have other times."""
    place, folder = tmp_path / "run", a_run_in(tmp_path / "run")
    put(place)
    with folder.of_part("shaft") as own:
        (own / "below").mkdir()
        (own / "below" / "stress.csv").write_text("of the program")
    if copied:
        shutil.copytree(place, tmp_path / "copy", copy_function=shutil.copyfile)
        place = tmp_path / "copy"
    ResultsFolder(place).clear()
    assert left_in(place) == set(THEIRS) and all((place / name).read_text() == "mine" for name in THEIRS)


@pytest.mark.parametrize("name", ["summary.json", "history.csv", "fields.npz", "fields/step_0001.vtu", "fields/interface_0002.vtu",
                                  "figures/time.png", "checkpoint/iteration-000001.npz", "checkpoint/reserve", "extremes.csv"])
@pytest.mark.parametrize("kind", ["before any run", "changed since", "a link", "a folder"])
def test_files_that_stand_in_the_way_are_refused(tmp_path, name, kind):
    """Told before anything is removed, and what writes there all the same is refused as well."""
    folder, file = ResultsFolder(tmp_path / "run"), tmp_path / "run" / name
    if kind == "changed since":
        a_run_in(tmp_path / "run", {*RUN, name})
    put(tmp_path, ["elsewhere"])
    file.parent.mkdir(exist_ok=True)
    if kind == "a link":
        file.symlink_to(tmp_path / "elsewhere")
    elif kind == "a folder":
        file.mkdir()
    else:
        file.write_text("mine")
    before = left_in(tmp_path)
    for act in (folder.check_free, folder.clear, lambda: folder.write(name, "of a run")):
        with pytest.raises(InputError) as caught:
            act()
        assert name in the_problem(caught).found and "rename" in the_problem(caught).cure
    folder.remove("*")
    assert os.path.lexists(file) and (tmp_path / "elsewhere").read_text() == "mine"
    assert kind == "changed since" or left_in(tmp_path) == before


def test_files_that_links_lead_to_stay(tmp_path):
    """A folder of the run's may be a link; what is there is written, and not removed."""
    put(tmp_path, ["elsewhere/fields/step_0009.vtu"])
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "fields").symlink_to(tmp_path / "elsewhere" / "fields")
    with pytest.raises(InputError, match="step_0009"):
        ResultsFolder(tmp_path / "run").check_free()
    (tmp_path / "elsewhere" / "fields" / "step_0009.vtu").unlink()
    for content in ("first", "second"):
        folder = ResultsFolder(tmp_path / "run")
        folder.clear()
        folder.write("fields/step_0001.vtu", content)
        assert (tmp_path / "elsewhere" / "fields" / "step_0001.vtu").read_text() == content


@pytest.mark.parametrize("line", ["half", "above", "elsewhere", "rubbish"])
def test_a_spoilt_manifest_gives_nothing_away(tmp_path, line):
    """Half a line hides no other one; no line reaches out of the folder."""
    folder = a_run_in(tmp_path / "run")
    put(tmp_path, ["mine.txt"])
    about = (tmp_path / "mine.txt").stat()
    entry = {"size": about.st_size, "time": about.st_mtime_ns, "hash": None}
    text = {"half": '\n{"file": "report', "above": json.dumps({"file": "../mine.txt", **entry}),
            "elsewhere": json.dumps({"file": str(tmp_path / "mine.txt"), **entry}), "rubbish": '\n[1]\n7\n\x00'}[line]
    with open(tmp_path / "run" / ".orchestrator" / "manifest", "a") as file:
        file.write("\n" + text)
    folder.write("fields.npz", "new")
    folder.clear()
    assert left_in(tmp_path) == {"mine.txt"} | ({"run/.orchestrator/manifest"})


def test_killed_while_it_wrote(tmp_path):
    """What a run was writing, and what grows, is known as its own."""
    folder = a_run_in(tmp_path)
    writer = HistoryWriter(folder)
    writer.iteration(case.iteration(1))
    begun(folder)
    put(tmp_path, [*THEIRS, "checkpoint/iteration-000001.npz"])
    (tmp_path / "fields" / ".step_0002.vtu.orchestrator-part").write_text("half")
    ResultsFolder(tmp_path).clear()
    assert left_in(tmp_path) == set(THEIRS)


@pytest.mark.parametrize("what", ["fields", "figures", "summary", "history"])
def test_full_disk(tiny_disk, what):
    folder = ResultsFolder(tiny_disk / "run")
    mesh = case.box_mesh((12, 6, 6))
    writer = HistoryWriter(folder)
    writer.iteration(case.iteration(1))
    (folder / "figures").mkdir()
    folder.write("summary.json", "{}")
    before = {p: p.read_bytes() for p in (folder / "summary.json", folder / "history.csv")}
    if what != "fields":  # those do not fit anyway
        fill(tiny_disk)

    with pytest.raises(InputError) as caught:
        if what == "fields":
            write_fields(folder, case.fields(mesh))
        elif what == "figures":
            write_figures(folder, case.summary(), case.history())
        elif what == "summary":
            write_summary(folder, case.summary())
        else:
            for i in range(2, 200):
                writer.iteration(case.iteration(i))  # a full disk does not end the iterations
            assert len(read_history(folder / "history.csv")["iteration"]) < 199
            before[folder / "history.csv"] = (folder / "history.csv").read_bytes()
            writer.complete()
    writer.close()
    problem = the_problem(caught)
    assert "disk full" in problem.found and "free" in problem.found and "--output" in problem.cure
    assert not leftovers(tiny_disk)
    assert all(path.read_bytes() == content for path, content in before.items())
    assert not list(tiny_disk.rglob("*.npz")) and not list(tiny_disk.rglob("*.png"))


def test_history_round_trip_and_every_line_at_once(tmp_path):
    folder = ResultsFolder(tmp_path)
    with closing(HistoryWriter(folder)) as writer:
        for i in range(1, 8):
            writer.iteration(case.iteration(i))
            assert len(read_history(tmp_path)["iteration"]) == i
        writer.finished(Finished(True, "converged", 7))
    read = read_history(tmp_path / "history.csv")
    assert list(read) == HISTORY_COLUMNS
    for name, column in case.history().items():
        np.testing.assert_array_equal(read[name], column)
    assert read["stick"].dtype.kind == "i"


def test_history_resumes_after_the_checkpoint(tmp_path):
    folder = ResultsFolder(tmp_path)
    write_history(folder, case.history(5))
    folder.manifest.claim(r"history\.csv")
    with open(tmp_path / "history.csv", "a") as file:
        file.write("6,11.0,0.")  # a killed run's last line
    with closing(HistoryWriter(folder, resume_after=3)) as writer:
        writer.iteration(case.iteration(4, sweeps=99.0))
    read = read_history(tmp_path)
    assert list(read["iteration"]) == [1, 2, 3, 4] and read["sweeps"][-1] == 99.0


@pytest.mark.parametrize("content", [None, "time,error\n1,2\n", "\x00"])
def test_foreign_history(tmp_path, content):
    if content is not None:
        (tmp_path / "history.csv").write_text(content)
    with pytest.raises(InputError) as caught:
        read_history(tmp_path)
    assert "history.csv" in the_problem(caught).found


def test_history_finds_its_lines_again(tmp_path):
    """Lines that found no room, or a file that somebody has removed, are written at the end."""
    folder = ResultsFolder(tmp_path)
    with closing(HistoryWriter(folder)) as writer:
        for i in range(1, 5):
            writer.iteration(case.iteration(i))
        (folder / "history.csv").unlink()
        writer.complete()
    np.testing.assert_array_equal(read_history(tmp_path)["iteration"], [1, 2, 3, 4])


@pytest.mark.parametrize("value", [np.float32("nan"), np.float64("inf"), np.array(np.nan), float("-inf")])
def test_what_is_no_number_is_null_in_json(value):
    assert jsonable({"a": [value]}) == {"a": [None]}
