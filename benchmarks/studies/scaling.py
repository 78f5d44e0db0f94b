"""Strong and weak scaling on this machine, and what the measured costs predict for a cluster.

Every run is the whole command in processes of its own. Nothing is shared, so that runs differ in the cores alone.
The *floor* is what the code needs by its own clock if all cores share it evenly. The prediction's costs are those of runs with one and
two ranks; what it says of four is held against what these take.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any

from pydantic import Field

from benchmarks.kit.commands import CONVERGED, CORES, cpu_of_children, shares, whole_command, without_ranks
from benchmarks.kit.drawing import BLUE, BROWN, GREEN, GREY, OLIVE, ORANGE, PURPLE, RED, SKY, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.cases import STEEL
from benchmarks.studies import ranks as over_ranks
from benchmarks.studies.grains import Sides, USUAL
from benchmarks.studies.prediction import (
    BANDWIDTH,
    FIELDS,
    LATENCY,
    PERIODS,
    TOLD,
    Costs,
    MacroCosts,
    largest,
    limit,
    measure_macro,
    on_cores,
    predict,
    ranks_of,
)
from orchestrator import config_from
from orchestrator.parallel.team import Team

ELEMENTS = 16  # along the side of a cube
REPEATS = 3  # runs of which the least of each cost is taken for the prediction
STRONG = (2, 2, 2)  # cubes
SPEEDUP, BALANCE = 1.7, 0.95  # wanted of two workers
OFF, ALONE = 0.2, 0.5  # how far the model may be off; others' load, up to which wall seconds tell something of it
CLUSTER = (1_000, 10_000, 100_000)  # subdomains
COLUMNS = ("case", "ranks", "workers", "subdomains", "dofs", "iterations", "seconds", "efficiency", "floor",
           "over_floor", "factorising", "busiest_factorising", "balance", "idle", "others", "cpu", "waiting", "messages", "sums", "MB")
SHOWN = [("set_up", "scene, by rank 0"), ("set_up", "ranks' parts, by rank 0"), ("set_up", "outline of the scene, on every rank"),
         ("set_up", "factorise"), ("set_up", "macro problem: borders"),
         ("set_up", "repositioning"), ("iterations", "orchestrator"), ("iterations", "reductions"),
         ("iterations", "solve"), ("iterations", "macro problem: borders")]


def cubes(counts: Sequence[int], elements: int) -> dict[str, Any]:
    """Unit cubes in a row, a layer or a block, clamped at x = 0 and pulled; each is factorised by itself. Rigid motions are the macro
    basis, as they are of thousands of interfaces."""
    return {
        "name": "cubes", "mesh": {"box": {"size": list(counts), "cells": [elements * c for c in counts]}},
        "subdomains": {"grid": list(counts)}, "materials": STEEL,
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": counts[0]}, "traction": [10, 0, 10]}],
        "method": {"skip": {"congruent": False}, "macro": {"basis": "rigid"}},
        "output": {"fields": False, "figures": False},
    }


class Settings(Keys):
    """What is solved."""

    grains: list[Annotated[int, Field(ge=2)]] = Field([], description="numbers of grains in contact, in place of cubes: see `study ranks`")
    sides: list[Sides] = Field(["rollers", "free"], description="of grains: what holds the sides of their cube")


def run(study: Study, elements: int = ELEMENTS, repeats: int = REPEATS, settings: Settings = Settings()) -> None:
    """All rows, the targets, the prediction and the figure."""
    if settings.grains:
        over_ranks.run(study, over_ranks.Settings(counts=settings.grains, sides=settings.sides, kernels=[""], tolerance=USUAL))
        return
    study.columns = COLUMNS
    missing = without_ranks()
    rows = [("strong", STRONG, 1, 1), ("strong", STRONG, 1, 2), ("weak", (1, 2, 2), 1, 1), ("weak", STRONG, 1, 2)]
    if missing is None:
        rows += [("strong", STRONG, 2, 1), ("strong", STRONG, 4, 1), ("weak", STRONG, 2, 1), ("weak", (4, 2, 2), 4, 1)]
    else:
        study.console.print(f"  ranks 2 and 4 are left out: {missing}")
    summaries = [_row(study, *row, elements) for row in rows]
    _targets(study)
    alone = [(summaries[0], study.rows[0]["cpu"])] + [_measured_run(study, "alone", STRONG, 1, 1, elements)[::2] for _ in range(repeats - 1)]
    start = _measured_run(study, "start", STRONG, 1, 1, 2)[2]
    costs = Costs.least([Costs.of(*run, start, lambda counts, elements: config_from(cubes(counts, elements)), elements) for run in alone])
    if missing is None:
        costs = costs.apart(summaries[4], _measured_run(study, "start", STRONG, 2, 1, 2)[2] / 2)
    macro, measured = measure_macro()
    dofs = summaries[0]["dofs_decomposed"] // summaries[0]["subdomains"]
    told = text(costs, macro, measured, dofs, study.rows[0]["others"])
    checked = "" if missing else check(study, costs, macro)
    (study.folder / "prediction.md").write_text("\n".join([told, checked, stages(summaries[:1] + summaries[4:6])]), encoding="utf-8")
    study.figure(picture(study.rows, costs, macro))
    for count in CLUSTER:
        parts = predict(costs, macro, count)
        set_up, loop, end = (sum(parts[p].values()) for p in ("set_up", "iterations", "end"))
        name, share = largest(parts)
        study.console.print(f"  {count:,} subdomains on as many cores, predicted: set-up {set_up:.3g} s, iterations "
                            f"{loop:.3g} s, of which the code solves {parts['iterations']['solve']:.3g} s, end {end:.3g} s; "
                            f"{100 * share:.0f} % for {name}")
    study.console.print(f"  the macro problem outweighs the code's own work from {limit(costs, macro):,} subdomains on; see "
                        "prediction.md")


def _row(study: Study, case: str, counts: Sequence[int], ranks: int, workers: int, elements: int) -> dict[str, Any]:
    """Run one configuration, add its row; its summary."""
    others = os.getloadavg()[0]
    summary, seconds, cpu = _measured_run(study, case, counts, ranks, workers, elements)
    told, count = summary["workload"]["iterations"]["ranks"], summary["iterations"]
    each = {name: max(rank[key] for rank in told) / count for name, key in (("messages", "messages"), ("sums", "reductions"), ("MB", "bytes"))}
    row = {"case": case, "ranks": ranks, "workers": workers, **shares(summary, seconds), "others": round(others, 1), "cpu": cpu,
           "waiting": max(rank["idle_share"] for rank in told), **each, "MB": each["MB"] / 1e6}
    row["efficiency"] = efficiency(row, next((r for r in study.rows if r["case"] == case), row))
    study.note(row, f"{case}, {ranks} rank(s) of {workers} worker(s): {row['iterations']} iterations, {seconds:.1f} s, "
                    f"efficiency {row['efficiency']:.2f}, others' load {others:.1f}")
    return summary


def _measured_run(study: Study, case: str, counts: Sequence[int], ranks: int, workers: int,
                  elements: int) -> tuple[dict[str, Any], float, float]:
    """Summary, wall and CPU seconds of one configuration."""
    begin = cpu_of_children()
    summary, seconds = whole_command(study, f"{case}-{ranks}-{workers}",
                                     {**cubes(counts, elements), "blackbox": {"workers": workers}}, ranks, accepted=(CONVERGED,))
    return summary, seconds, cpu_of_children() - begin


def efficiency(row: dict[str, Any], alone: dict[str, Any]) -> float:
    """Speed-up over the run on one core per core used; for weak scaling per subdomain and iteration too.

    More workers than the machine has cores use no more than these.
    """
    cores = min(row["ranks"] * row["workers"], CORES)
    work = row["subdomains"] * row["iterations"] / alone["subdomains"] / alone["iterations"]
    return alone["seconds"] / row["seconds"] * work / cores


def _targets(study: Study) -> None:
    one, two = study.rows[:2]
    speedup = one["factorising"] / two["factorising"]
    study.target("2 workers against 1: assembling and factorising (both cores free)",
                 f"at least {SPEEDUP} times as fast",
                 f"{speedup:.2f}; others' load {max(one['others'], two['others']):.1f}", speedup >= SPEEDUP)
    own = one["busiest_factorising"] / two["busiest_factorising"]
    study.target("the same by the code's own clock of the busiest worker, whatever else the cores do",
                 f"at least {SPEEDUP}", f"{own:.2f}", own >= SPEEDUP)
    study.target("balance of the whole run: mean over busiest worker, by the code's clock", f"at least {BALANCE}",
                 f"{two['balance']:.3f}", two["balance"] >= BALANCE)


def check(study: Study, costs: Costs, macro: MacroCosts) -> str:
    """What the model says of the strong runs over ranks beside what they took, as Markdown; its costs have not seen those with four."""
    lines = [f"Held against runs of the study, on {CORES} cores; four ranks are not among those that the costs come from:", "",
             "| ranks | CPU seconds: predicted | measured | wall: predicted | measured | others' load |", "| ---: " * 6 + "|"]
    for row in (row for row in study.rows if row["case"] == "strong" and row["workers"] == 1):
        wall, cpu = on_cores(costs, macro, row["subdomains"], row["ranks"], CORES)
        lines.append(f"| {row['ranks']} | {cpu:.2f} | {row['cpu']:.2f} | {wall:.2f} | {row['seconds']:.2f} | {row['others']:g} |")
        if row["ranks"] == 4:
            for what, found, measured in (("CPU", cpu, row["cpu"]), ("wall", wall, row["seconds"])):
                if what == "CPU" or row["others"] <= ALONE:
                    study.target(f"{what} seconds of 4 ranks, predicted from runs with 1 and 2", f"within {100 * OFF:.0f} %",
                                 f"{found:.2f}, measured {measured:.2f}", abs(found / measured - 1) <= OFF)
    return "\n".join([*lines, ""])


def stages(summaries: Sequence[dict[str, Any]]) -> str:
    """Seconds of every stage on the rank that has the longest, others not waited for, as Markdown."""
    table: dict[str, list[float]] = {}
    for place, summary in enumerate(summaries):
        for period in PERIODS:
            for row in summary["workload"][period]["stages"]:
                found = table.setdefault(f"{period.replace('_', '-')}: {row['stage'].replace('_', ' ')}", [0.0] * len(summaries))
                found[place] = max(found[place], row["seconds"] - row["waiting"])
    return "\n".join(["| seconds, waiting for others left out | " + " | ".join(f"{s['ranks']} rank(s)" for s in summaries) + " |",
                      "| --- |" + " ---: |" * len(summaries),
                      *(f"| {name} | " + " | ".join(f"{seconds:.3g}" for seconds in found) + " |" for name, found in table.items()), ""])


def text(costs: Costs, macro: MacroCosts, measured: list[dict[str, float]], dofs: int, others: float) -> str:
    """The prediction with its assumptions, as Markdown.

    Parameters
    ----------
    measured : of the macro problem; dofs : of a subdomain; others : load of the machine by other work
    """
    found = [predict(costs, macro, count) for count in CLUSTER]
    each = [ranks_of(costs, macro, count) for count in CLUSTER]
    lines = [
        "# A cluster, predicted from costs measured on this machine", "",
        f"N cubes of {dofs:,} dofs in a block, one to a core, a block of them to a rank; the run takes as many iterations as the "
        f"one measured, {costs.iterations}: the macro problem makes them independent of N (`study cubes`). "
        f"While it was measured, other work loaded the machine with {others:g} processes. All costs are CPU seconds, factorise and solve "
        "on the code's own clock, and the least of all repetitions.", "",
        "| measured, seconds | |", "| --- | ---: |",
        *(f"| {name.replace('_', ' ')} | {value:.3g} |" for name, value in asdict(costs).items()), "",
        f"The macro problem has {FIELDS} unknowns per interface. A rank factorises and solves what it alone sees. Measured on "
        "matrices of its pattern, with the ordering of a run:", "",
        "| subdomains | unknowns | factorise s | solve s | repositioning: unknowns | factorise s | solve s |",
        "| ---: " * 7 + "|",
        *(f"| {r['subdomains']:,} | {r['unknowns']:,} | {r['factorise']:.3g} | {r['solve']:.3g} | "
          f"{r['rigid_unknowns']:,} | {r['rigid_factorise']:.3g} | {r['rigid_solve']:.3g} |" for r in measured), "",
        "They grow with the number of subdomains to the power " + ", ".join(
            f"{getattr(macro, q)[1]:.2f} ({q.replace('_', ': ').replace('rigid', 'repositioning')})"
            for q in ("factorise", "solve", "rigid_factorise", "rigid_solve")) +
        f"; nested dissection would give 2 and 1.33 for many. Up to {Team.shared_from:,} unknowns n on the borders between ranks are a dense "
        f"problem on every rank: {macro.border[0]:.2g} n³ s to factorise, {macro.border[1]:.2g} n² s to solve. More are MUMPS's, which "
        f"has the macro problem of as many subdomains as there are ranks, with more unknowns to an interface; so it is with {Team.shared_from:,} "
        "unknowns of repositioning, all of them MUMPS's.", "",
        f"Assumed: {LATENCY * 1e6:g} µs per message and {BANDWIDTH / 1e9:g} GB/s, logarithmic trees for reductions, "
        f"{TOLD * 1e6:g} µs of rank 0 for what each rank tells it in the end, "
        "none of it hidden behind work; R ranks make MUMPS √R times as fast as one, but for the order of elimination, "
        f"which one finds for all in {macro.order[0]:.2g} N^{macro.order[1]:.2f} and, of repositioning, {macro.rigid_order[0]:.2g} "
        f"N^{macro.rigid_order[1]:.2f} s; "
        "cores as fast as this one with the memory bandwidth to themselves; growth as "
        "measured; the rank works for its subdomains one after the other. Rank 0 makes the scene and hands the parts out one after "
        "the other; every rank has names, neighbours and a few numbers of all others.", "",
        "| seconds | " + " | ".join(f"{count:,} subdomains" for count in CLUSTER) + " |",
        "| --- |" + " ---: |" * len(CLUSTER),
        "| subdomains to a rank, the best number | " + " | ".join(f"{m:,}" for m, _, _ in each) + " |",
        "| unknowns on borders (GB of their matrix on each rank) | " + " | ".join(f"{n:,.0f} ({gb:.2g})" for _, n, gb in each) + " |"]
    for period, name in (("set_up", "set-up"), ("iterations", "iterations"), ("end", "end")):
        for what in found[0][period]:
            lines.append(f"| {name}: {what} | " + " | ".join(f"{f[period][what]:.3g}" for f in found) + " |")
    total = [sum(sum(part.values()) for part in f.values()) for f in found]
    code = [f["iterations"]["solve"] + f["set_up"]["factorise"] + f["set_up"]["macro columns"] for f in found]
    lines += ["| in all | " + " | ".join(f"{seconds:.3g}" for seconds in total) + " |",
              "| the code's share | " + " | ".join(f"{100 * c / t:.2g} %" for c, t in zip(code, total)) + " |",
              "| the largest term | " + " | ".join("{} ({:.0f} %)".format(n, 100 * s) for n, s in map(largest, found)) + " |"]
    lines += ["", f"From {limit(costs, macro):,} subdomains on the macro problem takes longer than the code's own work. What limits "
              "a run is named in the last row.", ""]
    return "\n".join(lines)


def picture(rows: Sequence[dict[str, Any]], costs: Costs, macro: MacroCosts):
    """Efficiencies as bars; seconds of the predicted parts over the number of subdomains."""
    figure, ((left, right),) = panels(1, 2, (11.0, 4.0))
    left.bar([f"{r['case']}\n{r['ranks']}×{r['workers']}" for r in rows], [r["efficiency"] for r in rows],
             color=[BLUE if r["case"] == "strong" else ORANGE for r in rows])
    left.axhline(1, color=GREY, linewidth=1, linestyle=":")
    left.set_title("Efficiency per core used; ranks × workers", fontsize=10)
    counts = [int(10**(k / 4)) for k in range(4, 21)]
    found = [predict(costs, macro, count) for count in counts]
    for (period, what), colour in zip(SHOWN, (GREY, OLIVE, SKY, ORANGE, BROWN, GREEN, PURPLE, BLUE, RED)):
        right.loglog(counts, [f[period][what] for f in found], "--" if period == "set_up" else "-", color=colour, label=what)
    right.set(title="Predicted seconds, one subdomain per core", xlabel="subdomains")
    return figure
