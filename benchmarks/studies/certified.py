"""The energy error with contact beside the true one: random scenes, against solutions in one piece that share no code with the method.

Every scene is drawn from its number: grids, slices, grains, blocks of different stiffness and parts meshed apart, bodies that nothing
but contact holds among them, with gaps, press fits, friction and several load steps. Errors are of the displacements that are
delivered, max_t ‖v − u*‖ / max_t ‖u*‖, from the strains of the difference, which rigid motions do not have.
Where friction allows several exact solutions, and the run is farther from the first one than was asked, the nearest one counts, and the
scene is counted. Beside scenes of all kinds there are pairs of blocks held by supports, with little friction in one load step, whose error
mostly is guaranteed. One scene is also ended after more and more iterations: what a run says of its error at every moment, beside the true one,
over iterations and over seconds. What has been measured is kept beside the study, for ``--resume``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field, PositiveInt

from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, RED, between_lines, level, panels
from benchmarks.kit.settings import RandomScenes
from benchmarks.kit.study import Study
from benchmarks.kit.truth import NOISE, Truth, nearest, solved_in
from benchmarks.problems.cases import with_method
from benchmarks.problems.random_contact import ASKED, CUT, YOUNG, drawn, held
from orchestrator import build_scene, config_from, solve

MEDIAN, LARGEST = 2.0, 6.0  # of guaranteed bounds over true errors
WITHIN, WORST = 0.95, 5.0  # share of the runs whose true error is within what was asked, and what none exceeds it by
FOLLOWED = 7  # number of grains of the scene that is followed

CLAIMS = {"guaranteed": (BLUE, "o"), "guaranteed with friction": (GREEN, "s"), "estimated": (ORANGE, "^")}

Rows = Sequence[Mapping[str, Any]]


class Settings(RandomScenes):
    """What to draw, and who solves it."""

    scenes: PositiveInt = Field(200, description="random scenes, each with an error that is asked for")
    held: int = Field(40, ge=0, description="pairs of held blocks with little friction, one load step each")
    asked: list[float] = Field([], description="errors to ask for, scene after scene in turn; none: one drawn with each")
    follow: bool = Field(True, description="whether one scene is followed over its iterations")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All scenes, then the one that is followed."""
    study.columns = ("scene", "kind", "bodies", "loose", "friction", "gap", "contrast", "steps", "element", "asked", "iterations",
                     "stop_reason", "error_kind", "true_error", "solutions", "error_bound", "effectivity", "seconds")
    numbers = range(settings.first, settings.first + settings.scenes)
    scenes = {str(number): drawn(number, settings.code) for number in numbers}
    scenes |= {f"held-{number}": held(number, settings.code) for number in range(settings.first, settings.first + settings.held)}
    for number, (scene, (data, labels)) in enumerate(scenes.items()):
        if settings.asked:
            labels["asked"] = settings.asked[number % len(settings.asked)]
            data["method"]["tolerance"]["error"] = labels["asked"]
        row = {"scene": scene, **labels, **study.kept(f"scene-{scene}", data, lambda: _judged(data))}
        study.note(row, f"scene {scene}, {', '.join(f'{key} {value}' for key, value in labels.items())}: {_told(row)}")
    followed = study.kept("followed", {"data": _followed(settings.code)}, lambda: _curves(_followed(settings.code))) if settings.follow else {}
    study.figure(_picture(study.rows, followed))
    judge(study)


# --- what is measured -------------------------------------------------------------------------------------


def _told(row: Mapping[str, Any]) -> str:
    """A row in a line."""
    if "failure" in row:
        return f"failed, {row['failure']}"
    return (f"{row['stop_reason']} after {row['iterations']}, {row['error_kind']} {row['error_bound']:.1e}, true {row['true_error']:.1e}"
            + (f", one of {row['solutions']} solutions" if row["solutions"] > 1 else ""))


def _judged(data: dict[str, Any]) -> dict[str, Any]:
    """Columns of a run, and its true error; where there is no run or nothing to compare it with, why."""
    if isinstance(run := solved_in(data), str):
        return {"failure": run}
    scene, solved, seconds = run
    summary, asked = solved.summary, data["method"]["tolerance"]["error"]
    row = {"bodies": summary["subdomains"], "loose": sum(not s.fixed.any() for s in scene.subdomains), "dofs": summary["dofs_decomposed"],
           "iterations": solved.iterations, "stop_reason": solved.stop_reason, "error_kind": summary["error_kind"] or "unknown",
           "error_bound": solved.error_bound, "law_residual": summary["residuals"]["law_residual"], "seconds": round(seconds, 2)}
    truth, count = nearest(scene, solved.sides, asked)
    error = float("nan") if truth is None else truth.error(solved.sides)
    return {**row, "solutions": count, "true_error": error, "effectivity": solved.error_bound / error if error > NOISE else float("nan")}


def _followed(code: str) -> dict[str, Any]:
    """Grains with friction, to the smallest error."""
    return {
        "name": "followed", "mesh": {"polycrystal": {"grains": FOLLOWED, "size": 1.0, "h": 0.22}}, "subdomains": "groups",
        "materials": [{"young": YOUNG, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [[0, 0, -0.005], [0.01, 0, -0.005]]}],
        "interfaces": [{"law": "contact", "friction": 0.1}], "blackbox": {"code": code},
        "method": {"tolerance": {"error": min(ASKED)}, "max_iterations": CUT}, "output": {"fields": False, "figures": False},
    }


