"""Section 5.4 of the paper: a polycrystal of 100 grains, every interface in frictional contact.

The paper's fixed point, mono-scale and multiscale, for its 70 iterations; then the defaults, beyond the plateau.
Figures 13 (structure and load), 14 (deformed shapes, in run/figures) and 15 (indicator); tables 2 to 4.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from orchestrator.results.fields.files import write_fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.artist import drawn
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.figures.painting import show
from orchestrator.results.figures.plotting import BLUE, GREEN, ORANGE, new_figure, png, tidy
from orchestrator.results.figures.view import Camera, View
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.mesh.mesh import Mesh
from benchmarks.kit.drawing import Curve, draw
from benchmarks.kit.following import Followed, follow
from benchmarks.kit.study import Case, Study, first
from benchmarks.kit.table import print_table
from benchmarks.problems.cases import (
    CUT,
    GRAIN_H,
    GRAINS,
    contact_defaults,
    grains,
    paper_contact,
    with_method,
)

SMALL_GRAINS, SMALL_H = 15, 0.16
ERROR, END = 1e-3, 1e-6  # error wanted; law residual of the solution that it is measured against
LONG = 200  # iterations at most to get there; the last one stands for the solution
PAPER_SECONDS, ITERATIONS, SECONDS, MEMORY = 100, 40, 45, 5  # limits: of each of the paper's runs, of the defaults; GB
COLUMNS = ("settings", "subdomains", "interfaces", "dofs", "dofs_decomposed", "iterations", "indicator", "law_residual",
           "true_error", "held_error", "open", "stick", "slip", "mesh", "prepare", "iterate", "recover_and_write", "seconds", "GB",
           "stop_reason")
# the paper's table 2: smallest, largest subdomain; tables 3 and 4: seconds on 100 processors, smallest and largest
_TABLE2 = {"nodes of the subdomain": (529, 5639), "nodes on the interfaces": (160, 1258), "number of interfaces": (5, 18)}
_TABLE3 = {"local stage": (1766, 9964), "linear stage": (26341, 15954), "indicator computation": (5200, 4677),
           "memory management": (828, 4944)}
_TABLE4 = {"allreduce": (28615, 815), "sendrecv": (1385, 37)}


def full(study: Study) -> None:
    """The paper's size, with its targets."""
    runs = _run(study, grains(GRAINS, GRAIN_H), CUT)
    for name in ("paper, mono-scale", "paper, multiscale"):
        seconds = _row(study, name)["seconds"]
        study.target(f"{name}: {CUT} iterations, everything included (paper: 36,500 s on 100 processors)",
                     f"at most {PAPER_SECONDS} s", f"{seconds:.0f} s", seconds <= PAPER_SECONDS)
    multi = runs["paper, multiscale"].history
    study.target("the paper's plateau: its multiscale fixed point ends far from the solution",
                 "η small, error large", f"η {multi[-1].indicator:.1e}, error {multi[-1].true_error:.1e}",
                 multi[-1].indicator < 1e-4 and multi[-1].true_error > 0.05)
    ours, row = runs["defaults"], _row(study, "defaults")
    # the first from which on the error stays below
    settled = max((i + 1 for i, error in enumerate(e.true_error for e in ours.history) if error > ERROR), default=0)
    found = ours.history[settled] if row["stop_reason"] == "converged" and settled < len(ours.history) else None
    writing = row["recover_and_write"]
    loose = sorted(set().union(*ours.loose), key=lambda name: int(name.split("_")[-1]))
    study.console.print(f"defaults: nothing but stabilisation holds {', '.join(loose) or 'no grain'} at some load step or "
                        "other; their rigid motion is part of the error, but not of the held error")
    study.target(f"defaults: error ≤ {ERROR:g} against its own end (law residual {row['law_residual']:.0e}), the rigid "
                 "motion of loose grains included",
                 f"at most {ITERATIONS} iterations", found and found.iteration,
                 found is not None and found.iteration <= ITERATIONS)
    study.target("the same, everything included", f"at most {SECONDS} s",
                 found and f"{found.seconds + writing:.0f} s, of which {writing:.0f} s for writing results",
                 found is not None and found.seconds + writing <= SECONDS)
    study.target("the same, memory of all processes", f"at most {MEMORY} GB", f"{row['GB']:.1f} GB", row["GB"] <= MEMORY)


