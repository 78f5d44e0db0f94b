"""Runs over MPI, started by the real mpiexec: the same as one process, and all gone when one rank fails."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import pytest
from processes import begin, gone
from ranks_case import CASES, PAIRED, found, refined

from orchestrator import folders
from orchestrator.config.load import load_config
from orchestrator.parallel.team import SHARED, launched
from orchestrator.processes import without_launcher
from orchestrator.results.solution import Solution
from orchestrator.run import run as run_here
from orchestrator.results.history import read_history
from orchestrator.results.checkpoint import load_checkpoint
from orchestrator.results.fingerprint import digest_of
from orchestrator.results.summary.summary import read_summary

pytestmark = pytest.mark.xdist_group("ranks")  # more ranks than cores already; what one process finds is found once
HERE = Path(__file__).parent
BESIDE_PYTHON = Path(sys.executable).with_name("mpiexec")
MPIEXEC = str(BESIDE_PYTHON if BESIDE_PYTHON.exists() else shutil.which("mpiexec"))
# More ranks than cores, and maybe as root: what Open MPI refuses unless told.
ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
           "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
SECONDS = 600  # for a run that hangs, on a slow machine too
# Relaxed so little that it goes on for thousands of iterations.
ENDLESS = """
name: endless
mesh: {box: {size: [8, 1, 1], cells: [16, 2, 2]}}
subdomains: {slices: {axis: x, count: 8}}
materials: [{young: 200e3, poisson: 0.3}]
boundary:
  - {on: xmin, displacement: [0, 0, 0]}
  - {on: xmax, traction: [10, 0, 5]}
method:
  {macro: {strategy: none}, acceleration: none, relaxation: 0.01, tolerance: {indicator: 1.0e-20},
   max_iterations: 100000}
output: {fields: false, figures: false}
"""


@pytest.fixture
def temporary(tmp_path):
    """A temporary folder of the run's own, in which nothing may be left."""
    folder = tmp_path / "t"
    folder.mkdir()
    yield folder
    assert [p.name for p in folder.iterdir() if p.name.startswith("orchestrator-")] == []


def environment(folder: Path | None = None) -> dict[str, str]:
    paths = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, **ALLOWED, "PYTHONPATH": paths, "TERM": "dumb"} | ({"TMPDIR": str(folder)} if folder else {})


def start(ranks: int, *command: str, folder: Path | None = None) -> subprocess.Popen:
    return begin(MPIEXEC, "-n", str(ranks), sys.executable, *command, env=environment(folder), stdin=subprocess.DEVNULL)


def orchestrate(ranks: int, *arguments: str, folder: Path | None = None) -> subprocess.Popen:
    return start(ranks, "-m", "orchestrator", "run", *map(str, arguments), "--quiet", folder=folder)


@cache
def alone(case: str, nudge: float = 0.0) -> dict[str, np.ndarray]:
    return found(case, nudge=nudge)


def rounding(case: str, name: str) -> float:
    """What rounding of forces may change: 1e-13 of the largest (sums over hundreds of pairs, tens of iterations), times the
    scene's own condition, as forces of 1e-10 of the largest show it."""
    nudge = 1e-10 * np.abs(alone(case)["reactions"]).max()
    return 1e-13 / 1e-10 * float(np.abs(np.subtract(alone(case, nudge)[name], alone(case)[name])).max())


def subdomains(case: str) -> int:
    """How many a case has, at least."""
    made = CASES[case]
    cut = made["subdomains"]
    return cut["metis"] if "metis" in cut else len(made["parts"]) if "parts" in made else np.prod(cut["grid"]) if "grid" in cut else 4


FEW = ["leaps between parts", "pushed off", PAIRED]  # beside what ``tests/public/test_same`` solves


