"""A cube against FreeFEM's direct solution of the same cube in one piece, and a million dofs beyond its memory.

Whole pipelines on both sides, wall time: mesh, assembly and solution; interfaces and set-up of the method here.
FreeFEM runs ``undecomposed.edp``, a script of its own with nothing between it and the solver. Which of Debian's
direct solvers is best is measured first. The true algebraic error is measured, outside the clock, against the
undecomposed solution on our mesh.

A million dofs are tried in one piece too, by the two quickest solvers, under a limit of the address space so that the
machine survives. What they would need is also extrapolated, from the best one's memory on smaller cubes as c·dofsᵖ
through the largest two, for the other by the ratio of both on the same cube. (Debian's CHOLMOD counts in 32 bits: it
refuses factors of more than 2³¹ entries, 17 GB, whatever the memory.) CPU seconds tell what a busy machine hides.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.commands import codes_seconds, whole_command
from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels, plain_ticks
from benchmarks.kit.study import ACCURATE, Study
from benchmarks.problems.cases import cube, with_method
from orchestrator import CODES, config_from, solve

SOLVERS = ("CHOLMOD", "MUMPS", "UMFPACK")
COMPARED, SMALLER = 24, (30,)  # bricks along the side, for the choice of the solver and for the growth of its memory
BLOCKS, ELEMENTS = 4, 10  # subdomains along the side, bricks along each: 206,763 dofs
MILLION = (7, 10)  # the same: 1,073,733 dofs
PATIENCE = 900  # seconds for one direct solution
PICTURE = "direct.png"
SCRIPT = Path(__file__).resolve().parents[2] / "freefem_scripts" / "undecomposed.edp"
SPEEDUP, SHARE = 4.0, 0.8  # wanted; of the machine's memory allowed to the direct solver


@dataclass(frozen=True)
class Direct:
    """One undecomposed solution: wall seconds, peak memory (MB), dofs, and what went wrong, if anything."""

    seconds: float
    memory: float
    dofs: int
    failure: str = ""


def run(study: Study, blocks: int = BLOCKS, elements: int = ELEMENTS, million: tuple[int, int] = MILLION,
        compared: int = COMPARED, smaller: tuple[int, ...] = SMALLER) -> None:
    """The table of the direct solvers, 200,000 dofs, a million dofs."""
    study.columns = ("case", "method", "dofs", "subdomains", "iterations", "true_error", "error_bound", "stop_reason",
                     "memory_mb", "cpu_seconds", "seconds")
    limit = int(SHARE * _memory())
    tried = {name: direct(study, compared, name, limit) for name in SOLVERS}
    best, other = sorted((name for name in SOLVERS if not tried[name].failure), key=lambda name: tried[name].seconds)[:2]
    fills = [tried[best], *(direct(study, n, best, limit) for n in smaller)]
    whole = direct(study, blocks * elements, best, limit)
    fills.append(whole)
    for skip in (True, False):
        _ours(study, blocks, elements, skip)
    usual = study.rows[-2]
    ratio = whole.seconds / usual["seconds"]
    size = f"{usual['dofs']:,} dofs, {usual['subdomains']} subdomains"
    study.target(f"{size}: wall time of the direct solution ({best}) over ours", f"at least {SPEEDUP:g}",
                 f"{whole.seconds:.1f} / {usual['seconds']:.1f} s = {ratio:.1f}", ratio >= SPEEDUP)
    study.target(f"{size}: true error", f"at most {ACCURATE:g}", f"{usual['true_error']:.1e}",
                 usual["true_error"] <= ACCURATE)

    last, first = fills[-1], fills[-2]
    power = np.log(last.memory / first.memory) / np.log(last.dofs / first.dofs)
    needed = last.memory * (3 * (million[0] * million[1] + 1) ** 3 / last.dofs) ** power
    large = _command(study, *million)
    study.target(f"{large['dofs']:,} dofs on {_memory() / 2**30:.0f} GiB", "solved", f"{large['stop_reason']}, bound "
                 f"{large['error_bound']:.1e}, {large['seconds']:.0f} s, {large['memory_mb']:,.0f} MB",
                 large["stop_reason"] == "converged")
    for name in (best, other):
        found = direct(study, million[0] * million[1], name, limit)
        need = needed * tried[name].memory / tried[best].memory
        study.target(f"the same undecomposed within {limit / 2**30:.0f} GiB, {name}", "not possible",
                     f"{found.failure or 'solved'}; extrapolated need {need:,.0f} MB (dofs^{power:.2f})",
                     bool(found.failure))
    study.figure(_picture(study, best), PICTURE)


def _memory() -> int:
    """Bytes of memory in this machine."""
    return int(next(line.split()[1] for line in Path("/proc/meminfo").read_text().splitlines()
                    if line.startswith("MemTotal"))) * 1024


def direct(study: Study, cells: int, solver: str, limit: int) -> Direct:
    """A cube in one piece, as a row; a failure is one of the results."""
    code = CODES["freefem"]()
    command = [code.executable, "-ne", "-nw", "-v", "0", str(SCRIPT), "1", str(cells), solver]
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=code.environment(), text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                               preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
    with process, study.console.status(f"{cells}³ bricks in one piece, {solver}"):
        impatience = threading.Timer(PATIENCE, process.kill)  # OpenBLAS may wait for ever for memory that it cannot get
        impatience.start()
        output = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)  # by hand: it tells the peak memory of this process alone
        process.returncode = status = os.waitstatus_to_exitcode(status)
        impatience.cancel()
    seconds = time.perf_counter() - begin
    words = next((line.split() for line in output.splitlines() if line.startswith("result ")), [])
    dofs, failure = 3 * (cells + 1) ** 3, ""
    # INFOG(1) = -13 is how MUMPS says that it got no memory
    complaint = next((" ".join(line.split(". file")[0].split()) for line in output.splitlines()
                      if "error" in line.lower() or "INFOG(1)" in line), "")
    if status == -signal.SIGKILL:
        failure = f"no answer within {PATIENCE} s" if seconds >= PATIENCE else "killed for want of memory"
    elif status != 0 or not words:
        failure = f"exit code {status} {complaint}".strip()
    elif not float(words[6]) < ACCURATE:
        failure = complaint or f"wrong: relative residual {words[6]}"
    result = Direct(seconds, usage.ru_maxrss * 1024 / 1e6, dofs, failure)
    study.note({"case": f"{cells}³ bricks", "method": f"FreeFEM, {solver}", "dofs": dofs, "subdomains": 1,
                "stop_reason": failure or "solved", "memory_mb": round(result.memory),
                "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 2), "seconds": round(seconds, 2)},
               f"{cells}³ bricks in one piece, {solver}: {failure or 'solved'}, {result.memory:,.0f} MB, {seconds:.1f} s")
    return result


def _problem(blocks: int, elements: int) -> dict[str, Any]:
    """The cube of the script: side 1 there, ``blocks`` here, which changes no relative error."""
    return {**cube(blocks, elements), "output": {"fields": False, "figures": False}}


def _ours(study: Study, blocks: int, elements: int, skip: bool) -> None:
    """The decomposed cube, as a row; without ``skip`` no use is made of its blocks' being alike."""
    method = {"tolerance": {"error": ACCURATE}, "skip": {"congruent": skip}}
    config = config_from(with_method(_problem(blocks, elements), method))
    with study.console.status(f"{blocks}³ subdomains"):
        begin, cpu = time.perf_counter(), time.process_time()
        solved = solve(config)
        seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu + codes_seconds(solved.summary)
        error = solve(config, solved.scene, reference=True).summary["true_error"]
    name = "decomposed" if skip else "decomposed, no use of congruence"
    _note(study, name, blocks * elements, solved.summary, {"true_error": error, "cpu_seconds": round(cpu, 2)}, seconds)