def small(study: Study) -> None:
    """A few grains: the same in seconds."""
    runs = _run(study, grains(SMALL_GRAINS, SMALL_H), CUT)
    found = first(runs["defaults"].history, "true_error", ERROR)
    study.target(f"defaults: error ≤ {ERROR:g}", f"at most {ITERATIONS} iterations", found and found.iteration,
                 found is not None and found.iteration <= ITERATIONS)


def _run(study: Study, problem: Mapping[str, Any], iterations: int) -> dict[str, Followed]:
    """The defaults first: their solution is what the paper's runs are compared with."""
    study.columns = COLUMNS
    h = problem["mesh"]["polycrystal"]["h"]
    methods = {"defaults": contact_defaults(error=END, iterations=LONG)}
    methods |= {
        # soles of the paper's stiffness, E h / length; as springs: with a layer and its diagonal as k⁺ both diverge
        name: paper_contact(strategy, kind="springs", ratio=h, relaxation=0.8, iterations=iterations)
        for name, strategy in (("paper, multiscale", "equilibrium"), ("paper, mono-scale", "none"))
    }
    startup, runs = _startup(), {}
    output = ResultsFolder(study.folder / "run")
    for name, method in methods.items():
        ours = runs.get("defaults")
        run = follow(study, Case(with_method(problem, method), {"settings": name}), towards=ours, wants_fields=True,
                     continued=0, mesh_seconds=ours and ours.watch.seconds["mesh"])
        runs[name] = run
        before = time.perf_counter()
        _write(output, run, problem, keep=ours is None)
        writing = time.perf_counter() - before
        _finish(study, run, startup, writing)
    _print_milestones(study, runs["defaults"])
    _print_tables(study, runs["paper, multiscale"])
    scene = runs["defaults"].scene
    study.folder.write("figure13.png", drawn(figure13, scene.mesh, scene.cell_subdomain, len(scene.interfaces), problem))
    study.figure(_figure15(runs, iterations))
    return runs


def _write(output: ResultsFolder, run: Followed, problem: Mapping[str, Any], keep: bool) -> None:
    """The fields of a run, as the command line writes them; they stay for the defaults only."""
    fields = run.fields
    with tempfile.TemporaryDirectory(dir=output.path) as scratch:
        folder = output if keep else ResultsFolder(scratch)
        folder.clear()
        write_fields(folder, fields)
        drawn(write_figures, folder, {"name": problem["name"]}, {}, fields)
    run.fields = None  # large


def _finish(study: Study, run: Followed, startup: float, writing: float) -> None:
    """Further columns of the last row."""
    seconds, row = run.watch.seconds, study.rows[-1]
    iterating = sum(seconds[name] for name in ("linear_stage", "coarse", "local_stage", "acceleration", "bound"))
    total = run.seconds + startup + writing
    row.update({
        "interfaces": len(run.scene.interfaces), "dofs_decomposed": 3 * sum(len(s.nodes) for s in run.scene.subdomains),
        "mesh": round(seconds["mesh"], 1), "prepare": round(run.seconds - seconds["mesh"] - iterating, 1),
        "iterate": round(iterating, 1), "recover_and_write": round(writing, 1), "seconds": round(total, 1),
        "GB": run.memory_mb / 1024})
    study.write()