def _curves(data: dict[str, Any]) -> dict[str, Any]:
    """Per iteration true error, E and law residual of a run that ends with it, and seconds after which the last of these runs was there."""
    config = config_from(data)
    scene = build_scene(config)
    truth, last = Truth(scene), solve(config, scene)
    ends = {last.iterations: last}
    for count in range(1, last.iterations):
        ends[count] = solve(config_from(with_method(data, {**data["method"], "max_iterations": count})), scene)
    found = [(count, float(seconds), truth.error(end.sides), end.error_bound, float(end.history["law_residual"][-1]))
             for (count, end), seconds in zip(sorted(ends.items()), last.history["seconds"])]
    return dict(zip(("iteration", "seconds", "true_error", "error_bound", "law_residual"), map(list, zip(*found))))


def kind_of(row: Mapping[str, Any]) -> str:
    """What is claimed of the error: guaranteed by convex laws, or with a factor beside friction, or estimated."""
    return "guaranteed with friction" if row["error_kind"] == "guaranteed" and row["friction"] > 0 else row["error_kind"]


def judge(study: Study) -> None:
    """The targets, of what has been run."""
    runs = [row for row in study.rows if "iterations" in row]
    ended = [row for row in runs if row["stop_reason"] == "converged"]
    study.target("runs that converge", f"all {len(study.rows)}", len(ended), len(ended) == len(study.rows))
    for kind in CLAIMS:
        rows = [row for row in runs if kind_of(row) == kind]
        ratios = np.array([row["effectivity"] for row in rows if np.isfinite(row["effectivity"])])
        if not len(ratios):
            continue
        least, middle, most, below = ratios.min(), np.median(ratios), ratios.max(), int((ratios < 1).sum())
        shown = f"{least:.3f}, {middle:.2f}, {most:.2f} of {len(ratios)}; {below} below 1"
        if kind == "guaranteed":
            study.target("guaranteed: bound over true error, least, median, largest", f"at least 1, at most {MEDIAN:g}, {LARGEST:g}", shown,
                         least >= 1 and middle <= MEDIAN and most <= LARGEST)
        else:  # the factor for friction has no limit
            sure = kind != "estimated"
            study.target(f"{kind}: the same", "at least 1" if sure else "told", shown, least >= 1 or not sure)
        # where bodies are loose residuals may end a run, and the error that it tells is above
        claimed = [row for row in rows if row["error_bound"] <= row["asked"]]
        above = [row["true_error"] / row["asked"] for row in claimed if row["true_error"] > row["asked"]]
        study.target(f"{kind}: true error above what was asked, of runs that tell one below it", "told" if kind == "estimated" else "none",
                     f"{len(above)} of {len(claimed)}" + (f", at most {max(above):.2f} times" if above else ""),
                     kind == "estimated" or not above)
    for asked in sorted({row["asked"] for row in runs}, reverse=True):
        for name, rows in _groups([row for row in runs if row["asked"] == asked]):
            shares = np.array([row["true_error"] / asked for row in rows if np.isfinite(row["true_error"])])
            if len(shares):
                within = int((shares <= 1).sum())
                study.target(f"{name}, asked {asked:g}: true error over it", f"at most 1 in {WITHIN:.0%}, {WORST:g}",
                             f"{within} of {len(shares)}; median {np.median(shares):.2f}, largest {shares.max():.2f}",
                             within >= WITHIN * len(shares) and shares.max() <= WORST)
    unknown = sum(not np.isfinite(row["true_error"]) for row in runs)
    study.target("runs without a solution in one piece", "told", f"{unknown} of {len(runs)}", True)
    several = len({row["scene"] for row in runs if row.get("solutions", 0) > 1})
    study.target("scenes with several exact solutions", "told", f"{several} of {len({row['scene'] for row in runs})}", True)


def _groups(rows: Rows) -> Iterator[tuple[str, list[Mapping[str, Any]]]]:
    """Scenes with bodies that nothing but contact holds, and those without."""
    for name, loose in (("loose bodies", True), ("none loose", False)):
        yield name, [row for row in rows if (row["loose"] > 0) == loose]


def _picture(rows: Rows, followed: Mapping[str, Any]):
    """E over true errors; and both over the iterations and the seconds of one run."""
    figure, ((left, middle, right),) = panels(1, 3, (15.0, 4.8))
    limits = (1e-7, 1e-1)
    between_lines(left, LARGEST, limits)
    for kind, (colour, marker) in CLAIMS.items():
        those = [row for row in rows if "error_kind" in row and kind_of(row) == kind]
        left.loglog([row["true_error"] for row in those], [row["error_bound"] for row in those], marker, color=colour, markersize=4,
                    markerfacecolor="none", label=kind)
    left.set_ylabel("energy error that the run tells")
    left.set_title(f"solid: both alike, dashed: {LARGEST:g} times", fontsize=10)
    for axes, abscissa, name in ((middle, "iteration", "iterations"), (right, "seconds", "seconds from the start of the run")):
        for quantity, colour, label in (("error_bound", ORANGE, "energy error, estimated"), ("true_error", GREEN, "true energy error"),
                                        ("law_residual", RED, "law residual")):
            if followed:
                axes.semilogy(followed[abscissa], followed[quantity], ".-", color=colour, linewidth=1.2, markersize=4, label=label)
        level(axes, min(ASKED), "asked")
        axes.set(xlabel=name, ylabel="relative")
        axes.set_title(f"{FOLLOWED} grains, friction 0.1, two load steps", fontsize=10, color=GREY)
    return figure
