"""Grains in frictional contact, from a few to a thousand: iterations and seconds over the number of grains.

A unit cube of Voronoi grains, all interfaces in contact, bottom clamped. ``free``: the sides are free and the top is pressed
and sheared both ways, so that grains come loose and are caught again. ``rollers``: the sides are on rollers and the top is
pressed and half let go twice. Every run is the command line with its defaults in a process of its own, so that
one that fails is a row like the others. What has been measured is kept beside the run, for ``--resume``. ``others`` is the
load of the machine by other work when a run began: seconds grow with it, shares hardly.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import product
from operator import itemgetter
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from benchmarks.kit.commands import CORES, codes_seconds, cpu_of_children, whole_command
from benchmarks.kit.drawing import BLUE, GREY, ORANGE, PALETTE, level, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.cases import grains, with_method
from orchestrator import BlackBoxError

FIRST, MOST, GROWTH = 64, 50, 1.3  # iterations: at most, and as a multiple of those of so many grains
USUAL, TIGHTER = 1e-4, 2.5  # the tolerance that this is about; iterations of tighter ones over its own
SHARES = ((343, 0.25), (1000, 0.40))  # up to so many grains: share of the coarse problem in the iterations' wall time
LARGE, DOFS, SECONDS, MEMORY = 1000, 500_000, 600, 16  # grains; their decomposed dofs at least; limits, GB
CUT = 2 * MOST  # iterations, after which a run has failed
TOP = [[0, 0, -0.0005], [0.0005, 0, -0.001], [0.001, 0, -0.001], [0.001, 0, -0.0005]]  # of a cube of side 1
PRESSED = [[None, None, -0.0005 * step] for step in (1, 2, 1, 2)]  # the same between rollers
ROLLERS = [{"on": f"{axis}{end}", "displacement": [0 if a == axis else None for a in "xyz"]}
           for axis in "xy" for end in ("min", "max")]
Sides = Literal["free", "rollers"]

Rows = Sequence[Mapping[str, Any]]


class Settings(Keys):
    """What to run: every number of grains with every seed, to every tolerance."""

    counts: Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=1)] = Field(
        [27, 64, 125, 343], description="numbers of grains")
    sides: Annotated[list[Sides], Field(min_length=1)] = Field(
        ["free"], description="free, or rollers, which hold the sides of the cube")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = Field(
        [1, 2, 3], description="of the grains' centres")
    tolerances: Annotated[list[PositiveFloat], Field(min_length=1)] = Field([USUAL], description="of the energy error")
    friction: NonNegativeFloat = Field(0.3, description=(
        "coefficient of friction; from 343 grains on 0.1 is too little for a pile with free sides to carry anything"))
    elements: PositiveFloat = Field(5.0, description=(
        "elements across a grain, as many for all numbers of grains; with five, a thousand grains have over 500,000 dofs"))
    lloyd: int = Field(0, ge=0, description="relaxation steps towards rounder grains")
    ranks: PositiveInt = Field(1, description="MPI ranks of each run")
    method: dict[str, Any] = Field({}, description="further entries of the configuration's `method`")
    figures: bool = Field(True, description="whether every run draws its figures")


def problem(count: int, seed: int, elements: float, lloyd: int = 0, friction: float = 0.3,
            sides: Sides = "free") -> dict[str, Any]:
    """Return the configuration of ``count`` grains, with ``elements`` elements across a cube of a grain's volume."""
    size = float(f"{count ** (-1 / 3) / elements:.4g}")
    config = grains(count, size, friction, TOP if sides == "free" else PRESSED, seed=seed, lloyd=lloyd)
    if sides == "rollers":
        config["boundary"] += ROLLERS
    return config


