"""A report a person can read, made from a results folder alone: report.md, report.html and the figures."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from orchestrator.config.explain import explained
from orchestrator.config.model import Figures
from orchestrator.errors import InputError, Problems, wrong
from orchestrator.optional import check_there, DRAWING
from orchestrator.results.figures.animation import NAME as ANIMATION, write_animation
from orchestrator.results.figures.artist import CannotDraw, drawn
from orchestrator.results.figures.charts import tolerance
from orchestrator.results.figures.figures import look_of, write_figures
from orchestrator.results.figures.view import Look
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.report.document import Marked, heading, page, picture, plain, section, table
from orchestrator.results.report.question import question, settings
from orchestrator.results.report.sections import (
    answer, by_step, carried, extremes, interface_section, last_values, meshes, probes, reactions)
from orchestrator.results.solution import Solution
from orchestrator.results.summary.cost import told_by_code
from orchestrator.results.summary.summary import BLACKBOX_STAGES, STAGES, blackbox_seconds, code_label, stage_seconds, units_of
from orchestrator.results.summary.words import summary_rows
from orchestrator.results.summary.verdict import verdict
from orchestrator.results.summary.workload import PERIODS
from orchestrator.scene.conditions.selection import check_figures

_PICTURES = [("deformed.png", "Deformed structure, coloured by von Mises stress; thin lines: sharp edges and borders of the "
                              "subdomains; grey: the undeformed outline."),
             ("codes.png", "Which code solves what."),
             ("interfaces.png", "The interfaces that are not perfect: status and pressure."),
             ("jumps.png", "The interfaces whose jump is imposed: pressure."),
             (ANIMATION, "The load steps, one after another."),
             ("accuracy.png", "Errors over elements, mesh by mesh."),
             ("mesh.png", "The first mesh and the last: sizes of elements, and the error of each."),
             ("probes.png", "Probes over the load steps."),
             ("paths.png", "Values along paths, at the last load steps; all of them are in paths.csv."),
             ("convergence.png", "Convergence over the iterations, with the tolerance."),
             ("time.png", "Where the time went: wall clock per stage, and the black box on its own clock.")]


def figures_asked(cut: str | None, parts: list[str] | None, view: str | None, steps: str | None, scale: str | None) -> dict[str, object] | None:
    """``output.figures`` as options say; None where they say nothing."""
    def numbers(text: str, kind: type, *names: str) -> object:
        found = [kind(number) for number in text.split(",")]
        if names and len(found) != len(names):
            raise ValueError
        return dict(zip(names, found)) if names else found

    readers = {"cut": (cut, lambda text: {"plane": text.partition("=")[0], "at": float(text.partition("=")[2])}, "--cut x=80"),
               "view": (view, lambda text: numbers(text, float, "azimuth", "elevation"), "--view 30,20"),
               "steps": (steps, lambda text: numbers(text, int), "--steps 1,5"),
               "scale": (scale, lambda text: text if text == "step" else numbers(text, float), "--scale 0,165 or --scale step")}
    figures: dict[str, object] = {"parts": parts} if parts else {}
    for name, (text, read, example) in readers.items():
        try:
            figures |= {} if text is None else {name: read(text)}
        except ValueError:
            raise wrong((), f"--{name} {text}", "numbers", f"write {example}") from None
    return figures or None


def report(directory: str | os.PathLike[str], figures: Mapping[str, object] | None = None, interactive: bool = False,
           animate: bool = False) -> Path:
    """Draws the figures anew and writes report.md and report.html (one file, pictures inside).

    directory : a results folder
    figures : how the structure is drawn, as ``output.figures`` in the YAML; None: as the run's configuration says
    interactive : also write result.html, in which the structure turns
    animate : also write figures/steps.gif, the load steps one after another, which the report then shows
    Returns path of report.md
    Raises InputError: missing folder, or not one that a run has written; disk full or folder not writable; nothing that is to be
        drawn is there; a package that draws is not installed; an animation of a single load step, or where VTK cannot draw
    """
    for package in DRAWING:
        check_there(package)
    solution = Solution.read(directory)
    folder = ResultsFolder(directory)
    look = look_of(solution.summary) if figures is None else _look(solution, figures)
    name = str(solution.summary.get("name"))
    if (interactive or animate) and solution.fields is None:
        raise wrong((), f"no fields in {solution.directory}", "a run with output.fields: true", "run it again, with fields")
    if interactive:
        from orchestrator.results.figures.interactive import result_page  # Plotly, for who asks

        folder.write("result.html", result_page(solution.fields, name, look))
    if animate:
        try:
            drawn(write_animation, folder, solution.fields, look, name)
        except CannotDraw as error:
            raise wrong((), f"no animation: {error}", "a machine on which VTK can draw", "leave out --animate") from error
    try:
        made = drawn(write_figures, folder, solution.summary, solution.history, solution.fields, look)
    except CannotDraw as error:
        print(f"warning: no pictures of the structure: {error}", file=sys.stderr)
        made = write_figures(folder, solution.summary, solution.history)
    there = {path.name for path in made} | ({ANIMATION} if animate else set())
    pictures = [picture(f"figures/{file}", text) for file, text in _PICTURES if file in there]
    first = _PICTURES[0][0] in there
    parts = _parts(solution, pictures[:first])  # the structure first, the rest where the text has come to it
    parts += section("Figures", *pictures[first:])
    text = "\n\n".join(parts + _configuration(solution.summary)) + "\n"
    folder.write("report.html", page(text, folder.path, name))
    return folder.write("report.md", text)


def _look(solution: Solution, figures: Mapping[str, object]) -> Look:
    """The look that is asked for, where there is something to show."""
    try:
        asked = Figures.model_validate(figures)
    except ValidationError as error:
        raise InputError(explained(error, figures, Figures)) from error
    if solution.fields is not None:
        problems = Problems()
        check_figures(solution.fields.nodes, list(solution.fields.parts), solution.fields.steps, asked, (), problems)
        problems.raise_if_any()
    return Look.of(asked.model_dump(exclude_none=True), units_of(solution.summary))


def _parts(solution: Solution, pictures: list[str]) -> list[str]:
    """The report's parts, question and answer first; the structure's picture beside the answer."""
    summary, folder = solution.summary, solution.directory
    told = {"run", "result", "verdict", "time", "workers", "codes", "peak stress", "peak displ.", "reactions", "loads",
            "probes", "warning"}
    rest = [row for row in summary_rows(summary) if row[0] not in told]
    return [heading(str(summary.get("name") or "Run"), 1), *map(Marked.of, verdict(summary)), *question(summary), *answer(summary),
        *pictures, *probes(summary), *reactions(summary), *extremes(folder, summary), *interface_section(summary), *carried(folder),
        *section("Energy", table(("load step", "energy"), by_step(summary.get("energy") or ()), numeric=True)),
        heading("How it was solved"), plain(_in_words(solution)), table(("", ""), rest), *meshes(summary), last_values(summary, solution.history),
        heading("Time"), _time(summary),
        *section("Codes, seconds of CPU; the orchestrator's are of wall clock, between requests", _codes(summary), level=3),
        *_workload(summary)]


def _in_words(solution: Solution) -> str:
    summary = solution.summary
    split = " and ".join(f"{summary[key]:,} {key}" for key in ("subdomains", "interfaces") if summary.get(key) is not None)
    size = f" of {summary['dofs']:,} dofs" if summary.get("dofs") else ""
    ended = "It converged" if solution.converged else \
        f"It stopped WITHOUT converging ({summary.get('stop_reason')}); what follows is its last state"
    target = tolerance(summary)
    waited = f" The tolerance was {target[1]:g} on the {target[0]}." if target else ""
    how = f" Acceleration: {summary['acceleration']}." if summary.get("acceleration") else ""
    return (f"A structure{size} in {split or 'subdomains'} was computed for {summary.get('load_steps') or 1} load "
            f"step(s). {ended} after {solution.iterations} iterations.{waited}{how}")


def _time(summary: Mapping[str, object]) -> str:
    timing = summary.get("timing") or {}
    total, own = timing.get("total") or 0.0, timing.get("blackbox") or {}
    lines = [(label, f"{s:.2f}", f"{100 * s / total:.0f} %" if total else "") for label, s in stage_seconds(timing)]
    lines.append(("total (wall clock)", f"{total:.2f}", "100 %"))
    lines += [(f"black box: {stage}", f"{own[stage]:.2f}", "") for stage in BLACKBOX_STAGES if own.get(stage) is not None]
    if blackbox_seconds(timing):
        lines.append(("black box: all, on its own clock, summed over its workers", f"{blackbox_seconds(timing):.2f}", ""))
    return table(("stage", "seconds", "share"), lines, numeric=True)


def _codes(summary: Mapping[str, object]) -> str:
    """CPU seconds of each code by kind of work, and the orchestrator's seconds of wall clock."""
    kinds = ("start", "assemble", "factorise", "solve", "total")
    rows = [(code_label(entry), str(len(entry["subdomains"])), *(f"{entry['seconds'][kind]:.2f}" for kind in kinds),
             f"{sum(note['unit_loads'] for note in entry['compliances']):,}")
             for entry in summary["codes"]] if told_by_code(summary) else []
    if rows and (own := summary.get("orchestrator_seconds")) is not None:
        rows.append(("orchestrator", "", "", "", "", "", f"{own:.2f}", ""))
    return table(("code", "subdomains", *kinds[:-1], "seconds", "unit loads"), rows, numeric=True)


