"""Faults: runs that are killed at random moments, and disks that are full at every stage; then ``--resume``.

A killed run must end as an undisturbed one does: as many iterations but one, the same displacements to its tolerance, and no more
than one iteration computed twice. What a full disk keeps from being written must be written once there is room.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.commands import BAD_INPUT, CONVERGED, orchestrate, without_ranks
from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.study import Study
from benchmarks.problems.cases import bolted_apart, cube, pressed_cubes

KILLS = 10  # per problem and number of ranks: 60 in all
STAGES = 12  # of a disk that fills up, per problem
SAME = 1e-12  # relative difference of displacements
LOST = 1  # iterations computed twice, and more or fewer than an undisturbed run's
PATIENCE = 600.0  # seconds a run may take


def run(study: Study, problems: dict[str, dict[str, Any]] | None = None, kills: int = KILLS, stages: int = STAGES) -> None:
    """All faults of all problems; the targets judge them together."""
    study.columns = ("problem", "ranks", "fault", "at", "iterations", "lost", "lost_seconds", "difference", "exit", "left", "seconds")
    problems = problems or {"bonded": cube(4), "contact": pressed_cubes(0.3), "bolted, meshed apart": bolted_apart()}
    missing, draw = without_ranks(), np.random.default_rng(12)
    for name, config in problems.items():
        path = study.folder / f"{name}.yaml"
        path.write_text(json.dumps({**config, "output": {"figures": False}}), encoding="utf-8")
        for ranks in (1,) if missing else (1, 2):
            whole = _Run(path, study.folder / "whole", ranks)
            seconds = whole.seconds = _timed(whole)
            for moment in draw.uniform(0.05, 1.0, kills) * seconds:
                _note(study, name, ranks, "killed", moment, _killed(whole, study.folder / "killed", moment))
            if ranks == 1 and (room := _needed(whole)):
                with _small_disk(study.folder / "disk", 3 * room) as disk:
                    for share in np.linspace(0.0, 1.1, stages) if disk else ():
                        _note(study, name, ranks, "disk full", share * room / 1e6, _filled(whole, disk, int(share * room)))
    _targets(study, missing)
    study.figure(_picture(study))


class _Run:
    """Whole runs of a configuration from the command line.

    Parameters
    ----------
    path : the configuration
    folder : of its results
    ranks : how many
    """

    def __init__(self, path: Path, folder: Path, ranks: int):
        self.path, self.folder, self.ranks, self.seconds = path, folder, ranks, 0.0
        self.temporary = folder.with_name("temporary")
        self.temporary.mkdir(exist_ok=True)

    def begin(self, folder: Path, *more: str) -> subprocess.Popen:
        """Start it, in a session of its own."""
        return orchestrate(self.path, "--output", str(folder), "--quiet", *more, ranks=self.ranks, temporary=self.temporary)

    def end(self, folder: Path, *more: str) -> int:
        """Its exit code."""
        process = self.begin(folder, *more)
        try:
            process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            _kill(process)
        return process.returncode

    def left(self) -> int:
        """Folders of the codes, and processes that work in them, after a run has ended."""
        def at(process: Path) -> str:
            with suppress(OSError):
                return os.readlink(process / "cwd")
            return ""

        return len(list(self.temporary.glob("orchestrator-*"))) + sum(
            at(process).startswith(f"{self.temporary.absolute()}/") for process in Path("/proc").glob("[0-9]*"))

    def compared(self, folder: Path) -> dict[str, Any]:
        """Iterations of a run and its difference to the undisturbed one."""
        with np.load(self.folder / "fields.npz") as mine, np.load(folder / "fields.npz") as theirs:
            one, other = mine["displacement"], theirs["displacement"]
        mine, theirs = history(self.folder), history(folder)
        return {"iterations": len(theirs), "same_iterations": abs(len(theirs) - len(mine)) <= LOST
                and [row["iteration"] for row in theirs] == [str(i + 1) for i in range(len(theirs))],
                "difference": float(np.abs(one - other).max() / np.abs(one).max())}


def _timed(whole: _Run) -> float:
    shutil.rmtree(whole.folder, ignore_errors=True)
    begin = time.perf_counter()
    whole.end(whole.folder)
    return time.perf_counter() - begin


def _killed(whole: _Run, folder: Path, moment: float) -> dict[str, Any]:
    """Kill a run, all its ranks at once, see what is left, resume it."""
    shutil.rmtree(folder, ignore_errors=True)
    begin = time.perf_counter()
    process = whole.begin(folder)
    try:
        process.communicate(timeout=moment)
    except subprocess.TimeoutExpired:
        _kill(process)
    if (folder / "summary.json").exists():
        return {"exit": CONVERGED, "lost": 0, "lost_seconds": 0.0, **whole.compared(folder),
                "seconds": time.perf_counter() - begin}
    before = history(folder)
    code = whole.end(folder, *(["--resume"] if (folder / "checkpoint").exists() else []))
    lost = _lost(before, history(folder))
    compared = whole.compared(folder) if code == CONVERGED else {"iterations": 0, "difference": np.inf}
    return {"exit": code, **lost, **compared, "left": whole.left(), "seconds": time.perf_counter() - begin}


def history(folder: Path) -> list[dict[str, str]]:
    """Lines of history.csv; none where there is none."""
    with suppress(FileNotFoundError), open(folder / "history.csv", encoding="utf-8") as file:
        return list(csv.DictReader(file))
    return []


def _lost(before: list[dict[str, str]], after: list[dict[str, str]]) -> dict[str, Any]:
    """Iterations that were computed twice, whose lines are not the old ones any more, and their seconds."""
    try:
        old, new = ([float(row["seconds"]) for row in rows] for rows in (before, after))
    except (KeyError, ValueError, TypeError):  # the last line was half written
        return _lost(before[:-1], after)
    kept = next((k for k, (one, other) in enumerate(zip(old, new)) if one != other), min(len(old), len(new)))
    spent = old[-1] - old[max(kept - 1, 0)] if old else 0.0
    return {"lost": len(old) - kept, "lost_seconds": round(spent, 3)}


def _kill(process: subprocess.Popen) -> None:
    """The launcher and all below it, with a signal that nobody hears."""
    family, left = [], [process.pid]
    while left:
        pid = left.pop()
        family.append(pid)
        for task in Path(f"/proc/{pid}/task").glob("*/children"):
            try:
                left += map(int, task.read_text().split())
            except OSError:  # it has just ended
                pass
    for pid in family:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
    process.communicate()


def _needed(whole: _Run) -> int:
    """Bytes of a run's results."""
    return sum(path.stat().st_size for path in whole.folder.rglob("*") if path.is_file())


