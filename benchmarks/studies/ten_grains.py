"""Ten grains in frictional contact, from the command line to the last file, with wall time."""

from __future__ import annotations

from typing import Any

from orchestrator.results.figures.plotting import BLUE, new_figure, png, tidy
from orchestrator.results.summary.summary import STAGES
from benchmarks.kit.commands import whole_command
from benchmarks.kit.study import Study
from benchmarks.problems.cases import STEEL

LIMIT, GENERAL_CODE = 6.0, 31.0  # seconds: wanted, and what CalculiX needs on the same problem and such a machine
REPEATS = 3  # the machine may be busy


def problem() -> dict[str, Any]:
    """Pressed, pressed further and sheared, sheared across, let go."""
    return {
        "name": "ten-grains",
        "mesh": {"polycrystal": {"grains": 10, "size": 1.0, "h": 0.094}},
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [
                         [0, 0, -0.005], [0.01, 0, -0.005], [0.01, 0.005, -0.005], [0.005, 0, -0.001]]}],
        "interfaces": [{"law": "contact", "friction": 0.1}],
    }


def run(study: Study, data: dict[str, Any] | None = None, repeats: int = REPEATS) -> None:
    """The whole command, several times; the least busy one counts."""
    study.columns = ("run", "dofs", "dofs_decomposed", "subdomains", "steps", "iterations", "law_residual", "open", "stick", "slip",
                     "stop_reason", "in_the_program", "seconds")
    timings = []
    for number in range(1, repeats + 1):
        summary, seconds = whole_command(study, "ten_grains", data or problem(), output="run")
        timings.append(summary["timing"])
        row = {"run": number, "dofs": summary["dofs"], "dofs_decomposed": summary["dofs_decomposed"],
               "subdomains": summary["subdomains"], "steps": summary["load_steps"],
               "iterations": summary["iterations"],
               "law_residual": summary["residuals"]["law_residual"],
               **{name: sum(counts) for name, counts in summary["status_counts"].items()},
               "stop_reason": summary["stop_reason"], "in_the_program": round(timings[-1]["total"], 2),
               "seconds": round(seconds, 2)}
        study.rows.append(row)
        study.write()
        study.console.print(f"  {number:3}  {row['iterations']} iterations, {row['stop_reason']}, "
                            f"law residual {row['law_residual']:.1e}, {seconds:.1f} s")
    best = min(range(repeats), key=lambda i: study.rows[i]["seconds"])
    seconds = [row["seconds"] for row in study.rows]
    study.target(f"{study.rows[0]['dofs_decomposed']} dofs of the grains, everything included (CalculiX: {GENERAL_CODE:.0f} s)",
                 f"at most {LIMIT:g} s", f"{min(seconds):.1f} s; of {repeats} runs, the slowest {max(seconds):.1f} s",
                 min(seconds) <= LIMIT and study.rows[best]["stop_reason"] == "converged")
    study.figure(_picture(timings[best], study.rows[best]["seconds"]))


def _picture(timing: dict[str, Any], total: float) -> bytes:
    """Where the seconds go."""
    parts = {label: timing[key] for key, label in STAGES.items() if timing.get(key, 0) > 0.005 * total}
    parts["other"] = max(total - sum(parts.values()), 0.0)
    figure = new_figure(7.2, 0.32 * len(parts) + 1.2)
    axes = figure.subplots()
    names = list(parts)[::-1]
    axes.barh(names, [parts[n] for n in names], color=BLUE)
    for place, name in enumerate(names):
        axes.annotate(f"{parts[name]:.2f}", (parts[name], place), xytext=(3, 0), textcoords="offset points",
                      va="center", fontsize=8)
    axes.set_xlabel("seconds", fontsize=9)
    axes.set_title(f"Ten grains, {total:.1f} s in all", fontsize=11)
    axes.tick_params(labelsize=8.5)
    tidy(axes)
    figure.tight_layout()
    return png(figure)