@pytest.mark.parametrize("ranks, few", [(2, True), (2, False), (3, False), (4, False)])
@pytest.mark.long
def test_ranks_find_what_one_process_finds(ranks, few, tmp_path):
    several = [case for case in CASES if subdomains(case) >= 4]  # one for each rank
    three, four = several[1::4], several[::2]
    two = [case for case in CASES if case not in three + four and (case in FEW) == few]
    names = {2: two, 3: three, 4: four}[ranks]  # each by some number of ranks
    meshes = {2: [] if few else ["refined contact"], 3: ["refined bonds"], 4: []}[ranks]
    run = start(ranks, str(HERE / "ranks_case.py"), str(tmp_path), *names, *[PAIRED] * few, *meshes)
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 0, errors
    for case in names:
        together = dict(np.load(tmp_path / f"{case}.npz"))
        assert together.pop("ranks") == ranks
        for name, expected in alone(case).items():
            if name == "sweeps":  # how many the error takes hangs on sums that round otherwise
                assert abs(together[name] - expected) <= 2, case
            elif name in ("status", "iterations", "weakened", "joined", "told"):
                assert np.array_equal(together[name], expected), (case, name)
            elif name == "limit":  # an interior point method ends as near
                assert np.abs(together[name] - expected).max() <= 1e-6, case
            elif "shifts" in name or name in ("places", "shares"):  # they are, or hang on an error that is, solved for to a hundredth
                assert np.abs(together[name] - expected).max() <= 0.02 * np.abs(expected).max(), (case, name)
            else:
                off, size = np.abs(together[name] - expected).max(), np.abs(expected).max()
                if name.startswith("probe") and len(expected) in (6, 8):  # forces that may balance to rounding
                    size = max(size, np.abs(alone(case)["reactions"]).max())
                # where springs of stabilisation alone hold a grain, rounding of 1e-16 is ten million times larger
                assert off <= 1e-10 * size or off <= rounding(case, name), (case, name, off)
    for name in meshes:
        same_meshes(name, tmp_path, ranks)
    if few:
        twice, expected = Solution.read(tmp_path / PAIRED), alone("parts that slide on")
        assert twice.converged and "paired anew" in twice.summary["warnings"][0]
        assert np.abs(twice.displacement - expected["displacement"]).max() <= 1e-9 * np.abs(expected["displacement"]).max()


@pytest.mark.parametrize("face, code", [("xmax", 0), ("wall", 2)])
@pytest.mark.long
def test_one_of_several_ranks_checks(face, code, tmp_path):
    """What all would say, once; what is wrong, too."""
    settings = tmp_path / "endless.yaml"
    settings.write_text(ENDLESS.replace("xmax", face))
    check = start(2, "-m", "orchestrator", "check", str(settings))
    said, complaint = check.communicate(timeout=SECONDS)
    assert check.returncode == code, complaint
    assert (said.count("OK: "), complaint.count("problem in the input")) == ((1, 0) if code == 0 else (0, 1))


def same_meshes(name: str, folder: Path, ranks: int) -> None:
    """A refined run on ranks is the one of a single process: the sizes of all meshes, errors, and their fields."""
    refined(name, folder / "alone")
    one, two = (Solution.read(folder / run) for run in ("alone", name))
    meshes = [solution.summary["accuracy"]["meshes"] for solution in (one, two)]
    assert len(meshes[0]) == len(meshes[1]) > 1
    for ours, theirs in zip(*meshes):
        assert [ours[key] for key in ("elements", "nodes", "refined")] == [theirs[key] for key in ("elements", "nodes", "refined")]
        assert theirs["error"] == pytest.approx(ours["error"], rel=1e-9)
        assert theirs["numbers"] == pytest.approx(ours["numbers"], rel=1e-8, abs=1e-8 * max(map(abs, ours["numbers"].values())))
    cells = one.fields.discretisation_error
    assert two.fields.discretisation_error == pytest.approx(cells, rel=1e-8)
    drawn = meshio.read(folder / name / "fields/step_0001.vtu").cell_data["discretisation_error"][0]
    assert (drawn**2).sum() == pytest.approx((cells**2).sum())


def processes(run: subprocess.Popen, settings: Path) -> dict[int, int]:
    """Rank → process id."""
    result = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if str(settings) in (path / "cmdline").read_text() and int(path.name) != run.pid:
                entries = (path / "environ").read_text().split("\0")
                result[launched(dict(e.split("=", 1) for e in entries if "=" in e))[0]] = int(path.name)
        except OSError:
            pass
    return result


def children(pid: int) -> list[int]:
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has ended meanwhile
            found += map(int, (task / "children").read_text().split())
    return found


def iterating(run: subprocess.Popen, results: Path, count: int = 5) -> None:
    """Wait until some iterations are done."""
    while run.poll() is None:
        if (results / "history.csv").exists() and len(read_history(results)["iteration"]) >= count:
            return
        time.sleep(0.05)
    pytest.fail(f"it ended by itself: {run.communicate()[1]}")


def saved_iteration(results: Path) -> int:
    """The last one in the checkpoint; 0: none yet."""
    problem = json.loads((results / "checkpoint/problem.json").read_bytes())
    start = load_checkpoint(results, digest_of(problem), warn=lambda text: None)  # what is needed no more may go meanwhile
    return 0 if start is None else start.iteration


def goes_on(settings: Path, results: Path) -> None:
    """One process goes on where the ranks had to stop."""
    before = saved_iteration(results)
    loaded = load_config(settings, ["method.max_iterations=2"])
    assert run_here(loaded, output=results, resume=True, quiet=True) == 1
    assert read_history(results)["iteration"].tolist() == list(range(1, before + 3))


