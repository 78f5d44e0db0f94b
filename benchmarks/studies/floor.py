"""What whole runs take beyond the code's own seconds.

The *floor* is what the code needs by its own clock if all cores share it evenly; a run cannot be quicker than that.
Every run is the command line with its defaults: Python's start, mesh, set-up, iterations, fields and figures.
"""

from __future__ import annotations

from typing import Any

from benchmarks.kit.commands import CONVERGED, shares, whole_command, without_ranks
from benchmarks.kit.drawing import BLUE, GREY, panels
from benchmarks.kit.study import Study
from benchmarks.problems.cases import GRAIN_H, GRAINS, beam, contact_defaults, cube, grains, with_method

OVER, START = 1.5, 3.0  # limit of the wall time: times the floor, and seconds for Python and the mesh
FACTORISATIONS = 3  # of 128 slices, of which two are ends
CONTACT_OVER, IDLE = 1.3, 0.1  # limits with contact: times the floor without the mesh, idle share of the workers
TOLERANCE = 1e-4  # of the law residual
RANKS = 2


def run(study: Study) -> None:
    """A beam, a block of cubes, and a polycrystal in contact."""
    study.columns = ("case", "subdomains", "dofs", "iterations", "factorisations", "seconds", "mesh", "floor", "over_floor", "idle")
    for name, config in (("beam of 128 slices", beam(128)), ("5³ cubes", cube(5))):
        row = _add(study, name, config)
        limit = OVER * row["floor"] + START
        study.target(f"{name}, tolerance 1e-6: wall time of everything", f"at most {OVER:g} × {row['floor']:.2f} s + "
                     f"{START:g} s = {limit:.1f} s", f"{row['seconds']:.1f} s", row["seconds"] <= limit)
    count = study.rows[0]["factorisations"]
    study.target("beam of 128 slices: factorisations", f"at most {FACTORISATIONS}", count, count <= FACTORISATIONS)
    contact = with_method(grains(GRAINS, GRAIN_H), contact_defaults(law=TOLERANCE))
    for ranks in (1, RANKS) if without_ranks() is None else (1,):
        name = f"{GRAINS} grains in contact" + (f", {ranks} ranks" if ranks > 1 else "")
        row = _add(study, name, contact, ranks)
        over = (row["seconds"] - row["mesh"]) / row["floor"]
        study.target(f"{name}, law residual {TOLERANCE:g}: wall time without the mesh",
                     f"at most {CONTACT_OVER:g} × the floor", f"{over:.2f}", over <= CONTACT_OVER)
        study.target(f"{name}: idle share of the workers in the iterations", f"at most {100 * IDLE:.0f} %",
                     f"{100 * row['idle']:.0f} %", row["idle"] <= IDLE)
    figure, ((axes,),) = panels(size=(7.2, 3.0))
    for quantity, colour, label in (("seconds", GREY, "wall time of the whole command"),
                                    ("floor", BLUE, "the code's own seconds, shared by all cores")):
        axes.barh([row["case"] for row in study.rows], [row[quantity] for row in study.rows], color=colour, label=label)
    axes.set(xscale="log", xlabel="seconds")
    axes.invert_yaxis()
    study.figure(figure)


def _add(study: Study, name: str, config: dict[str, Any], ranks: int = 1) -> dict[str, Any]:
    """Run the command, add its row."""
    label = name.replace(" ", "_").replace("³", "3").replace(",", "")
    summary, seconds = whole_command(study, label, config, ranks, accepted=(CONVERGED,))
    row = {"case": name, **shares(summary, seconds), "mesh": summary["timing"]["mesh"],
           "factorisations": sum(code["models"] for code in summary["codes"])}
    study.note(row, f"{name}: {row['iterations']} iterations, {seconds:.1f} s, floor {row['floor']:.2f} s")
    return row