# column → format of a row of the record; times in seconds, shares of the period
_STAGE = {"stage": "{name}", "rank": "{rank}", "calls": "{calls}", "seconds": "{seconds:.2f}", "waiting for other ranks": "{waiting:.2f}",
          "share": "{percent:.1f} %"}
_WORKER = {"rank": "{rank}", "worker": "{worker}", "subdomains": "{models}", "dofs": "{dofs:,}", "calls": "{calls}",
           "assemble, factorise": "{ready:.2f}", "solve": "{solve:.2f}", "messages": "{messages:.2f}", "waiting": "{waiting:.2f}",
           "idle": "{idle:.2f}", "idle share": "{percent:.1f} %"}
_RANK = {"rank": "{rank}", "seconds": "{seconds:.2f}", "waiting for other ranks": "{waiting:.2f}", "idle share": "{percent:.1f} %",
         "messages": "{messages:,}", "of them sums": "{reductions:,}", "MB sent": "{MB:.2f}", "peak memory MB": "{memory_peak_mb:,.0f}"}
_LEAST = 5e-3  # share from which a stage is worth a row


def _workload(summary: Mapping[str, object]) -> list[str]:
    """Chart of who did what in each period: stages, the longest first within a rank, workers and, where there are several, ranks."""
    parts: list[str] = []
    for key, period in (summary.get("workload") or {}).items():
        stages = sorted((row for row in period["stages"] if row["share"] >= _LEAST), key=lambda row: (row["rank"], -row["seconds"]))
        ranks = period.get("ranks") or ()
        parts += section(f"Who did what: {PERIODS[key]}, {period['seconds']:.2f} s", *(
            table(list(columns), [[form.format_map(row | {"percent": 100 * row[share]}) for form in columns.values()] for row in rows],
                  True)
            for columns, share, rows in ((_STAGE, "share", [{**row, "name": STAGES.get(row["stage"], row["stage"])} for row in stages]),
                (_WORKER, "idle_share", [{**row, "ready": row["start"] + row["assemble"] + row["factorise"],
                                          **{name: max(row[name], 0.0) for name in ("solve", "messages", "waiting", "idle")}}
                                         for row in period["workers"]]),
                (_RANK, "idle_share", [{**row, "MB": row["bytes"] / 1e6} for row in ranks] if len(ranks) > 1 else []))), level=3)
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