def run(study: Study, settings: Settings = Settings()) -> None:
    """All runs, the smallest first; table and figure grow with each."""
    study.columns = ("grains", "sides", "seed", "tolerance", "dofs_decomposed", "stop_reason", "iterations", "newton_steps", "coarse_share",
                     "code_per_grain", "per_grain", "mesh", "iterating", "seconds", "cpu_per_grain", "others", "GB", "unsolved",
                     "spring_force", "live_by_springs", "detached", "far")
    for count, sides, seed, tolerance in product(sorted(settings.counts), settings.sides, settings.seeds,
                                                 settings.tolerances):
        config = with_method(problem(count, seed, settings.elements, settings.lloyd, settings.friction, sides),
                             {"max_iterations": CUT, **settings.method, "tolerance": {"error": tolerance}})
        config["output"] = {"figures": settings.figures}
        name = f"grains-{count}-{sides}-seed-{seed}-{tolerance:g}"
        row = {"grains": count, "sides": sides, "seed": seed, "tolerance": tolerance, **study.kept(
            name, {"config": config, "ranks": settings.ranks}, lambda: _measured(study, name, config, settings.ranks))}
        study.note(row, f"{count} grains, {sides}, seed {seed}, {tolerance:g}: " + (
            f"{row['iterations']} iterations, {row['stop_reason']}, {row['newton_steps']} Newton steps, coarse problem "
            f"{100 * row['coarse_share']:.0f} %, {row['seconds']:.1f} s, {row['GB']:.1f} GB" if "iterations" in row else
            f"failed, {row['failure']}"))
        study.figure(_picture(study.rows))
    judge(study)


def _measured(study: Study, name: str, config: dict[str, Any], ranks: int) -> dict[str, Any]:
    """Columns of one run; one that fails says why."""
    others, begin = os.getloadavg()[0], cpu_of_children()
    try:
        summary, seconds = whole_command(study, name, config, ranks)
    except BlackBoxError as error:  # of whatever kind: the command has ended
        return {"stop_reason": "failed", "failure": " ".join(str(error).split())}
    if summary["converged"]:
        for path in [study.folder / name / "fields.npz", *(study.folder / name / "fields").glob("*")]:
            path.unlink(missing_ok=True)  # large
    return {**_columns(summary, seconds), "cpu_per_grain": (cpu_of_children() - begin) / summary["subdomains"], "others": round(others, 1)}


