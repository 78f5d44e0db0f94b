"""A report a person can read, made from a results folder alone: report.md, report.html and the figures."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from orchestrator.results.report.document import Block, Heading, Listing, Paragraph, Picture, Table, number, to_html, to_markdown
from orchestrator.results.report.contact_section import LAW_QUANTITIES, contact_section
from orchestrator.results.summary.codes import CODE_HEAD, code_rows
from orchestrator.results.figures.figures import tolerance, write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.result import Result
from orchestrator.results.summary.summary import BLACKBOX_STAGES, STAGES, blackbox_seconds, summary_rows
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
     "eq. (16): distance of the linear from the local stage; a squared ratio, no measure of accuracy"),
    ("displacement_jump", "‖B w‖ / ‖w‖, weighted by the diagonal of k", "gap between the sides of the interfaces"),
    ("force_imbalance", "‖A f‖ / ‖f‖, weighted by the inverse diagonal of k", "forces the sides do not balance"),
    ("residual", "‖s_new − s‖ / ‖s_new‖, weighted by the inverse diagonal of k", "change of the state in one iteration"),
    *LAW_QUANTITIES,
]
_PICTURES = [("deformed.png", "Deformed structure, coloured by von Mises stress; thin lines: borders of the "
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
    result = Result.read(directory)
    folder = ResultsFolder(directory)
    drawn = {path.name for path in write_figures(folder, result.summary, result.history, result.fields)}
    blocks = _blocks(result)
    pictures: list[Block] = [Picture(f"figures/{name}", text) for name, text in _PICTURES if name in drawn]
    blocks[3:3] = pictures[:1]  # the structure first, the rest where the text has come to it
    blocks += [Heading("Figures"), *pictures[1:]] if pictures[1:] else []
    blocks += _configuration(result.summary)
    folder.write("report.html", to_html(blocks, folder.path, str(result.summary.get("name"))))
    return folder.write("report.md", to_markdown(blocks))


def _blocks(result: Result) -> list[Block]:
    summary = result.summary
    blocks: list[Block] = [
        Heading(str(summary.get("name") or "Run"), 1), Paragraph(_in_words(result)),
        Table(("", ""), [row for row in summary_rows(summary) if row[0] not in ("time", "workers", "codes")])]
    blocks += [Heading("How well"), _stopping(result), Heading("Time"), _time(summary), *_codes(summary), *_workload(summary)]
    blocks += contact_section(summary)
    for key, title in (("reactions", "Reactions"), ("energy", "Energy")):
        table = {"reactions": _reactions, "energy": _energy}[key](summary.get(key))
        if table is not None:
            blocks += [Heading(title), table]
    return blocks


def _in_words(result: Result) -> str:
    summary = result.summary
    split = " and ".join(f"{summary[key]:,} {key}" for key in ("subdomains", "interfaces") if summary.get(key) is not None)
    size = f" of {summary['dofs']:,} dofs" if summary.get("dofs") else ""
    ended = "It converged" if result.converged else \
        f"It stopped WITHOUT converging ({summary.get('stop_reason')}); what follows is its last state"
    target = tolerance(summary)
    waited = f" The tolerance was {target[1]:g} on the {target[0]}." if target else ""
    return (f"A structure{size} in {split or 'subdomains'} was computed for {summary.get('load_steps') or 1} load "
            f"step(s). {ended} after {result.iterations} iterations.{waited}")


def _stopping(result: Result) -> Table:
    rows = []
    residuals = result.summary.get("residuals")
    known = {**(residuals if isinstance(residuals, Mapping) else {}), **result.summary}
    for name, formula, meaning in _QUANTITIES:
        value = known.get(name)
        if value is None and len(result.history.get(name, ())):
            value = float(result.history[name][-1])
        if value is not None and value == value:
            rows.append((name.replace("_", " "), f"{value:.2e}", formula, meaning))
    described = {name for name, _, _ in _QUANTITIES}
    rows += [(str(name).replace("_", " "), f"{value:.2e}", "", "") for name, value in
             (residuals.items() if isinstance(residuals, Mapping) else ())
             if name not in described and isinstance(value, (int, float))]
    return Table(("quantity", "last value", "formula", "meaning"), rows)


def _time(summary: Mapping[str, object]) -> Table:
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
    return Table(("stage", "seconds", "share"), lines, numeric=True)


def _codes(summary: Mapping[str, object]) -> list[Block]:
    rows = code_rows(summary)
    return [Heading("Codes, seconds of CPU; the orchestrator's are of wall clock, between requests", 3),
            Table(CODE_HEAD, rows, numeric=True)] if rows else []


def _workload(summary: Mapping[str, object]) -> list[Block]:
    record, blocks = summary.get("workload") or {}, []
    for period, name in PERIODS.items():
        if period not in record:
            continue
        blocks += [Heading(f"Who did what: {name}, {record[period]['seconds']:.2f} s", 3),
                   Table(STAGE_HEAD, stage_rows(record[period], STAGES), numeric=True)]
        if record[period]["workers"]:
            blocks.append(Table(WORKER_HEAD, worker_rows(record[period]), numeric=True))
        if rows := rank_rows(record[period]):
            blocks.append(Table(RANK_HEAD, rows, numeric=True))
    if blocks:
        blocks.append(Paragraph(
            "Workers, in seconds: assemble, factorise and solve on the black box's own clock; messages: bytes to and from "
            "it, and its wait for a core; waiting: for other workers; idle: nobody was asked, the orchestrator computed."))
    return blocks


def _reactions(reactions: object) -> Table | None:
    if not reactions:
        return None
    rows = [(f"boundary[{entry}]", str(step), *(number(component) for component in force))
            for entry, steps in enumerate(reactions) for step, force in enumerate(steps or (), 1)]
    return Table(("entry", "load step", "x", "y", "z"), rows, numeric=True)


def _energy(energy: object) -> Table | None:
    if not isinstance(energy, list) or not energy:
        return None
    return Table(("load step", "energy"), [(str(step), number(e)) for step, e in enumerate(energy, 1)], numeric=True)


def _configuration(summary: Mapping[str, object]) -> list[Block]:
    found = summary.get("versions") or {}
    blocks: list[Block] = [Heading("How it was computed"),
                           Paragraph("Versions: " + ", ".join(f"{name} {v}" for name, v in found.items()) + ".")]
    if summary.get("config"):
        blocks.append(Listing("Configuration, defaults filled in", json.dumps(summary["config"], indent=1)))
    return blocks
