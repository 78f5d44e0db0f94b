"""Frictional contact: how many sweeps the defaults need, beside the paper's fixed point and Anderson alone.

A sweep is one back-substitution per subdomain for one load step: an iteration over T steps is T sweeps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from orchestrator.results.figures.plotting import BLUE, GREEN, ORANGE, RED, png
from benchmarks.kit.drawing import Curve, draw, grid, label_rows, shades
from benchmarks.kit.following import Followed, follow, sweeps_to
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import contact_defaults, grains, paper_contact, pressed_cubes, with_method

COLUMNS = ("case", "settings", "steps", "iterations", "sweeps_1e-01", "sweeps_1e-02", "sweeps_1e-03", "sweeps_1e-06",
           "law_residual", "indicator", "true_error", "end_law_residual", "apart", "other_statuses", "open", "stick", "slip",
           "stop_reason", "seconds")
LONG = 400  # iterations of the methods that need many
H = {15: 0.16, 40: 0.08}  # grains: element size
GRAINS = {15: {1e-2: 60, 1e-3: 150, 1e-6: 320}, 40: {1e-2: 120, 1e-3: 300}}  # grains: error: sweeps wanted
FRICTIONS, CUBE_SWEEPS = (0.1, 0.3), 60
FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)
TOLERANCE, SPREAD = 1e-6, 3  # of the law residual; times the default's sweeps
ABSCISSA = "sweeps (back-substitutions per subdomain)"
COLOURS = {"defaults": BLUE, "Anderson alone": GREEN, "paper, our soles": ORANGE, "paper": RED}


def settings(length: float, h: float) -> dict[str, dict[str, Any]]:
    """What is compared: the defaults, without their coarse contact problem, and the paper's fixed point twice.

    Parameters
    ----------
    length, h : of the structure and of an element: the paper's soles are E h / length
    """
    return {
        "defaults": contact_defaults(),
        "Anderson alone": contact_defaults(coarse="none", iterations=LONG),
        "paper, our soles": paper_contact(kind="springs", relaxation=0.8, iterations=LONG),
        "paper": paper_contact(ratio=h / length, iterations=LONG),
    }


def cubes(study: Study) -> None:
    """3³ cubes, compressed, sheared and partly unloaded."""
    study.columns = COLUMNS
    runs = {}
    for friction in FRICTIONS:
        name = f"μ = {friction:g}"
        runs[name] = compare(study, name, pressed_cubes(friction), settings(3, 0.25))
        wanted(study, f"3³ cubes, {name}", runs[name]["defaults"], {1e-3: CUBE_SWEEPS})
    study.figure(picture(runs, "3³ cubes compressed, sheared and partly unloaded, 6 steps"))


def polycrystals(study: Study) -> None:
    """15 and 40 grains, compressed and unloaded."""
    study.columns = COLUMNS
    runs = {}
    for count, levels in GRAINS.items():
        name = f"{count} grains"
        runs[name] = compare(study, name, grains(count, H[count]), settings(1, H[count]))
        wanted(study, name, runs[name]["defaults"], levels)
    study.figure(picture(runs, "Polycrystals compressed and unloaded, 4 steps, μ = 0.1"))


def soles(study: Study) -> None:
    """Softer and stiffer soles."""
    study.columns = ("case", "factor", "iterations", "sweeps", "sweeps_1e-02", "sweeps_1e-03", "law_residual",
                     "apart", "other_statuses", "stop_reason", "seconds")
    problems, curves = {"3³ cubes, μ = 0.1": pressed_cubes(0.1), "15 grains": grains(15, H[15])}, {}
    for name, problem in problems.items():
        usual = None
        for factor in sorted(FACTORS, key=lambda f: f != 1):  # the default first
            case = Case(with_method(problem, contact_defaults(factor=factor, error=TOLERANCE)),
                        {"case": name, "factor": factor})
            curves[name, factor] = run = follow(study, case, usual)
            usual = usual or run
            study.rows[-1]["sweeps"] = sweeps_to(run, "law_residual", TOLERANCE)
        found = {row["factor"]: row["sweeps"] for row in study.rows if row["case"] == name}
        for factor in FACTORS:
            if factor != 1:
                study.target(f"{name}: soles × {factor:g}, law residual ≤ {TOLERANCE:g}",
                             f"at most {SPREAD} × {found[1.0]} sweeps", found[factor],
                             None not in (found[1.0], found[factor]) and found[factor] <= SPREAD * found[1.0])
    study.write()
    figure, axes = grid(1, len(problems), 11.0, 3.6)
    last = min(1.05 * max(run.iterated.iterations * run.scene.steps for run in curves.values()), 3000)
    for panel, name in zip(axes[0], problems):
        draw(panel, [], "law_residual", limits=(1e-7, 10), last=last, mark=(TOLERANCE, f"{TOLERANCE:g}"))
        for factor, colour in zip(FACTORS, shades(len(FACTORS), "plasma")):
            run = curves[name, factor]
            draw(panel, [Curve(run.history, colour, f"soles × {factor:g}")], "law_residual", limits=(1e-7, 10),
                 last=last, sweeps=run.scene.steps)
        panel.set_title(name, fontsize=11)
    axes[0, 0].legend(fontsize=8.5, frameon=False)
    label_rows(axes, ("law residual (the largest)",), ABSCISSA)
    figure.tight_layout()
    study.figure(png(figure))


def compare(study: Study, name: str, problem: Mapping[str, Any],
            methods: Mapping[str, Mapping[str, Any]]) -> dict[str, Followed]:
    """All methods on one problem; ends are compared with the first one's."""
    runs: dict[str, Followed] = {}
    for label, method in methods.items():
        beside = next(iter(runs.values()), None)
        runs[label] = follow(study, Case(with_method(problem, method), {"case": name, "settings": label}), beside)
    return runs


def wanted(study: Study, name: str, run: Followed, levels: Mapping[float, int]) -> None:
    """Targets: error, sweeps."""
    for level, limit in levels.items():
        found = sweeps_to(run, "true_error", level)
        study.target(f"{name}, defaults: error ≤ {level:.0e}", f"at most {limit} sweeps", found,
                     found is not None and found <= limit)


def picture(runs: Mapping[str, Mapping[str, Followed]], title: str, limits: Sequence[float] = (1e-7, 2)) -> bytes:
    """A column per problem: the error over the sweeps, and the indicator that hides it."""
    figure, axes = grid(2, len(runs), 11.0)
    last = max(LONG // 2, 1) * max(run.scene.steps for methods in runs.values() for run in methods.values())
    for column, (name, methods) in enumerate(runs.items()):
        for row, quantity in enumerate(("true_error", "indicator")):
            for label, run in methods.items():
                draw(axes[row, column], [Curve(run.history, COLOURS.get(label, "black"), label)], quantity,
                     limits=tuple(limits) if row == 0 else (1e-12, 2), last=last, sweeps=run.scene.steps)
        axes[0, column].set_title(name, fontsize=11)
    axes[0, 0].legend(fontsize=8.5, frameon=False)
    label_rows(axes, ("error against the run's own end", "indicator η (a squared ratio)"), ABSCISSA)
    figure.suptitle(title, fontsize=12)
    figure.tight_layout()
    return png(figure)