FAULTS = {
    "its code": (lambda rank: children(rank)[0], signal.SIGKILL, "killed by SIGKILL", 3),
    # mpiexec says so too, and may leave the others no time to: it kills them a moment later
    "the rank": (lambda rank: rank, signal.SIGKILL, "process rank 1", None),
}


def endless(ranks: int, folder: Path, temporary: Path) -> tuple[subprocess.Popen, Path, Path]:
    """A run that does not end, in its iterations; its settings and results."""
    settings, results = folder / "endless.yaml", folder / "results"
    settings.write_text(ENDLESS)
    run = orchestrate(ranks, settings, "--output", results, folder=temporary)
    iterating(run, results)
    return run, settings, results


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.long
def test_all_ranks_end_with_one(fault, tmp_path, temporary):
    victim, kind, message, code = FAULTS[fault]
    run, settings, results = endless(3, tmp_path, temporary)
    while run.poll() is None and saved_iteration(results) < 5:
        time.sleep(0.1)
    ranks = processes(run, settings)
    assert sorted(ranks) == [0, 1, 2]
    codes = [code for rank in ranks.values() for code in children(rank)]
    assert len(codes) >= 3
    os.kill(victim(ranks[1]), kind)
    assert gone([*ranks.values(), *codes])
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == code or code is None and run.returncode != 0
    assert errors.count(message) == 1 and "Traceback" not in errors, errors
    assert fault == "the rank" or "on rank 1 (" in errors, errors
    assert saved_iteration(results) >= 5 <= len(read_history(results)["iteration"])
    if fault == "the rank":
        goes_on(settings, results)
        folders.sweep(str(temporary))  # as whoever starts next does, where mpiexec has left the others no time to


@pytest.mark.long
def test_an_interrupted_run_goes_on(tmp_path, temporary):
    run, settings, results = endless(2, tmp_path, temporary)
    run.send_signal(signal.SIGUSR2)  # mpiexec forwards it to all, and ends as they do
    _, errors = run.communicate(timeout=SECONDS)
    assert "Traceback" not in errors and run.returncode == 130
    before = read_summary(results)
    assert before["stop_reason"] == "interrupted"
    more = "--resume", "--set", "method.max_iterations=2"
    run = orchestrate(3, settings, "--output", results, *more, folder=temporary)
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 1, errors
    iterations = read_history(results)["iteration"]
    assert before["iterations"] - 1 <= iterations[-1] - 2 <= before["iterations"]
    assert np.array_equal(iterations, np.arange(1, len(iterations) + 1))
    run = orchestrate(2, settings, "--output", results, "--resume", folder=temporary)
    iterating(run, results, len(iterations) + 1)
    ranks = list(processes(run, settings).values())
    shared = [path for pid in ranks for path in Path(SHARED).glob(f"orchestrator-*-{pid}-*")]
    assert len(shared) == len(ranks) == 2 and all(list(path.glob("*segment*")) for path in shared), "what they share is in folders of theirs"
    theirs = [*ranks, *(child for pid in ranks for child in children(pid))]  # codes hold the folders' locks until they have ended
    for pid in [run.pid, *ranks]:
        os.kill(pid, signal.SIGKILL)
    run.communicate(timeout=SECONDS)
    assert gone(theirs, SECONDS) and saved_iteration(results) > iterations[-1] - 2
    end = time.monotonic() + SECONDS
    while any(path.exists() for path in [*shared, *temporary.glob("orchestrator-*")]) and time.monotonic() < end:
        folders.sweep(SHARED)  # as the next run does
        folders.sweep(str(temporary))
    assert not any(path.exists() for path in shared)


PARTITIONS = ENDLESS.replace("{box: {size: [8, 1, 1], cells: [16, 2, 2]}}", f"{{file: {HERE}/meshes/bar_*.msh}}").replace(
    "{slices: {axis: x, count: 8}}", "groups").replace("xmin", "wall").replace("xmax", "end")


PARTS = ENDLESS.replace("mesh: {box: {size: [8, 1, 1], cells: [16, 2, 2]}}", "parts:" + "".join(
    f"\n  - {{name: p{i}, mesh: {{box: {{size: [1, 1, 1], cells: [2, 2, 2]}}}}, move: {{translate: [{i}, 0, 0]}}}}" for i in range(6))).replace(
    "{slices: {axis: x, count: 8}}", "groups").replace("xmin", "p0/xmin").replace("xmax", "p5/xmax")


