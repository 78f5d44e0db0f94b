"""A report a person can read, made from a results folder alone: report.md, report.html and the figures."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from orchestrator.config.model import Figures
from orchestrator.errors import InputError, Problem, Problems
from orchestrator.results.report.answer import answer, carried, extremes, interface_section, law_quantities, probes, reactions
from orchestrator.results.report.document import by_step, heading, page, picture, plain, section, table
from orchestrator.results.report.question import question, settings
from orchestrator.results.summary.words import CODE_HEAD, code_rows, units_of
from orchestrator.results.figures.artist import CannotDraw, drawn
from orchestrator.results.figures.figures import look_of, write_figures
from orchestrator.results.figures.charts import tolerance
from orchestrator.results.figures.view import Look
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.short_form import summary_rows
from orchestrator.results.summary.summary import BLACKBOX_STAGES, STAGES, blackbox_seconds
from orchestrator.results.summary.workload import (PERIODS, RANK_HEAD, STAGE_HEAD, WORKER_HEAD, rank_rows, stage_rows, worker_rows)
from orchestrator.scene.conditions.selection import check_figures

# quantity, its formula, what it tells
_QUANTITIES = [
    ("error_bound", "√(a² + b² − 2 δᵀNᵀδf), relative to the energy norm of the solution; "
                    "a = ‖u_D − u₂‖_K, b = ‖K⁺Nᵀδf‖_K (Prager–Synge)",
     "guaranteed upper bound of ‖u_D − u_exact‖_K / ‖u_exact‖_K"),
    ("discretisation_error", "η_h = (Σ_cells ∫ (σ* − σ) : C⁻¹ (σ* − σ))^½ / (‖u_D‖² + η_h²)^½",
     "estimate of what the mesh is to blame for, from recovered stresses σ*; fields/ has its cells"),
    ("true_error", "‖u_D − u_ref‖_K / ‖u_ref‖_K", "against the undecomposed solution"),
    ("indicator", "η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)",
     "eq. 16: distance of the linear from the local stage; a squared ratio, no measure of accuracy"),
    ("displacement_jump", "‖B w‖ / ‖w‖, weighted by the diagonal of k", "gap between the sides of the interfaces"),
    ("force_imbalance", "‖A f‖ / ‖f‖, weighted by the inverse diagonal of k", "forces the sides do not balance"),
    ("residual", "‖s_new − s‖ / ‖s_new‖, weighted by the inverse diagonal of k", "change of the state in one iteration"),
]
_PICTURES = [("deformed.png", "Deformed structure, coloured by von Mises stress; thin lines: sharp edges and borders of the "
                              "subdomains; grey: the undeformed outline."),
             ("codes.png", "Which code solves what."),
             ("interfaces.png", "The interfaces that are not perfect: status and pressure."),
             ("jumps.png", "The interfaces whose jump is imposed: pressure."),
             ("probes.png", "Probes over the load steps."),
             ("convergence.png", "Convergence over the iterations, with the tolerance."),
             ("time.png", "Where the time went: wall clock per stage, and the black box on its own clock.")]


def report(directory: str | os.PathLike[str], figures: Mapping[str, object] | None = None, interactive: bool = False) -> Path:
    """Draws the figures anew and writes report.md and report.html (one file, pictures inside).

    directory : a results folder
    figures : how the structure is drawn, as ``output.figures`` in the YAML; None: as the run's configuration says
    interactive : also write result.html, in which the structure turns
    Returns path of report.md
    Raises InputError: missing folder, or not one that a run has written; disk full or folder not writable; nothing that is to be
        drawn is there
    """
    solution = Solution.read(directory)
    folder = ResultsFolder(directory)
    look = look_of(solution.summary) if figures is None else _look(solution, figures)
    if interactive:
        _turning(solution, folder, look)
    try:
        made = drawn(write_figures, folder, solution.summary, solution.history, solution.fields, look)
    except CannotDraw as error:
        print(f"warning: no pictures of the structure: {error}", file=sys.stderr)
        made = write_figures(folder, solution.summary, solution.history)
    names = {path.name for path in made}
    pictures = [picture(f"figures/{name}", text) for name, text in _PICTURES if name in names]
    first = [name for name, _ in _PICTURES if name in names][:1] == [_PICTURES[0][0]]
    parts = _parts(solution, pictures[:first])  # the structure first, the rest where the text has come to it
    parts += section("Figures", *pictures[first:])
    text = "\n\n".join(parts + _configuration(solution.summary)) + "\n"
    folder.write("report.html", page(text, folder.path, str(solution.summary.get("name"))))
    return folder.write("report.md", text)


def _look(solution: Solution, figures: Mapping[str, object]) -> Look:
    """As asked for, where there is something to show."""
    try:
        asked = Figures.model_validate(figures)
    except ValidationError as error:
        raise InputError([Problem((), f"{entry['input']!r} for {'.'.join(map(str, entry['loc']))}", entry["msg"].lower(),
                                  "orchestrator report --help") for entry in error.errors()]) from error
    if solution.fields is not None:
        problems = Problems()
        check_figures(solution.fields.nodes, list(solution.fields.parts), asked, (), problems)
        problems.raise_if_any()
    return Look.of(asked.model_dump(exclude_none=True), units_of(solution.summary))


def _turning(solution: Solution, folder: ResultsFolder, look: Look) -> None:
    from orchestrator.results.figures.interactive import result_page  # Plotly, for who asks

    if solution.fields is None:
        raise InputError(Problem((), f"no fields in {folder.path}", "a run with output.fields: true", "run it again, with fields"))
    folder.write("result.html", result_page(solution.fields, str(solution.summary.get("name")), look))


def _parts(solution: Solution, pictures: list[str]) -> list[str]:
    """Question and answer first; the structure's picture beside the answer."""
    summary, folder = solution.summary, solution.directory
    told = {"run", "result", "time", "workers", "codes", "peak stress", "peak displ.", "reactions", "probes", "warning"}
    rest = [row for row in summary_rows(summary) if row[0] not in told]
    parts = [heading(str(summary.get("name") or "Run"), 1), *question(summary), *answer(summary), *pictures]
    parts += [*probes(summary), *reactions(summary), *extremes(folder, summary)]
    parts += interface_section(summary) + carried(folder, summary)
    parts += section("Energy", table(("load step", "energy"), by_step(summary.get("energy") or ()), numeric=True))
    parts += [heading("How it was solved"), plain(_in_words(solution)), table(("", ""), rest), _stopping(solution)]
    return parts + [heading("Time"), _time(summary), *section(
        "Codes, seconds of CPU; the orchestrator's are of wall clock, between requests", table(CODE_HEAD, code_rows(summary), numeric=True),
        level=3), *_workload(summary)]


