"""Grains in frictional contact, from a few to a thousand: iterations and seconds over the number of grains.

A unit cube of Voronoi grains, all interfaces in contact, bottom clamped, sides free, top pressed and sheared both ways:
grains come loose and are caught again. Every run is the command line with its defaults in a process of its own, so that
one that fails is a row like the others. What has been measured is kept beside the run, for ``--resume``. ``others`` is the
load of the machine by other work when a run began: seconds grow with it, shares hardly.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any

from pydantic import Field

from orchestrator.blackbox.pool.pool import default_workers
from orchestrator.config.base import Count, Part, Positive
from orchestrator.errors import BlackBoxError
from orchestrator.results.figures.plotting import BLUE, GREEN, GREY, ORANGE, RED, new_figure, png, tidy
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import STAGES, blackbox_seconds
from benchmarks.kit.commands import whole_command
from benchmarks.kit.study import Study
from benchmarks.studies.grains_targets import MOST, USUAL, judge
from benchmarks.problems.cases import STEEL, with_method

FRICTION = 0.1
TOP = [[0, 0, -0.0005], [0.0005, 0, -0.001], [0.001, 0, -0.001], [0.001, 0, -0.0005]]  # of a cube of side 1
CUT = 2 * MOST  # iterations, after which a run has failed
COLUMNS = ("grains", "seed", "tolerance", "dofs_decomposed", "stop_reason", "iterations", "newton_steps", "coarse_share",
           "code_per_grain", "per_grain", "mesh", "iterating", "seconds", "cpu_per_grain", "others", "GB", "unsolved",
           "spring_force", "live_by_springs", "detached", "far")
_LARGE_FILES = ("fields/*", "fields.npz", "checkpoint/*")


class Settings(Part):
    """What to run: every number of grains with every seed, to every tolerance."""

    counts: Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=1)] = Field(
        [27, 64, 125, 343], description="numbers of grains")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = Field(
        [1, 2, 3], description="of the grains' centres")
    tolerances: Annotated[list[Positive], Field(min_length=1)] = Field([USUAL], description="of the law residual")
    elements: Positive = Field(5.0, description=(
        "elements across a grain, as many for all numbers of grains; with five, a thousand grains have over 500,000 dofs"))
    lloyd: int = Field(0, ge=0, description="relaxation steps towards rounder grains")
    ranks: Count = Field(1, description="MPI ranks of each run")
    method: dict[str, Any] = Field({}, description="further entries of the configuration's `method`")


def problem(count: int, seed: int, elements: float, lloyd: int = 0) -> dict[str, Any]:
    """Grains pressed, sheared, sheared further and half let go.

    Parameters
    ----------
    elements : across a grain, whose size is that of a cube of its volume
    """
    return {
        "name": f"grains-{count}-seed-{seed}",
        "mesh": {"polycrystal": {"grains": count, "size": 1.0, "h": float(f"{count ** (-1 / 3) / elements:.4g}"),
                                 "seed": seed, "lloyd": lloyd}},
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": TOP}],
        "interfaces": [{"law": "contact", "friction": FRICTION}],
    }


def run(study: Study, settings: Settings = Settings(), resume: bool = False) -> None:
    """All runs, the smallest first; table and figure grow with each.

    Parameters
    ----------
    resume : take over what the folder has of the same runs
    """
    study.columns = COLUMNS
    for count, seed, tolerance in product(sorted(settings.counts), settings.seeds, settings.tolerances):
        labels = {"grains": count, "seed": seed, "tolerance": tolerance}
        config = with_method(problem(count, seed, settings.elements, settings.lloyd),
                             {"max_iterations": CUT, **settings.method, "tolerance": {"error": tolerance}})
        study.rows.append({**labels, **_measured(study, config, tolerance, settings.ranks, resume)})
        study.write()
        study.console.print(f"  {len(study.rows):3}  {_told(study.rows[-1])}")
        study.figure(picture(study.rows))
    judge(study)


def _measured(study: Study, config: dict[str, Any], tolerance: float, ranks: int, resume: bool) -> dict[str, Any]:
    """Columns of one run: as kept, or by running it; one that fails says why."""
    name = f"{config['name']}-{tolerance:g}"
    kept, asked = study.folder / f"{name}.json", {"config": config, "ranks": ranks}
    if resume and kept.is_file():
        known = json.loads(kept.read_text(encoding="utf-8"))
        if known["asked"] == asked:
            return known["row"]
    study.folder.remove(kept.name)
    others, begin = os.getloadavg()[0], _cpu_of_children()
    try:
        with study.console.status(name):
            summary, seconds = whole_command(study, name, config, ranks)
    except BlackBoxError as error:  # of whatever kind: the command has ended
        return {"stop_reason": "failed", "message": " ".join(str(error).split())}
    row = {**columns(summary, seconds), "cpu_per_grain": (_cpu_of_children() - begin) / summary["subdomains"],
           "others": round(others, 1)}
    study.folder.write(kept.name, json.dumps({"asked": asked, "row": row}, indent=1))
    if summary["converged"]:
        ResultsFolder(study.folder / name).remove(*_LARGE_FILES)
    return row


def _cpu_of_children() -> float:
    """CPU seconds of all processes that have ended: what a busy machine does not change."""
    used = os.times()
    return used.children_user + used.children_system


def columns(summary: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Columns of a row.

    Parameters
    ----------
    summary : of the run; seconds : wall time of its command

    Returns
    -------
    among them ``unsolved``, how many solves of the coarse problem ended before their tolerance; what stabilisation
    carried, over the largest contact force and the largest energy; bodies that live by it, that nothing presses on, and that ended
    beyond small displacements
    """
    timing, period, count = summary["timing"], summary["workload"]["iterations"], summary["subdomains"]
    # rank 0 solves the coarse problem for all, who wait for it
    coarse = max((row["seconds"] for row in period["stages"] if row["stage"] == "coarse"), default=0.0)
    codes = blackbox_seconds(timing)
    springs, ends = summary["stabilised"] or {}, summary["coarse_ends"]  # none where stabilisation is set to 0
    return {
        **{key: summary[key] for key in ("dofs", "dofs_decomposed", "interfaces", "interface_nodes", "stop_reason",
                                         "iterations", "newton_steps")},
        "law_residual": summary["residuals"]["law_residual"], "coarse_share": coarse / period["seconds"],
        "coarse_per_grain": coarse / count, "code_seconds": codes, "code_per_grain": codes / count,
        "per_grain": seconds / count, "iterating": period["seconds"], "seconds": seconds,
        **{stage: timing[stage] for stage in STAGES if stage in timing}, "GB": summary["memory_peak_mb"] / 1000,
        "unsolved": sum(ends.values()) - ends.get("tolerance", 0),
        **{f"spring_{key}": springs.get(key) for key in ("epsilon", "force", "work")},
        "live_by_springs": len({name for step in springs.get("bodies", ()) for name in step}),
        "far": len({entry["body"] for entry in summary["far_bodies"]}),
        "detached": len({name for step in summary["detached"] for name in step}),
    }


