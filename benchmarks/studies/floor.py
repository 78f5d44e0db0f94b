"""What whole runs take beyond the code's own seconds.

The *floor* is what the code needs by its own clock if all cores share it evenly; a run cannot be quicker than that.
Every run is the command line with its defaults: Python's start, mesh, set-up, iterations, fields and figures.
"""

from __future__ import annotations

from typing import Any

from orchestrator.errors import CONVERGED
from orchestrator.results.figures.plotting import BLUE, GREY, new_figure, png, tidy
from benchmarks.kit.commands import whole_command, without_ranks
from benchmarks.kit.study import Study
from benchmarks.studies.scaling import measured
from benchmarks.problems.cases import GRAIN_H, GRAINS, beam, contact_defaults, cube, grains, with_method

OVER, START = 1.5, 3.0  # limit of the wall time: times the floor, and seconds for Python and the mesh
FACTORISATIONS = 3  # of 128 slices, of which two are ends
CONTACT_OVER, IDLE = 1.3, 0.1  # limits with contact: times the floor without the mesh, idle share of the workers
TOLERANCE = 1e-4  # of the law residual
RANKS = 2
COLUMNS = ("case", "subdomains", "dofs", "iterations", "factorisations", "seconds", "mesh", "floor", "over_floor",
           "idle")


def run(study: Study) -> None:
    """A beam, a block of cubes, and a polycrystal in contact."""
    study.columns = COLUMNS
    for name, config in (("beam of 128 slices", beam(128)), ("5³ cubes", cube(5))):
        row = add(study, name, config)
        limit = OVER * row["floor"] + START
        study.target(f"{name}, tolerance 1e-6: wall time of everything", f"at most {OVER:g} × {row['floor']:.2f} s + "
                     f"{START:g} s = {limit:.1f} s", f"{row['seconds']:.1f} s", row["seconds"] <= limit)
    count = study.rows[0]["factorisations"]
    study.target("beam of 128 slices: factorisations", f"at most {FACTORISATIONS}", count, count <= FACTORISATIONS)
    contact = with_method(grains(GRAINS, GRAIN_H), contact_defaults(error=TOLERANCE))
    for ranks in (1, RANKS) if without_ranks() is None else (1,):
        name = f"{GRAINS} grains in contact" + (f", {ranks} ranks" if ranks > 1 else "")
        row = add(study, name, contact, ranks)
        over = (row["seconds"] - row["mesh"]) / row["floor"]
        study.target(f"{name}, law residual {TOLERANCE:g}: wall time without the mesh",
                     f"at most {CONTACT_OVER:g} × the floor", f"{over:.2f}", over <= CONTACT_OVER)
        study.target(f"{name}: idle share of the workers in the iterations", f"at most {100 * IDLE:.0f} %",
                     f"{100 * row['idle']:.0f} %", row["idle"] <= IDLE)
    study.figure(picture(study.rows))


def add(study: Study, name: str, config: dict[str, Any], ranks: int = 1) -> dict[str, Any]:
    """Run the command, add its row."""
    label = name.replace(" ", "_").replace("³", "3").replace(",", "")
    summary, seconds = whole_command(study, label, config, ranks, accepted=(CONVERGED,))
    shared = sum(entry["saved"].get("factorisations", 0) for entry in summary["skipped"])
    row = {"case": name, **measured(summary, seconds), "mesh": summary["timing"]["mesh"],
           "factorisations": summary["subdomains"] - shared}
    study.rows.append(row)
    study.write()
    study.console.print(f"  {len(study.rows):3}  {name}: {row['iterations']} iterations, {seconds:.1f} s, "
                        f"floor {row['floor']:.2f} s")
    return row


def picture(rows: list[dict[str, Any]]) -> bytes:
    """Wall time beside the floor."""
    figure = new_figure(7.2, 3.0)
    axes = figure.subplots()
    names = [row["case"] for row in rows]
    axes.barh(names, [row["seconds"] for row in rows], color=GREY, label="wall time of the whole command")
    axes.barh(names, [row["floor"] for row in rows], color=BLUE, label="the code's own seconds, shared by all cores")
    axes.set_xscale("log")
    axes.set_xlabel("seconds", fontsize=9)
    axes.invert_yaxis()
    axes.legend(fontsize=8.5, frameon=False)
    tidy(axes)
    figure.tight_layout()
    return png(figure)