def _startup() -> float:
    """Seconds that the command line spends before it begins."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import orchestrator.run"], check=True)
    return time.perf_counter() - begin


def _row(study: Study, name: str) -> dict[str, Any]:
    return next(row for row in study.rows if row["settings"] == name)


def _print_milestones(study: Study, run: Followed) -> None:
    """When the defaults had gained each power of ten."""
    rows = []
    history = run.history
    for quantity, name in (("true_error", "error"), ("law_residual", "law residual")):
        for level in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
            event = first(history, quantity, level)
            if event is not None:
                rows.append({"reached": f"{name} ≤ {level:.0e}", "after iteration": event.iteration,
                             "after s, without writing": round(event.seconds, 1), "error": event.true_error,
                             "law residual": event.law_residual, "η": event.indicator})
    print_table(study.console, "defaults: what was reached when", rows, ())


def _print_tables(study: Study, run: Followed) -> None:
    """The paper's tables 2 to 4 beside ours, printed and in tables.csv."""
    scene, watch = run.scene, run.watch.seconds
    on = [set() for _ in scene.subdomains]
    count = np.zeros(len(scene.subdomains), int)
    for i in scene.interfaces:
        for side, e in enumerate(i.subdomains):
            on[e].update(i.nodes[side].tolist())
            count[e] += 1
    nodes = [len(s.nodes) for s in scene.subdomains]
    least, most = int(np.argmin(nodes)), int(np.argmax(nodes))
    ours = dict(zip(_TABLE2, ([nodes[e] for e in (least, most)], [len(on[e]) for e in (least, most)],
                              [int(count[e]) for e in (least, most)])))
    second = [{"": name, "paper, smallest": _TABLE2[name][0], "ours, smallest": ours[name][0],
               "paper, largest": _TABLE2[name][1], "ours, largest": ours[name][1]} for name in _TABLE2]
    print_table(study.console, "Table 2: smallest and largest subdomain", second, ())

    measured = {"local stage": watch["local_stage"], "linear stage": watch["linear_stage"],
                "indicator computation": watch["bound"], "memory management": None}
    third = [{"s in all iterations": name, "paper, smallest": _TABLE3[name][0], "paper, largest": _TABLE3[name][1],
              "ours, all subdomains": None if seconds is None else round(seconds, 2)}
             for name, seconds in measured.items()]
    print_table(study.console, f"Table 3: {run.iterated.iterations} iterations; a processor per subdomain in the paper, "
                               "all subdomains one after the other here", third, ())

    busy = run.clock["solve"]
    fourth = [{"s": f"MPI {name} (waiting for others)", "paper, smallest": one, "paper, largest": two, "ours": None}
              for name, (one, two) in _TABLE4.items()]
    fourth += [{"s": "linear stage, wall", "ours": round(watch["linear_stage"], 2)},
               {"s": "black box, CPU of all its back-substitutions, set-up included", "ours": round(busy, 2)}]
    print_table(study.console, "Table 4: communication; ours are pipes to the black box's processes", fourth, ())
    study.folder.write("tables.csv", "".join(
        ",".join(f'"{value}"' if isinstance(value, str) else "" if value is None else f"{value:g}" for value in line) + "\n"
        for rows in (second, third, fourth) for line in (list(rows[0]), *(row.values() for row in rows))))


def figure13(mesh: Mesh, owner: np.ndarray, interfaces: int, problem: Mapping[str, Any], canvas: Any) -> bytes:
    """The grains, which own the cells, and how the top is moved."""
    faces, cell = surface.outer_faces(mesh.nodes, mesh.cells)
    points = mesh.nodes[faces].reshape(-1, 3)
    colour = (owner[cell] * 7919) % 97 / 97  # neighbours differ
    view = View(points, np.arange(len(points)).reshape(-1, 3), np.repeat(colour, 3),
                mesh.nodes[surface.edges(mesh.nodes, faces, owner[cell])], surface.box_edges(mesh.nodes),
                Camera.framing(points).shaped(), (-0.2, 1.0), inches=6.0)
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    show(left, view, None if canvas is None else canvas.draw(view))
    left.set_title(f"{owner.max() + 1} grains, {interfaces} interfaces, {3 * len(mesh.nodes):,} dofs", fontsize=11)
    path = [0.0, *(-step[2] for step in problem["boundary"][1]["displacement"])]
    right.plot(path, "o-", color=BLUE, linewidth=1.3)
    right.set_xlabel("load step", fontsize=9)
    right.set_ylabel("top moved down by", fontsize=9)
    right.xaxis.get_major_locator().set_params(integer=True)
    right.tick_params(labelsize=8.5)
    tidy(right)
    figure.tight_layout()
    return png(figure)


def _figure15(runs: Mapping[str, Followed], last: int) -> bytes:
    """The paper's indicator, and the error that it hides."""
    figure = new_figure(11.0, 4.2)
    left, right = figure.subplots(1, 2)
    colours = {"paper, mono-scale": ORANGE, "paper, multiscale": GREEN, "defaults": BLUE}
    curves = [Curve(runs[name].history, colour, name) for name, colour in colours.items()]
    last = max(last, runs["defaults"].iterated.iterations)
    draw(left, curves, "indicator", limits=(1e-12, 2), last=last)
    draw(right, curves, "true_error", limits=(1e-6, 2), last=last, mark=(ERROR, f"{ERROR:g}"))
    for axes, name in ((left, "indicator η (a squared ratio)"), (right, "error against the converged solution")):
        axes.set_ylabel(name, fontsize=9.5)
        axes.set_xlabel("iteration (linear stages after set-up)", fontsize=9)
    left.legend(fontsize=8.5, frameon=False)
    scene = runs["defaults"].scene
    figure.suptitle(f"{len(scene.subdomains)} grains in frictional contact, {scene.steps} load steps", fontsize=12)
    figure.tight_layout()
    return png(figure)