@contextmanager
def _small_disk(place: Path, size: int) -> Iterator[Path | None]:
    """A file system of its own; None where none can be mounted."""
    place.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _filled(whole: _Run, disk: Path, left: int) -> dict[str, Any]:
    """Run with so many bytes left, make room, resume if there is something to."""
    for path in disk.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    state, begin = os.statvfs(disk), time.perf_counter()
    (disk / "ballast").write_bytes(bytes(max(0, state.f_bavail * state.f_frsize - left)))
    code = whole.end(disk / "out")
    lost = {"lost": 0, "lost_seconds": 0.0}
    (disk / "ballast").unlink()
    if code == BAD_INPUT:
        begun, before = (disk / "out" / "checkpoint").exists(), history(disk / "out")
        code = whole.end(disk / "out", *(["--resume"] if begun else []))
        lost = _lost(before, history(disk / "out")) if begun else lost
    compared = whole.compared(disk / "out") if code == CONVERGED else {"iterations": 0, "difference": np.inf}
    return {"exit": code, **lost, **compared, "seconds": time.perf_counter() - begin}


def _note(study: Study, name: str, ranks: int, fault: str, at: float, found: dict[str, Any]) -> None:
    row = {"problem": name, "ranks": ranks, "fault": fault, "at": round(at, 3), **found, "seconds": round(found["seconds"], 2)}
    study.note(row, f"{name}, {ranks} ranks, {fault} at {at:.2f}: exit {row['exit']}, {row['lost']} lost, "
                    f"difference {row['difference']:.1e}")


def _targets(study: Study, missing: str | None) -> None:
    for fault in ("killed", "disk full"):
        rows = [row for row in study.rows if row["fault"] == fault]
        if not rows:
            study.target(f"{fault}", "results are not lost", "could not be tried here", False)
            continue
        study.target(f"{fault}: exit code 0 once resumed", f"{len(rows)}", sum(r["exit"] == CONVERGED for r in rows),
                     all(r["exit"] == CONVERGED for r in rows))
        study.target(f"{fault}: the same iterations, one more or fewer", f"{len(rows)}", sum(bool(r.get("same_iterations")) for r in rows),
                     all(r.get("same_iterations") for r in rows))
        worst = max(r["difference"] for r in rows)
        study.target(f"{fault}: difference of displacements", f"≤ {SAME:g}", f"{worst:.1e}", worst <= SAME)
        late = [r for r in rows if r["lost"] > LOST]
        study.target(f"{fault}: one iteration lost at most", "0 beyond", len(late), not late)
    left = sum(r["left"] for r in study.rows if r["fault"] == "killed" and "left" in r)
    study.target("killed: folders and processes of codes left after the next run", "0", left, left == 0)
    if missing:
        study.target("killed: two ranks", "tried", missing, False)


def _picture(study: Study):
    """Seconds of iterations that were lost, over the moment of the kill."""
    figure, ((axes,),) = panels(size=(6.4, 3.6))
    for ranks, colour in ((1, BLUE), (2, ORANGE)):
        rows = [r for r in study.rows if r["fault"] == "killed" and r["ranks"] == ranks]
        axes.plot([r["at"] for r in rows], [r["lost_seconds"] for r in rows], "o", color=colour,
                  label=f"{ranks} rank{'s' if ranks > 1 else ''}")
    axes.set(xlabel="killed after [s]", ylabel="iterations computed twice [s]")
    return figure