@pytest.mark.parametrize("endless", [ENDLESS, PARTITIONS, PARTS], ids=["box", "partitions", "parts"])
@pytest.mark.long
def test_ranks_go_on_with_what_one_process_has_begun(endless, tmp_path, temporary):
    settings, results = tmp_path / "endless.yaml", tmp_path / "results"
    settings.write_text(endless)
    few = "--output", results, "--set", "method.max_iterations=3"
    for ranks in (1, 3, 1):
        run = orchestrate(ranks, settings, *few, *["--resume"] * (results / "checkpoint").exists(), folder=temporary)
        _, errors = run.communicate(timeout=SECONDS)
        assert run.returncode == 1, errors
    assert np.array_equal(read_history(results)["iteration"], np.arange(1, 10))


@pytest.mark.long
def test_a_node_without_the_code_is_named(tmp_path, temporary):
    """Of three ranks one finds no FreeFEM: all end, and say whose machine it is."""
    settings = tmp_path / "endless.yaml"
    settings.write_text(ENDLESS)
    ours = sys.executable, "-m", "orchestrator", "run", str(settings), "--output", str(tmp_path / "results"), "--quiet"
    run = begin(MPIEXEC, "-n", "1", *ours, ":", "-n", "1", "env", "PATH=/nowhere", *ours, ":", "-n", "1", *ours,
                env=environment(temporary), stdin=subprocess.DEVNULL)
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 2 and errors.count("on rank 1 (") == errors.count("no FreeFem++ in the path") == 1, errors
    assert "Traceback" not in errors


@pytest.mark.parametrize("right, wrong, told", [
    ("200e3", "-1", "young"), ("count: 8", "count: 2", "3 ranks for 2 subdomains")])
@pytest.mark.long
def test_bad_input_is_told_once(right, wrong, told, tmp_path, temporary):
    settings = tmp_path / "wrong.yaml"
    settings.write_text(ENDLESS.replace(right, wrong))
    run = orchestrate(3, settings, "--output", tmp_path / "results", folder=temporary)
    _, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 2
    assert errors.count("1 problem in the input") == 1 and told in errors and "wrong.yaml:" in errors, errors


# Rank 0 fails at once; rank 1 swallows the interrupt, as what goes on while modules are imported may do.
SWALLOWED = """
import time
from orchestrator.errors import InputError, Problem
from orchestrator.launch import join
from orchestrator.parallel.team import Elsewhere
team = join()
try:
    with team.together():
        if team.rank == 0:
            raise InputError(Problem((), "bad", "good", "mend"))
        try:
            time.sleep(600)
        except Elsewhere:
            pass
        team.share(None)
except Elsewhere as error:
    print(f"rank {team.rank} left: {error}")
except InputError:
    pass
"""


def test_a_failure_that_an_import_swallows_is_heard():
    output, errors = start(2, "-c", SWALLOWED).communicate(timeout=SECONDS)
    assert "rank 1 left: rank 0: " in output and "bad" in output and "Traceback" not in errors


# Sums and maxima of more numbers than are gathered in one message.
MANY = """
import numpy as np
from orchestrator.launch import join
team = join()
with team.together():
    own = np.arange(40000.0) * (1 if team.rank == 0 else -1)
    own[7] = np.nan if team.rank else 0.0
    (sums,), most = team.both([own], own)
    alone = team.max(*own)
    right = np.where(np.arange(40000) == 7, np.nan, np.arange(40000.0))
    assert np.array_equal(most, right, equal_nan=True) and np.array_equal(alone, right, equal_nan=True)
    assert np.isnan(sums[7]) and not np.delete(sums, 7).any()
    print(f"rank {team.rank} agrees")
"""


def test_sums_and_maxima_of_many_numbers():
    output, errors = start(2, "-c", MANY).communicate(timeout=SECONDS)
    assert sorted(output.split("\n"))[-2:] == ["rank 0 agrees", "rank 1 agrees"], errors


def test_ranks_are_known_by_their_launchers_variables():
    """And a code that a rank starts sees nothing of them."""
    assert launched({"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_RANK": "2", "PMI_SIZE": "x"}) == (2, 4)
    assert launched({"PMI_SIZE": "3", "PMI_RANK": "0"}) == (0, 3)
    assert launched({"SLURM_STEP_NUM_TASKS": "8", "PMIX_RANK": "7"}) == (7, 8)
    assert launched({"SLURM_STEP_NUM_TASKS": "8", "SLURM_PROCID": "0"}) == (0, 1)  # a batch script is no rank
    assert without_launcher({"PMIX_RANK": "1", "OMPI_X": "", "HOME": "/"}) == {"HOME": "/"}