def _in_words(solution: Solution) -> str:
    summary = solution.summary
    split = " and ".join(f"{summary[key]:,} {key}" for key in ("subdomains", "interfaces") if summary.get(key) is not None)
    size = f" of {summary['dofs']:,} dofs" if summary.get("dofs") else ""
    ended = "It converged" if solution.converged else \
        f"It stopped WITHOUT converging ({summary.get('stop_reason')}); what follows is its last state"
    target = tolerance(summary)
    waited = f" The tolerance was {target[1]:g} on the {target[0]}." if target else ""
    algorithm = summary.get("acceleration")
    how = f" Acceleration: {algorithm}." if algorithm else ""
    return (f"A structure{size} in {split or 'subdomains'} was computed for {summary.get('load_steps') or 1} load "
            f"step(s). {ended} after {solution.iterations} iterations.{waited}{how}")


def _stopping(solution: Solution) -> str:
    rows, quantities = [], [*_QUANTITIES, *law_quantities()]
    residuals = solution.summary.get("residuals")
    known = {**(residuals if isinstance(residuals, Mapping) else {}), **solution.summary}
    for name, formula, meaning in quantities:
        value = known.get(name)
        if value is None and len(solution.history.get(name, ())):
            value = float(solution.history[name][-1])
        if value is not None and value == value:
            rows.append((name.replace("_", " "), f"{value:.2e}", formula, meaning))
    described = {name for name, _, _ in quantities}
    rows += [(str(name).replace("_", " "), f"{value:.2e}", "", "") for name, value in
             (residuals.items() if isinstance(residuals, Mapping) else ()) if name not in described and isinstance(value, (int, float))]
    return table(("quantity", "last value", "formula", "meaning"), rows)


def _time(summary: Mapping[str, object]) -> str:
    timing = summary.get("timing") or {}
    total = timing.get("total") or 0.0
    rows = [(label, timing[stage]) for stage, label in STAGES.items() if timing.get(stage) is not None]
    rows.append(("everything else", max(0.0, total - sum(seconds for _, seconds in rows))))
    lines = [(name, f"{s:.2f}", f"{100 * s / total:.0f} %" if total else "") for name, s in rows]
    lines.append(("total (wall clock)", f"{total:.2f}", "100 %"))
    own = timing.get("blackbox") or {}
    lines += [(f"black box: {stage}", f"{own[stage]:.2f}", "") for stage in BLACKBOX_STAGES if own.get(stage) is not None]
    if blackbox_seconds(timing):
        lines.append(("black box: all, on its own clock, summed over its workers", f"{blackbox_seconds(timing):.2f}", ""))
    return table(("stage", "seconds", "share"), lines, numeric=True)


def _workload(summary: Mapping[str, object]) -> list[str]:
    record, parts = summary.get("workload") or {}, []
    for period, name in PERIODS.items():
        if period not in record:
            continue
        parts += section(f"Who did what: {name}, {record[period]['seconds']:.2f} s", *(
            table(head, rows, numeric=True) for head, rows in ((STAGE_HEAD, stage_rows(record[period], STAGES)), (WORKER_HEAD, worker_rows(
                record[period])), (RANK_HEAD, rank_rows(record[period])))), level=3)
    if parts:
        parts.append("Workers, in seconds: assemble, factorise and solve on the black box's own clock; messages: bytes to and from "
            "it, and its wait for a core; waiting: for other workers; idle: nobody was asked, the orchestrator computed.")
    return parts


def _configuration(summary: Mapping[str, object]) -> list[str]:
    found = summary.get("versions") or {}
    parts = [heading("How to do it again"), plain("Versions: " + ", ".join(f"{name} {v}" for name, v in found.items()) + ".")]
    if rows := settings(summary.get("config") or {}):
        parts += ["Settings that are not the defaults of `method`, and how the structure was cut and solved; `summary.json` has the "
                  "whole configuration under `config`.", table(("key", "value"), rows)]
    return parts
