"""A report a person can read, made from a results folder alone: report.md, report.html and the figures."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from orchestrator.results.report.interface_section import interface_section, law_quantities
from orchestrator.results.report.document import heading, listing, number, page, picture, plain, table
from orchestrator.results.summary.codes import CODE_HEAD, code_rows
from orchestrator.results.figures.artist import drawn
from orchestrator.results.figures.convergence import tolerance
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution
from orchestrator.results.summary.short_form import summary_rows
from orchestrator.results.summary.summary import BLACKBOX_STAGES, STAGES, blackbox_seconds
from orchestrator.results.summary.workload import (
    PERIODS,
    RANK_HEAD,
    STAGE_HEAD,
    WORKER_HEAD,
    rank_rows,
    stage_rows,
    worker_rows,
)

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
             ("convergence.png", "Convergence over the iterations, with the tolerance."),
             ("time.png", "Where the time went: wall clock per stage, and the black box on its own clock.")]


def report(directory: str | os.PathLike[str]) -> Path:
    """Draws the figures anew and writes report.md and report.html (one file, pictures inside).

    Parameters
    ----------
    directory : a results folder

    Returns
    -------
    path of report.md

    Raises
    ------
    InputError : missing folder, or not one that a run has written; disk full or folder not writable
    """
    solution = Solution.read(directory)
    folder = ResultsFolder(directory)
    names = {path.name for path in drawn(write_figures, folder, solution.summary, solution.history, solution.fields)}
    parts = _parts(solution)
    pictures = [picture(f"figures/{name}", text) for name, text in _PICTURES if name in names]
    parts[3:3] = pictures[:1]  # the structure first, the rest where the text has come to it
    parts += [heading("Figures"), *pictures[1:]] if pictures[1:] else []
    text = "\n\n".join(parts + _configuration(solution.summary)) + "\n"
    folder.write("report.html", page(text, folder.path, str(solution.summary.get("name"))))
    return folder.write("report.md", text)


def _parts(solution: Solution) -> list[str]:
    summary = solution.summary
    parts = [heading(str(summary.get("name") or "Run"), 1), plain(_in_words(solution)),
             table(("", ""), [row for row in summary_rows(summary) if row[0] not in ("time", "workers", "codes")])]
    parts += [heading("How well"), _stopping(solution), heading("Time"), _time(summary), *_codes(summary), *_workload(summary)]
    parts += interface_section(summary)
    for key, title in (("reactions", "Reactions"), ("energy", "Energy")):
        if found := {"reactions": _reactions, "energy": _energy}[key](summary.get(key)):
            parts += [heading(title), found]
    return parts


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
             (residuals.items() if isinstance(residuals, Mapping) else ())
             if name not in described and isinstance(value, (int, float))]
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


def _codes(summary: Mapping[str, object]) -> list[str]:
    rows = code_rows(summary)
    return [heading("Codes, seconds of CPU; the orchestrator's are of wall clock, between requests", 3),
            table(CODE_HEAD, rows, numeric=True)] if rows else []


def _workload(summary: Mapping[str, object]) -> list[str]:
    record, parts = summary.get("workload") or {}, []
    for period, name in PERIODS.items():
        if period not in record:
            continue
        parts += [heading(f"Who did what: {name}, {record[period]['seconds']:.2f} s", 3),
                  table(STAGE_HEAD, stage_rows(record[period], STAGES), numeric=True)]
        if record[period]["workers"]:
            parts.append(table(WORKER_HEAD, worker_rows(record[period]), numeric=True))
        if rows := rank_rows(record[period]):
            parts.append(table(RANK_HEAD, rows, numeric=True))
    if parts:
        parts.append(
            "Workers, in seconds: assemble, factorise and solve on the black box's own clock; messages: bytes to and from "
            "it, and its wait for a core; waiting: for other workers; idle: nobody was asked, the orchestrator computed.")
    return parts


def _reactions(reactions: object) -> str:
    if not reactions:
        return ""
    rows = [(f"boundary[{entry}]", str(step), *(number(component) for component in force))
            for entry, steps in enumerate(reactions) for step, force in enumerate(steps or (), 1)]
    return table(("entry", "load step", "x", "y", "z"), rows, numeric=True)


def _energy(energy: object) -> str:
    if not isinstance(energy, list) or not energy:
        return ""
    return table(("load step", "energy"), [(str(step), number(e)) for step, e in enumerate(energy, 1)], numeric=True)


def _configuration(summary: Mapping[str, object]) -> list[str]:
    found = summary.get("versions") or {}
    parts = [heading("How it was computed"),
             plain("Versions: " + ", ".join(f"{name} {v}" for name, v in found.items()) + ".")]
    if summary.get("config"):
        parts += [heading("Configuration, defaults filled in", 3), listing(json.dumps(summary["config"], indent=1))]
    return parts
