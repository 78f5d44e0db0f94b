"""Frictional contact: how many sweeps the defaults need, beside the paper's fixed point and Anderson alone.

A sweep is one back-substitution per subdomain for one load step: an iteration over T steps is T sweeps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.kit.drawing import BLUE, GREEN, ORANGE, RED, Curve, draw, grid, label_rows, shades
from benchmarks.kit.following import Followed, follow
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import contact_defaults, grains, paper_contact, pressed_cubes, with_method

LONG = 400  # iterations of the methods that need many
H = {15: 0.16, 40: 0.08}  # grains: element size
GRAINS = {15: {1e-2: 60, 1e-3: 150, 1e-6: 320}, 40: {1e-2: 120, 1e-3: 300}}  # grains: error: sweeps wanted
FRICTIONS, CUBE_SWEEPS = (0.1, 0.3), 60
FACTORS = (1.0, 0.1, 0.3, 3.0, 10.0)  # the default first
TOLERANCE, SPREAD = 1e-6, 3  # of the law residual; times the default's sweeps
ABSCISSA = "sweeps (back-substitutions per subdomain)"
COLOURS = {"defaults": BLUE, "Anderson alone": GREEN, "paper, our soles": ORANGE, "paper": RED}


def cubes(study: Study) -> None:
    """3³ cubes, compressed, sheared and partly unloaded."""
    runs = {name: compare(study, name, pressed_cubes(friction), 0.25 / 3, {1e-3: CUBE_SWEEPS})
            for friction in FRICTIONS for name in (f"3³ cubes, μ = {friction:g}",)}
    study.figure(picture(runs, "3³ cubes compressed, sheared and partly unloaded, 6 steps"))


def polycrystals(study: Study) -> None:
    """15 and 40 grains, compressed and unloaded."""
    runs = {name: compare(study, name, grains(count, H[count]), H[count], levels)
            for count, levels in GRAINS.items() for name in (f"{count} grains",)}
    study.figure(picture(runs, "Polycrystals compressed and unloaded, 4 steps, μ = 0.1"))


def compare(study: Study, name: str, problem: Mapping[str, Any], ratio: float, levels: Mapping[float, int]) -> dict[str, Followed]:
    """The defaults, without their coarse contact problem, and the paper's fixed point twice; ends beside the first one's.

    Parameters
    ----------
    ratio : of an element to the structure: the paper's soles are E h / length
    levels : error → sweeps wanted of the defaults
    """
    study.columns = ("case", "settings", "steps", "iterations", "sweeps_1e-01", "sweeps_1e-02", "sweeps_1e-03", "sweeps_1e-06",
                     "law_residual", "indicator", "true_error", "end_law_residual", "apart", "other_statuses", "open", "stick", "slip",
                     "stop_reason", "seconds")
    runs: dict[str, Followed] = {}
    for label, method in {"defaults": contact_defaults(), "Anderson alone": contact_defaults(coarse="none", iterations=LONG),
                          "paper, our soles": paper_contact(kind="springs", relaxation=0.8, iterations=LONG),
                          "paper": paper_contact(ratio=ratio, iterations=LONG)}.items():
        runs[label] = follow(study, Case(with_method(problem, method), {"case": name, "settings": label}), runs.get("defaults"))
    for level, limit in levels.items():
        found = runs["defaults"].sweeps_to("true_error", level)
        study.target(f"{name}, defaults: error ≤ {level:.0e}", f"at most {limit} sweeps", found, found is not None and found <= limit)
    return runs


def soles(study: Study) -> None:
    """Softer and stiffer soles."""
    study.columns = ("case", "factor", "iterations", "sweeps", "sweeps_1e-02", "sweeps_1e-03", "law_residual",
                     "apart", "other_statuses", "stop_reason", "seconds")
    problems = {"3³ cubes, μ = 0.1": pressed_cubes(0.1), "15 grains": grains(15, H[15])}
    figure, axes = grid(1, len(problems), 11.0, 3.6)
    for panel, (name, problem) in zip(axes[0], problems.items()):
        usual, found = None, {}
        for factor, colour in zip(FACTORS, shades(len(FACTORS), "plasma")):
            case = Case(with_method(problem, contact_defaults(factor=factor, law=TOLERANCE)), {"case": name, "factor": factor})
            run = follow(study, case, usual)
            usual = usual or run
            study.rows[-1]["sweeps"] = found[factor] = run.sweeps_to("law_residual", TOLERANCE)
            last = 1.05 * run.solved.iterations * run.scene.steps
            draw(panel, [Curve(run.history, colour, f"soles × {factor:g}")], "law_residual", limits=(1e-7, 10),
                 last=min(max(last, panel.get_xlim()[1]), 3000), sweeps=run.scene.steps, mark=(TOLERANCE, f"{TOLERANCE:g}"))
        for factor in FACTORS[1:]:
            study.target(f"{name}: soles × {factor:g}, law residual ≤ {TOLERANCE:g}", f"at most {SPREAD} × {found[1.0]} sweeps",
                         found[factor], None not in (found[1.0], found[factor]) and found[factor] <= SPREAD * found[1.0])
        panel.set_title(name, fontsize=11)
    study.write()
    label_rows(axes, ("law residual (the largest)",), ABSCISSA)
    study.figure(figure)


def picture(runs: Mapping[str, Mapping[str, Followed]], title: str):
    """A column per problem: the error over the sweeps, and the indicator that hides it."""
    figure, axes = grid(2, len(runs), 11.0)
    for column, (name, methods) in enumerate(runs.items()):
        for panel, quantity, least in zip(axes[:, column], ("true_error", "indicator"), (1e-7, 1e-12)):
            for label, run in methods.items():
                draw(panel, [Curve(run.history, COLOURS[label], label)], quantity, limits=(least, 2),
                     last=LONG // 2 * run.scene.steps, sweeps=run.scene.steps)
        axes[0, column].set_title(name, fontsize=11)
    label_rows(axes, ("error against the solution it tends to", "indicator η (a squared ratio)"), ABSCISSA)
    figure.suptitle(title, fontsize=12)
    return figure
