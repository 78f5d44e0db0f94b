"""Whole runs: invariances, what they write, how they end, and what is left when they end badly."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from in_process import FREEFEM
from method_case import CLAMP, CUBES, METIS, close, config, method, solved
from pictures import pixels, share, shows_matter
from processes import begin, nothing_left, working_below
from typer.testing import CliRunner
from quick import quick

from orchestrator.cli import app
from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.method.events import HISTORY_COLUMNS
from orchestrator.results.figures.figures import convergence
from orchestrator.results.figures.plotting import BLUE, png
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.summary import View
from orchestrator.solving import solve

ROOT = Path(__file__).parents[1]
BENT = {"boundary": [CLAMP, {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 1.0, -2.0]}]}
CONTRACT_KEYS = {
    "name", "converged", "stop_reason", "iterations", "sweeps", "indicator", "error_bound", "true_error", "residuals",
    "dofs", "subdomains", "interfaces", "interface_nodes", "load_steps", "energy", "reactions", "status_counts",
    "timing", "versions", "config", "memory_peak_mb"}


# --- invariances ------------------------------------------------------------------------------------------


# --- the command line -------------------------------------------------------------------------------------


@pytest.fixture
def temporary(tmp_path):
    """TMPDIR of the program, and of it alone."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    return folder