def _columns(summary: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Columns of a run of so many wall seconds.

    Returns
    -------
    among them ``unsolved``, how many solves of the coarse problem ended before their tolerance; what stabilisation
    carried, over the largest contact force and the largest energy; bodies that live by it, that nothing presses on, and that ended
    beyond small displacements
    """
    timing, period, count = summary["timing"], summary["workload"]["iterations"], summary["subdomains"]
    # rank 0 solves the coarse problem for all, who wait for it
    coarse = max((row["seconds"] for row in period["stages"] if row["stage"] == "coarse"), default=0.0)
    codes = codes_seconds(summary)
    springs, ends = summary["stabilised"] or {}, summary["coarse_ends"]  # none where stabilisation is set to 0
    return {
        **{key: summary[key] for key in ("dofs", "dofs_decomposed", "interfaces", "interface_nodes", "stop_reason",
                                         "iterations", "newton_steps")},
        "law_residual": summary["residuals"]["law_residual"], "coarse_share": coarse / period["seconds"],
        "coarse_per_grain": coarse / count, "code_seconds": codes, "code_per_grain": codes / count,
        "per_grain": seconds / count, "iterating": period["seconds"], "seconds": seconds, "mesh": timing["mesh"],
        "GB": summary["memory_peak_mb"] / 1000, "unsolved": sum(ends.values()) - ends.get("tolerance", 0),
        **{f"spring_{key}": springs.get(key) for key in ("epsilon", "force", "work")},
        "live_by_springs": len({name for step in springs.get("bodies", ()) for name in step}),
        "far": len({entry["body"] for entry in summary["far_bodies"]}),
        "detached": len({name for step in summary["detached"] for name in step}),
    }


def judge(study: Study) -> None:
    """The targets, of what has been run."""
    usual = [row for row in study.rows if row["tolerance"] == USUAL]
    for tolerance in sorted({row["tolerance"] for row in study.rows}, reverse=True):
        rows = [row for row in study.rows if row["tolerance"] == tolerance]
        good = [row for row in rows if row["stop_reason"] == "converged"]
        study.target(f"energy error {tolerance:g}: runs that converge", f"all {len(rows)}", len(good), len(good) == len(rows))
        of = itemgetter("grains", "sides", "seed")
        before = {of(row): row["iterations"] for row in usual if row["stop_reason"] == "converged"}
        ratios = [row["iterations"] / before[of(row)] for row in good if of(row) in before]
        if tolerance < USUAL and ratios:
            study.target(f"the same: iterations over those to {USUAL:g}", f"at most {TIGHTER:g}", f"{max(ratios):.2f}",
                         max(ratios) <= TIGHTER)
    if usual:
        _judge_iterations(study, usual)
        _judge_shares(study, usual)
    large = [row for row in usual if row["grains"] >= LARGE]
    if large:
        shown = "; ".join(f"{row['dofs_decomposed']:,} dofs, {row['seconds']:.0f} s, {row['GB']:.1f} GB" for row in large
                          if "iterations" in row)
        study.target(f"{LARGE} grains, at least {DOFS:,} decomposed dofs, everything included", f"at most {SECONDS} s and {MEMORY} GB",
                     shown or None, all(row["stop_reason"] == "converged" and row["dofs_decomposed"] >= DOFS
                                        and row["seconds"] <= SECONDS and row["GB"] <= MEMORY for row in large))


def _judge_iterations(study: Study, rows: Rows) -> None:
    """Their number, and its growth with that of the grains."""
    good = [row for row in rows if row["stop_reason"] == "converged"]
    if good:
        most = max(good, key=lambda row: row["iterations"])
        study.target("the most iterations", f"at most {MOST}", f"{most['iterations']}: {most['grains']} grains, "
                     f"{most['sides']}, seed {most['seed']}", len(good) == len(rows) and most["iterations"] <= MOST)
    mean = {}
    for count in sorted({row["grains"] for row in rows}):
        those = [row for row in rows if row["grains"] == count]
        ended = all(row["stop_reason"] == "converged" for row in those)
        mean[count] = sum(row["iterations"] for row in those) / len(those) if ended else None
    larger = [count for count in mean if count > FIRST]
    if FIRST in mean and larger:
        known = mean[FIRST] is not None and all(mean[count] is not None for count in larger)
        growth = max(mean[count] for count in larger) / mean[FIRST] if known else None
        study.target(f"mean iterations, {larger[0]} … {larger[-1]} grains over {FIRST}", f"at most {GROWTH:g}",
                     growth and f"{growth:.2f}", known and growth <= GROWTH)


def _judge_shares(study: Study, rows: Rows) -> None:
    """Of the coarse problem in the iterations' wall time."""
    least = 0
    for most, limit in SHARES:
        those = [row for row in rows if least < row["grains"] <= most and "coarse_share" in row]
        if those:
            share = max(row["coarse_share"] for row in those)
            study.target(f"share of the coarse problem in the iterations' wall time, {those[0]['grains']} … {those[-1]['grains']} grains",
                         f"at most {100 * limit:.0f} %", f"{100 * share:.0f} %", share <= limit)
        least = most


def _picture(rows: Rows):
    """Iterations, and seconds per grain, over the number of grains: a mark per run, lines through the means."""
    figure, ((left, right),) = panels(1, 2, (10.0, 3.8))
    done = [row for row in rows if "iterations" in row]
    tolerances = sorted({row["tolerance"] for row in done}, reverse=True)
    for tolerance, colour in zip(tolerances, PALETTE):
        _draw(left, [row for row in done if row["tolerance"] == tolerance], "iterations", colour, f"energy error {tolerance:.0e}")
    for quantity, colour, label, scale in (
            ("per_grain", GREY, "whole command", 1), ("coarse_per_grain", ORANGE, "coarse contact problem", 1),
            ("code_per_grain", BLUE, f"the codes' own, shared by {CORES} cores", 1 / CORES)):
        _draw(right, [row for row in done if row["tolerance"] == tolerances[0]], quantity, colour, label, scale)
    level(left, MOST)
    counts = sorted({row["grains"] for row in rows})
    for axes, name in ((left, "iterations"), (right, "seconds per grain")):
        axes.set(ylim=(0, None), xscale="log", xlabel="grains", ylabel=name)
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
    return figure


def _draw(axes: Any, rows: Rows, quantity: str, colour: str, label: str, scale: float = 1) -> None:
    """A mark per run, hollow where it did not converge, and a line through the means of each number of grains."""
    counts = sorted({row["grains"] for row in rows})
    values = [[scale * row[quantity] for row in rows if row["grains"] == count] for count in counts]
    axes.plot(counts, [sum(v) / len(v) for v in values], color=colour, linewidth=1.3, label=label)
    for converged in (True, False):
        those = [row for row in rows if (row["stop_reason"] == "converged") == converged]
        axes.plot([row["grains"] for row in those], [scale * row[quantity] for row in those], "o", color=colour,
                  markersize=4, markerfacecolor=colour if converged else "none", label="_")