def _command(study: Study, blocks: int, elements: int) -> dict[str, Any]:
    """The whole command on a large cube, as a row, with the memory of all its processes."""
    data = with_method(_problem(blocks, elements), {"tolerance": {"error": ACCURATE}})
    with study.console.status(f"{blocks}³ subdomains"):
        summary, seconds = whole_command(study, "large", data, output="run")
    return _note(study, "decomposed", blocks * elements, summary, {}, seconds)


def _note(study: Study, name: str, bricks: int, summary: dict[str, Any], more: dict[str, Any], seconds: float) -> dict[str, Any]:
    row = {"case": f"{bricks}³ bricks", "method": name, **{key: summary[key] for key in (
        "dofs", "subdomains", "iterations", "error_bound", "stop_reason")}, **more,
        "memory_mb": round(summary["memory_peak_mb"]), "seconds": round(seconds, 2)}
    study.note(row, f"{row['subdomains']} subdomains, {name}: {row['iterations']} iterations, {row['stop_reason']}, "
                    f"bound {row['error_bound']:.1e}, {row['memory_mb']:,} MB, {seconds:.1f} s")
    return row


def _picture(study: Study, best: str):
    """Seconds and memory over dofs."""
    figure, axes = panels(1, 2, (9.0, 3.8))
    for panel, quantity, name in zip(axes[0], ("seconds", "memory_mb"), ("wall time [s]", "peak memory [MB]")):
        for method, colour, marker, label in ((f"FreeFEM, {best}", ORANGE, "s", f"FreeFEM, {best}, undecomposed"),
                                              ("decomposed", BLUE, "o", "decomposed, error ≤ 1e-6")):
            rows = sorted((row for row in study.rows if row["method"] == method and row["stop_reason"] in ("solved", "converged")),
                          key=lambda row: row["dofs"])
            panel.loglog([row["dofs"] for row in rows], [row[quantity] for row in rows], marker + "-", color=colour, label=label)
        panel.set_xlabel("dofs", fontsize=9)
        panel.set_title(name, fontsize=11, color=GREY)
        plain_ticks(panel)
    figure.suptitle("A cube, pulled and bent: whole pipelines", fontsize=12)
    return figure