def called(temporary, *arguments, **environment):
    """Exit code, stdout and stderr of ``orchestrator …``, called in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(temporary))
        done = CliRunner().invoke(app, [*map(str, arguments)], env=environment)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stdout, done.stderr


def launch(temporary, *arguments, **environment):
    """``orchestrator …`` as a process group of its own, as a shell would start it."""
    return begin(sys.executable, "-m", "orchestrator", *map(str, arguments), cwd=ROOT, start_new_session=True,
                 env={**os.environ, "TMPDIR": str(temporary), **environment})


def ended(process, timeout=300):
    """Exit code, stdout and stderr."""
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def written(tmp_path, **changes):
    """A configuration file of the bar; JSON is YAML."""
    data = config(**{"blackbox": FREEFEM, **changes}).complete()
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in data.items() if key != "output"]
    path = tmp_path / "bar.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.long
def test_the_shipped_example(tmp_path, temporary):
    """configs/traction_beam.yaml, its elements twice as long, from the shell: exit code, summary, history, fields and figures of the
    contract."""
    out = tmp_path / "out"
    code, shown, err = ended(launch(temporary, "run", "configs/traction_beam.yaml", "--set", "mesh.beam.h=2.5", "--reference", "--output",
                                    out))
    assert code == 0, err
    summary = json.loads((out / "summary.json").read_text())
    assert CONTRACT_KEYS <= set(summary)
    assert summary["true_error"] <= summary["error_bound"] <= 1e-6 and summary["iterations"] <= 12
    assert summary["converged"] and summary["stop_reason"] == "converged"
    assert (summary["subdomains"], summary["interfaces"], summary["load_steps"]) == (32, 31, 1)
    assert summary["dofs"] == 65 * 5 * 5 * 3 and summary["interface_nodes"] == 31 * 25
    assert close(summary["reactions"], [[[-1000, 0, 0]], [[1000, 0, 0]]])
    assert set(summary["sweeps"]) == {"setup", "iterations", "total"}
    assert {"total", "mesh", "soles", "macro", "linear_stage", "local_stage", "acceleration", "bound", "output",
            "blackbox"} <= set(summary["timing"])
    assert set(summary["timing"]["blackbox"]) == {"start", "assemble", "factorise", "solve"}
    assert summary["config"]["method"]["max_iterations"] == 500, "complete: defaults filled in"
    assert summary["memory_peak_mb"] > 50
    with open(out / "history.csv") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == HISTORY_COLUMNS and len(rows) == summary["iterations"]
    assert HISTORY_COLUMNS[:11] == ["iteration", "sweeps", "seconds", "indicator", "displacement_jump",
                                    "force_imbalance", "residual", "error_bound", "open", "stick", "slip"]
    assert (out / "fields" / "step_0001.vtu").is_file() and list((out / "fields").glob("*.pvd"))
    result = Solution.read(out)
    assert (out / "figures" / "convergence.png").read_bytes() == png(convergence(View(result.summary), result.history))
    assert shows_matter(out / "figures" / "deformed.png")
    assert share(pixels(out / "figures" / "time.png"), BLUE) > 0.02, "bars"
    assert result.displacement.shape == (1, 65 * 25, 3)
    assert not (out / "checkpoint").exists(), "nothing to resume"
    assert "converged" in shown and "error bound" in shown and str(out) in "".join(shown.split())
    assert nothing_left(temporary)


# --- runs that do not converge ----------------------------------------------------------------------------

# A tolerance out of reach and steps so small that the end is far away.
ENDLESS = method(tolerance={"indicator": 1e-20}, acceleration="none", relaxation=0.02, max_iterations=100000)
SHORTEN = ["--set", "output.figures=false"]


def lines_of(history):
    return history.read_text().count("\n") if history.exists() else 0


def under_way(temporary, path, out, iterations=5, *arguments, **environment):
    """A run in the middle of its iterations, so many of them done: whoever is told has been told of all before the last line."""
    process = launch(temporary, "run", path, "--output", out, *SHORTEN, *arguments, **environment)
    deadline = time.monotonic() + 300
    while lines_of(out / "history.csv") <= iterations + 1 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.01)
    assert process.poll() is None, process.stderr.read()
    assert lines_of(out / "history.csv") > iterations + 1
    return process


def test_not_converged(tmp_path, temporary):
    """Exit code 1, with summary, history, fields and a checkpoint to go on from."""
    out, path = tmp_path / "out", written(tmp_path, **METIS, **BENT, **method(max_iterations=3))
    code, shown, _ = called(temporary, "run", path, "--output", out, *SHORTEN)
    assert code == 1 and "NOT converged (max_iterations)" in shown
    summary = json.loads((out / "summary.json").read_text())
    assert not summary["converged"] and summary["iterations"] == 3 and 0 < summary["error_bound"] < 1
    assert (out / "fields.npz").is_file() and lines_of(out / "history.csv") == 4
    code, *_ = called(temporary, "run", path, "--output", out, *SHORTEN, "--resume",
                            "--set", "method.max_iterations=100")
    resumed = Solution.read(out)
    assert code == 0 and list(resumed.history["iteration"]) == list(range(1, resumed.iterations + 1))
    assert np.all(np.diff(resumed.history["sweeps"]) >= 1 - 1e-9), "the sweeps of both runs are counted"
    assert nothing_left(temporary)


@pytest.mark.parametrize("blow", quick([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], signal.SIGTERM), ids=["Ctrl-C", "SIGTERM", "SIGHUP"])
def test_interrupted_and_resumed(blow, tmp_path, temporary):
    """Exit code 130, a checkpoint, nothing left; --resume ends where an undisturbed run ends, whatever had stopped it: once here."""
    out, path = tmp_path / "out", written(tmp_path, **BENT, **ENDLESS)
    process = under_way(temporary, path, out)
    assert working_below(temporary)
    # Ctrl-C reaches the whole foreground group, SIGTERM the program alone
    os.killpg(process.pid, blow) if blow == signal.SIGINT else process.send_signal(blow)
    code, _, err = ended(process)
    assert code == 130 and err.strip() == "Interrupted. To go on: the same command with --resume."
    assert nothing_left(temporary)
    summary = json.loads((out / "summary.json").read_text())
    assert (out / "checkpoint").is_dir() and summary["stop_reason"] == "interrupted"
    assert summary["iterations"] >= 5 and not summary["converged"]
    if blow != signal.SIGINT:
        return
    code, _, err = ended(launch(temporary, "run", path, "--output", out, *SHORTEN, "--resume",
                                "--set", "method.tolerance.error=1e-6"))
    assert code == 0, err
    resumed = Solution.read(out)
    assert list(resumed.history["iteration"]) == list(range(1, resumed.iterations + 1))
    assert resumed.iterations > summary["iterations"] and not (out / "checkpoint").exists()
    undisturbed = solved(reference=False, **BENT)
    assert close(resumed.displacement, undisturbed.displacement, 1e-5)
    assert nothing_left(temporary)


@pytest.mark.long
def test_freefem_is_killed(tmp_path, temporary):
    """Exit code 3, a message that names the signal and the log, history and checkpoint on disk, nothing left."""
    out, path = tmp_path / "out", written(tmp_path, **BENT, **ENDLESS, blackbox={"workers": 2})
    process = under_way(temporary, path, out)
    os.kill(working_below(temporary)[0], signal.SIGKILL)
    code, _, err = ended(process)
    assert code == 3 and "SIGKILL" in err and "Traceback" not in err
    assert lines_of(out / "history.csv") > 5 and (out / "checkpoint").is_dir()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stop_reason"].startswith("failed") and not summary["converged"]
    assert nothing_left(temporary)


def test_a_fresh_run_clears_the_old_results(tmp_path, temporary):
    """What an earlier run wrote is not mixed with the new; files of the user's stay."""
    out = tmp_path / "out"
    for name in ("fields/step_0007.vtu", "figures/deformed.png", "fields.npz", "checkpoint/iteration-000001.npz", "report.md"):
        ResultsFolder(out).write(name, "old")
    for name in ("mine.txt", "fields/measured.vtu", "figures/holiday.png"):
        (out / name).write_text("old")
    code, *_ = called(temporary, "run", written(tmp_path, **BENT), "--output", out, *SHORTEN,
                            "--set", "output.fields=false")
    assert code == 0
    assert {p.name for p in out.rglob("*") if p.is_file()} == {"summary.json", "history.csv", "extremes.csv",
                                                                     "interfaces.csv", "state.npz", "mine.txt", "measured.vtu", "holiday.png",
                                                                     "manifest", "lock"}
    assert (out / "mine.txt").read_text() == "old"


