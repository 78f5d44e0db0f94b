"""Section 5.4 of the paper: a polycrystal of 100 grains, every interface in frictional contact.

The defaults from the command line, whose figures (13 and 14) are in run/figures; then their errors beside those of the paper's
fixed point, mono-scale and multiscale, for its 70 iterations (figure 15); tables 2 to 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.kit.commands import codes_seconds, whole_command
from benchmarks.kit.drawing import BLUE, GREEN, ORANGE, Curve, draw, label_rows, panels
from benchmarks.kit.following import Followed, follow
from benchmarks.kit.study import Case, Study, first
from benchmarks.kit.table import print_table
from benchmarks.problems.cases import CUT, GRAIN_H, GRAINS, contact_defaults, grains, paper_contact, with_method

ERROR, END = 1e-3, 1e-6  # error wanted; law residual of the solution that it is measured against
LONG = 200  # iterations at most to get there
PAPER_SECONDS, ITERATIONS, SECONDS, MEMORY = 100, 40, 45, 5  # limits: of each of the paper's runs, of the defaults; GB
COLOURS = {"paper, mono-scale": ORANGE, "paper, multiscale": GREEN, "defaults": BLUE}
# the paper's table 2: smallest, largest subdomain; tables 3 and 4: seconds on 100 processors, smallest and largest
TABLE2 = {"nodes of the subdomain": (529, 5639), "nodes on the interfaces": (160, 1258), "number of interfaces": (5, 18)}
TABLE3 = {"local stage": (1766, 9964), "linear stage": (26341, 15954), "indicator computation": (5200, 4677)}
TABLE4 = {"allreduce": (28615, 815), "sendrecv": (1385, 37)}


def run(study: Study, problem: Mapping[str, Any] | None = None) -> None:
    """The paper's size, unless another problem is given."""
    problem = problem or grains(GRAINS, GRAIN_H)
    study.columns = ("settings", "subdomains", "dofs", "iterations", "indicator", "law_residual", "true_error", "open", "stick", "slip",
                     "stop_reason", "seconds")
    summary, seconds = whole_command(study, "defaults", with_method(problem, contact_defaults(law=END, iterations=LONG)), output="run")
    h = problem["mesh"]["polycrystal"]["h"]
    # soles of the paper's stiffness, E h / length; as springs: with a layer and its diagonal as k⁺ both diverge
    methods = {"defaults": contact_defaults(law=END, iterations=LONG),
               **{name: paper_contact(strategy, kind="springs", ratio=h, relaxation=0.8)
                  for name, strategy in (("paper, multiscale", "equilibrium"), ("paper, mono-scale", "none"))}}
    runs = {name: follow(study, Case(with_method(problem, method), {"settings": name})) for name, method in methods.items()}
    _targets(study, runs, summary, seconds)
    _milestones(study, runs["defaults"])
    _tables(study, runs["paper, multiscale"])
    study.figure(_figure15(runs))


def _targets(study: Study, runs: Mapping[str, Followed], summary: Mapping[str, Any], seconds: float) -> None:
    for name in ("paper, mono-scale", "paper, multiscale"):
        spent = runs[name].seconds
        study.target(f"{name}: {CUT} iterations (paper: 36,500 s on 100 processors)", f"at most {PAPER_SECONDS} s", f"{spent:.0f} s",
                     spent <= PAPER_SECONDS)
    eta, error = (float(runs["paper, multiscale"].history[q][-1]) for q in ("indicator", "true_error"))
    study.target("the paper's plateau: its multiscale fixed point ends far from the solution", "η small, error large",
                 f"η {eta:.1e}, error {error:.1e}", eta < 1e-4 and error > 0.05)
    ours = runs["defaults"]
    found = first(ours.history, "true_error", ERROR) if ours.solved.converged else None
    study.target(f"defaults: error ≤ {ERROR:g} against their own end (law residual {END:g})", f"at most {ITERATIONS} iterations", found,
                 found is not None and found <= ITERATIONS)
    gigabytes = summary["memory_peak_mb"] / 1024
    study.target(f"defaults: the whole command to a law residual of {END:g}", f"at most {SECONDS} s and {MEMORY} GB",
                 f"{summary['iterations']} iterations, {seconds:.0f} s, {gigabytes:.1f} GB", seconds <= SECONDS and gigabytes <= MEMORY)


def _milestones(study: Study, run: Followed) -> None:
    """When the defaults had gained each power of ten."""
    rows = []
    for quantity, name in (("true_error", "error"), ("law_residual", "law residual")):
        for level in 10.0 ** -np.arange(1, 7):
            if (found := first(run.history, quantity, level)) is not None:
                at = {key: float(values[found - 1]) for key, values in run.history.items()}
                rows.append({"reached": f"{name} ≤ {level:.0e}", "after iteration": found, "after s": round(at["seconds"], 1),
                             "error": at["true_error"], "law residual": at["law_residual"], "η": at["indicator"]})
    print_table(study.console, "defaults: what was reached when", rows, ())


def _tables(study: Study, run: Followed) -> None:
    """The paper's tables 2 to 4 beside ours."""
    scene, summary = run.scene, run.solved.summary
    on, count = [set() for _ in scene.subdomains], np.zeros(len(scene.subdomains), int)
    for i in scene.interfaces:
        for side, e in enumerate(i.subdomains):
            on[e].update(i.nodes[side].tolist())
            count[e] += 1
    nodes = [len(s.nodes) for s in scene.subdomains]
    least, most = int(np.argmin(nodes)), int(np.argmax(nodes))
    ours = [(nodes[e], len(on[e]), int(count[e])) for e in (least, most)]
    print_table(study.console, "Table 2: smallest and largest subdomain", [
        {"": name, "paper, smallest": a, "ours, smallest": own, "paper, largest": b, "ours, largest": other}
        for (name, (a, b)), own, other in zip(TABLE2.items(), *ours)], ())
    timing = summary["timing"]
    print_table(study.console, f"Table 3: s in {run.solved.iterations} iterations; the paper has a processor per subdomain", [
        {"": name, "paper, smallest": a, "paper, largest": b, "ours, all subdomains": round(timing[key], 2)}
        for (name, (a, b)), key in zip(TABLE3.items(), ("local_stage", "linear_stage", "bound"))], ())
    print_table(study.console, "Table 4: communication; ours are pipes to the black box's processes", [
        *({"s": f"MPI {name} (waiting for others)", "paper, smallest": a, "paper, largest": b} for name, (a, b) in TABLE4.items()),
        {"s": "linear stage, wall", "ours": round(timing["linear_stage"], 2)},
        {"s": "black box, CPU of all its work, set-up included", "ours": round(codes_seconds(summary), 2)}], ())


def _figure15(runs: Mapping[str, Followed]):
    """The paper's indicator, and the error that it hides."""
    figure, axes = panels(1, 2, (11.0, 4.2))
    curves = [Curve(runs[name].history, colour, name) for name, colour in COLOURS.items()]
    last = max(run.solved.iterations for run in runs.values())
    draw(axes[0, 0], curves, "indicator", limits=(1e-12, 2), last=last)
    draw(axes[0, 1], curves, "true_error", limits=(1e-6, 2), last=last, mark=(ERROR, f"{ERROR:g}"))
    label_rows(axes, ("indicator η (a squared ratio)",))
    axes[0, 1].set_ylabel("error against the converged solution")
    scene = runs["defaults"].scene
    figure.suptitle(f"{len(scene.subdomains)} grains in frictional contact, {scene.steps} load steps", fontsize=12)
    return figure
