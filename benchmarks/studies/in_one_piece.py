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

from orchestrator.blackbox.codes.freefem.code import FreeFem
from orchestrator.blackbox.codes.freefem.installation import UNDECOMPOSED, script
from orchestrator.blackbox.start import make_blackbox
from orchestrator.config import config_from
from orchestrator.method.delivery.reference import Reference, solve_reference
from orchestrator.results.figures.plotting import BLUE, GREY, ORANGE, new_figure, png, tidy
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from benchmarks.kit.commands import whole_command
from benchmarks.kit.drawing import plain_ticks
from benchmarks.kit.study import ACCURATE, Study
from benchmarks.problems.cases import cube, with_method

SOLVERS = ("CHOLMOD", "MUMPS", "UMFPACK")
COMPARED, SMALLER = 24, (30,)  # bricks along the side, for the choice of the solver and for the growth of its memory
BLOCKS, ELEMENTS = 4, 10  # subdomains along the side, bricks along each: 206,763 dofs
MILLION = (7, 10)  # the same: 1,073,733 dofs
PATIENCE = 900  # seconds for one direct solution
PICTURE = "direct.png"
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
    code, limit = FreeFem(), int(SHARE * _memory())
    tried = {name: _direct(study, code, compared, name, limit) for name in SOLVERS}
    best, other = sorted((name for name in SOLVERS if not tried[name].failure), key=lambda name: tried[name].seconds)[:2]
    fills = [tried[best], *(_direct(study, code, n, best, limit) for n in smaller)]
    whole = _direct(study, code, blocks * elements, best, limit)
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
        direct = _direct(study, code, million[0] * million[1], name, limit)
        need = needed * tried[name].memory / tried[best].memory
        study.target(f"the same undecomposed within {limit / 2**30:.0f} GiB, {name}", "not possible",
                     f"{direct.failure or 'solved'}; extrapolated need {need:,.0f} MB (dofs^{power:.2f})",
                     bool(direct.failure))
    study.folder.write(PICTURE, _picture(study, best))


def _memory() -> int:
    """Bytes of memory in this machine."""
    return int(next(line.split()[1] for line in Path("/proc/meminfo").read_text().splitlines()
                    if line.startswith("MemTotal"))) * 1024


def _direct(study: Study, code: FreeFem, cells: int, solver: str, limit: int) -> Direct:
    """A cube in one piece, as a row; a failure is one of the results."""
    command = [code.executable, "-ne", "-nw", "-v", "0", str(script(UNDECOMPOSED)), "1", str(cells), solver]
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
    study.rows.append({"case": f"{cells}³ bricks", "method": f"FreeFEM, {solver}", "dofs": dofs, "subdomains": 1,
                       "stop_reason": failure or "solved", "memory_mb": round(result.memory),
                       "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 2), "seconds": round(seconds, 2)})
    study.histories.append([])
    study.write()
    study.console.print(f"  {len(study.rows):3}  {cells}³ bricks in one piece, {solver}: {failure or 'solved'}, "
                        f"{result.memory:,.0f} MB, {seconds:.1f} s")
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
        solved = solve(config, build_scene(config))
        seconds = time.perf_counter() - begin
        cpu = time.process_time() - cpu + sum(solved.summary["timing"]["blackbox"].values())
        error = _true_error(config, solved)
    summary = solved.summary
    row = {"case": f"{blocks * elements}³ bricks",
           "method": "decomposed" if skip else "decomposed, no use of congruence", "dofs": summary["dofs"], "subdomains": summary["subdomains"], "iterations": solved.iterations,
           "true_error": error, "error_bound": summary["error_bound"], "stop_reason": solved.stop_reason,
           "memory_mb": round(summary["memory_peak_mb"]), "cpu_seconds": round(cpu, 2), "seconds": round(seconds, 2)}
    study.rows.append(row)
    study.histories.append(solved.iterated.history)
    study.write()
    study.console.print(f"  {len(study.rows):3}  {blocks}³ subdomains{'' if skip else ', no use of congruence'}: "
                        f"{row['iterations']} iterations, {row['stop_reason']}, true error {error:.1e}, "
                        f"{seconds:.1f} s")


_references: dict[int, Reference] = {}  # the last one


def _true_error(config, solved) -> float:
    """Against the undecomposed solution of the same mesh, which is solved once."""
    key = len(solved.scene.mesh.nodes)
    if key not in _references:
        _references.clear()
        with make_blackbox(config.blackbox) as whole:
            _references[key] = solve_reference(solved.scene, whole)
    return _references[key].relative_error(solved.displacement)


def _command(study: Study, blocks: int, elements: int) -> dict[str, Any]:
    """The whole command on a large cube, as a row, with the memory of all its processes."""
    data = with_method(_problem(blocks, elements), {"tolerance": {"error": ACCURATE}})
    with study.console.status(f"{blocks}³ subdomains"):
        summary, seconds = whole_command(study, "large", data, output="run")
    row = {"case": f"{blocks * elements}³ bricks", "method": "decomposed", "dofs": summary["dofs"],
           "subdomains": summary["subdomains"], "iterations": summary["iterations"],
           "error_bound": summary["error_bound"], "stop_reason": summary["stop_reason"],
           "memory_mb": round(summary["memory_peak_mb"]), "seconds": round(seconds, 2)}
    study.rows.append(row)
    study.histories.append([])
    study.write()
    study.console.print(f"  {len(study.rows):3}  {blocks}³ subdomains: {row['iterations']} iterations, "
                        f"{row['stop_reason']}, bound {row['error_bound']:.1e}, {row['memory_mb']:,} MB, {seconds:.1f} s")
    return row


def _picture(study: Study, best: str) -> bytes:
    """Seconds and memory over dofs."""
    figure = new_figure(9.0, 3.8)
    names = {"seconds": "wall time [s]", "memory_mb": "peak memory [MB]"}
    for axes, (quantity, name) in zip(figure.subplots(1, 2), names.items()):
        for method, colour, marker in ((f"FreeFEM, {best}", ORANGE, "s"), ("decomposed", BLUE, "o")):
            rows = sorted((row for row in study.rows if row["method"] == method and (
                row["stop_reason"] in ("solved", "converged"))), key=lambda row: row["dofs"])
            axes.loglog([row["dofs"] for row in rows], [row[quantity] for row in rows], marker + "-", color=colour,
                        label=f"{method}, undecomposed" if method != "decomposed" else "decomposed, error ≤ 1e-6")
        axes.set_xlabel("dofs", fontsize=9)
        axes.set_title(name, fontsize=11, color=GREY)
        tidy(axes)
        plain_ticks(axes)
        axes.legend(fontsize=8.5, frameon=False)
    figure.suptitle("A cube, pulled and bent: whole pipelines", fontsize=12)
    figure.tight_layout()
    return png(figure)