# --- bad surroundings -------------------------------------------------------------------------------------


def refused(temporary, *arguments, **environment):
    """stderr of a run that ends with exit code 2 and leaves nothing."""
    code, _, err = called(temporary, *arguments, **environment)
    assert code == 2 and "Traceback" not in err, err
    assert err.count("problem in the input") == 1 and "expected:" in err
    assert nothing_left(temporary)
    return err


def test_freefem_is_missing(tmp_path, temporary):
    empty = tmp_path / "empty"
    empty.mkdir()
    err = refused(temporary, "run", written(tmp_path), "--output", tmp_path / "out", PATH=str(empty))
    assert "FreeFem++" in err and "apt-get install" in err


def test_a_code_is_asked_for_before_the_mesh_is_made(monkeypatch):
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", "/nowhere")
    made = config_from({"name": "large", "mesh": {"polycrystal": {"grains": 1000, "size": 1, "h": 0.03}}, "subdomains": "groups",
                        "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}]})
    with patch("orchestrator.solving.build_scene", side_effect=AssertionError("meshed")), pytest.raises(InputError, match="no executable"):
        solve(made)


def test_plugins_are_missing(tmp_path, temporary):
    empty = tmp_path / "empty"
    empty.mkdir()
    err = refused(temporary, "run", written(tmp_path), "--output", tmp_path / "out", FF_LOADPATH=str(empty))
    assert "bfstream" in err


def test_calculix_is_missing(temporary, tmp_path, configs_dir):
    """Told with the line of the entry and the Debian package; runs that do not name it need it not."""
    err = refused(temporary, "run", configs_dir / "two_codes.yaml", "--output", tmp_path / "out",
                  ORCHESTRATOR_CALCULIX="/nowhere/ccx")
    assert "two_codes.yaml:21: blackbox[1].code" in err and "apt-get install calculix-ccx" in err


def test_output_cannot_be_written(tmp_path, temporary):
    path, file = written(tmp_path), tmp_path / "file"
    file.write_text("")
    for out in (file, file / "below", "/proc/orchestrator"):
        assert str(out) in refused(temporary, "run", path, "--output", out)
    assert file.read_text() == ""


@pytest.mark.long
def test_disk_full(tmp_path, temporary):
    """A disk with room for the history but not for the fields."""
    if os.geteuid() != 0:
        pytest.skip("mounting a small disk needs root")
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        path = written(tmp_path, **CUBES, **BENT)
        assert "disk full" in refused(temporary, "run", path, "--output", disk / "out")
        os.remove(disk / "out" / "history.csv")
        (disk / "ballast").write_bytes(b"x" * (shutil.disk_usage(disk).free // 4096 * 4096))
        assert "disk full" in refused(temporary, "run", path, "--output", disk / "out")
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


def test_resume_without_a_checkpoint_or_for_another_problem(tmp_path, temporary):
    out, path = tmp_path / "out", written(tmp_path, **BENT, **method(max_iterations=2))
    assert "checkpoint" in refused(temporary, "run", path, "--output", out, "--resume")
    assert called(temporary, "run", path, "--output", out, *SHORTEN)[0] == 1
    err = refused(temporary, "run", path, "--output", out, "--resume", "--set", "method.relaxation=0.5")
    assert "another problem" in err
    assert (out / "checkpoint").is_dir(), "still there for the right one"