def _told(row: Mapping[str, Any]) -> str:
    """A row as a line."""
    what = f"{row['grains']} grains, seed {row['seed']}, {row['tolerance']:g}: "
    if "iterations" not in row:
        return f"{what}{row['stop_reason']}, {row['message']}"
    return (f"{what}{row['iterations']} iterations, {row['stop_reason']}, {row['newton_steps']} Newton steps, coarse problem "
            f"{100 * row['coarse_share']:.0f} %, {row['seconds']:.1f} s, {row['GB']:.1f} GB")


def picture(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Iterations, and seconds per grain, over the number of grains: a mark per run, lines through the means."""
    figure = new_figure(10.0, 3.8)
    left, right = figure.subplots(1, 2)
    finished = [row for row in rows if "iterations" in row]
    for tolerance, colour in zip(sorted({row["tolerance"] for row in finished}, reverse=True),
                                 (BLUE, ORANGE, GREEN, RED)):
        those = [row for row in finished if row["tolerance"] == tolerance]
        _draw(left, those, "iterations", colour, f"law residual {tolerance:.0e}")
    usual = [row for row in finished if row["tolerance"] == max(r["tolerance"] for r in finished)]
    cores = default_workers()
    for quantity, colour, label, scale in (
            ("per_grain", GREY, "whole command", 1), ("coarse_per_grain", ORANGE, "coarse contact problem", 1),
            ("code_per_grain", BLUE, f"the codes' own, shared by {cores} cores", 1 / cores)):
        _draw(right, usual, quantity, colour, label, scale)
    left.axhline(MOST, color=GREY, linestyle=":", linewidth=1)
    left.set_ylabel("iterations", fontsize=9.5)
    right.set_ylabel("seconds per grain", fontsize=9.5)
    for axes in (left, right):
        axes.set_ylim(bottom=0)
        axes.set_xscale("log")
        counts = sorted({row["grains"] for row in rows})
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.set_xlabel("grains", fontsize=9.5)
        axes.tick_params(labelsize=8.5)
        if finished:
            axes.legend(fontsize=8.5, frameon=False)
        tidy(axes)
    figure.tight_layout()
    return png(figure)


def _draw(axes: Any, rows: Sequence[Mapping[str, Any]], quantity: str, colour: str, label: str, scale: float = 1) -> None:
    """A mark per run, hollow where it did not converge, and a line through the means of each number of grains."""
    counts = sorted({row["grains"] for row in rows})
    values = [[scale * row[quantity] for row in rows if row["grains"] == count] for count in counts]
    axes.plot(counts, [sum(v) / len(v) for v in values], color=colour, linewidth=1.3, label=label)
    for converged in (True, False):
        those = [row for row in rows if (row["stop_reason"] == "converged") == converged]
        axes.plot([row["grains"] for row in those], [scale * row[quantity] for row in those], "o", color=colour,
                  markersize=4, markerfacecolor=colour if converged else "none", label="_")
