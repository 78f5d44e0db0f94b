"""The lines of a summary: one template, read by the terminal and by the report.

A line has a label and a text, in which fields of summary.json stand in braces: numbers of each load
step are those of the last one. A text is there where all its fields are known; what stands in ‹ ›
goes where one of its own is not. What takes more than a format is in ``sentences``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from orchestrator.linalg import PLACED
from orchestrator.parallel.team import watched
from orchestrator.results.summary import sentences
from orchestrator.results.summary.sentences import vector
from orchestrator.results.summary.summary import View
from orchestrator.results.summary.verdict import verdict

MOST = 6  # texts of a line that are told briefly
STYLES = {"warning": "yellow", "what to do": "yellow"}
MORE = "orchestrator report {} writes a report of all; run --verbose prints it"


@dataclass(frozen=True)
class SummaryLine:
    """A line of the summary.

    label : what stands before it
    told : the text with its fields, or what makes one or several of a summary
    each : a key of the summary: a text for each entry of what is there, of which the fields are
        then
    brief : whether it is told where not all is asked for
    """

    label: str
    told: str | Callable[[View], str | list[str]]
    each: str = ""
    brief: bool = True


LINES = (
    SummaryLine("run", "{name}"),
    SummaryLine("result", "{ended}‹ ({why})›"),
    SummaryLine("verdict", verdict),
    SummaryLine("what to do", "{}", "advice"),
    SummaryLine("bolts", "{name}: axial {force:.5g}{unit[force]}‹, shear {shear:.4g}{unit[force]}, "
                "bending {bending:.4g}{unit[moment]}›, {state}",
                "bolts"),
    SummaryLine("tightening", "{name}: shortened by {shortening:.4g}{unit[length]}", "bolts",
                False),
    SummaryLine("peak stress",
                "{peak_stress[value]:.5g}{unit[stress]}  (von Mises, at {peak_stress[at]}‹ of "
                "{peak_stress[part]}›‹, load step {peak_stress[load_step]} of {many}›)‹\nsingular: "
                "from mesh to mesh it grows as h^-{peak_stress[grows]:.2f}, h the size of elements "
                "there, without limit›"),
    SummaryLine("peak displ.",
                "{peak_displacement[value]:.5g}{unit[length]}  (at {peak_displacement[at]}‹ of "
                "{peak_displacement[part]}›‹, load step {peak_displacement[load_step]} of "
                "{many}›)"),
    SummaryLine("reactions", lambda s: sentences.forces(s, "support")),
    SummaryLine("loads", lambda s: sentences.forces(s, "load")),
    SummaryLine("interfaces", sentences.statuses),
    SummaryLine("tools", "{name}: {displacement}{unit[length]}‹, turned by {rotation}°›", "tools"),
    SummaryLine("probes", sentences.probes),
    SummaryLine("error bound",
        "{error_bound:.2e}  ({kind}‹, {error_factor:.3g} times what it is with limits of "
        "friction that are known›, relative, energy norm)"),
    SummaryLine("acceleration", "{acceleration}", brief=False),
    SummaryLine("law residual",
        "{residuals[law_residual]:.2e}  (equilibrium and interface laws, the largest "
        "relative residual)"),
    SummaryLine("own errors", sentences.own_errors),
    SummaryLine("no balance", sentences.unbalanced),
    SummaryLine("places", sentences.places, brief=False),
    SummaryLine("not held", sentences.not_held),
    SummaryLine("stabilised", sentences.stabilised, brief=False),
    SummaryLine("backward",
        "exact for surfaces shifted by at most {backward[normal]:.1e}{unit[length]} along the "
        "normal, {backward[tangential]:.1e}{unit[length]} across it",
        brief=False),
    SummaryLine("true error", "{true_error:.2e}  (against the undecomposed solution)"),
    SummaryLine("mesh's error",
        "{discretisation_error:.2e}  (estimated discretisation error, relative, energy norm)"
        "‹; tolerance {auto:.2e}, {fraction:g} of it›"),
    SummaryLine("accuracy",
        "{accuracy[reached]:.2%} reached‹, {accuracy[asked]:.2%} asked›, energy norm, of mesh and "
        "iterations together; the last mesh of {mesh[elements]:,} elements; the mesh's error is "
        "{mesh[checked]}"),
    SummaryLine("off by", sentences.off_by),
    SummaryLine("load path", "{sentence}", "load_path", False),
    SummaryLine("nonlinear",
        "{subdomains}: load steps one after the other, {answers:,} answers from the last committed "
        "one; no error bound is claimed, residuals are; off: {off}",
        "nonlinear",
        False),
    SummaryLine("warning", "{}", "warnings"),
    SummaryLine("begun with", "{run}‹, {share:.3g} of its state›", "started_from", False),
    SummaryLine("size", sentences.size),
    SummaryLine("time", "{timing[total]:.2f} s"),
    SummaryLine("sweeps", "{sweeps[total]:.4g} back-substitutions per subdomain and load step",
                brief=False),
    SummaryLine("element", "{element}", brief=False),
    SummaryLine("stages", sentences.stages, brief=False),
    SummaryLine("codes", "{code} ({transport}): {seconds[total]:.2f} s of CPU", "codes", False),
    SummaryLine("orchestrator", "{orchestrator_seconds:.2f} s of wall clock, between requests",
                brief=False),
    SummaryLine("memory", "{memory_peak_mb:,.0f} MB at the peak", brief=False),
)


class _Fields(Formatter):
    """Fields of a template; KeyError where one is not known, null or an empty text."""

    def get_field(self, name, args, kwargs):
        value, key = super().get_field(name, args, kwargs)
        if value in (None, []) or (value == "" and not name.startswith("unit")):
            raise KeyError(name)
        return value, key

    def format_field(self, value, form):
        if isinstance(value, list):
            return vector(value) if value and not isinstance(value[0], str) else ", ".join(value)
        if isinstance(value, Mapping):
            return ", ".join(f"{count:,} {what}" for what, count in value.items())
        return super().format_field(value, form)


def filled(template: str, fields: Mapping[str, object], *told: object) -> str:
    """Return a template with its fields filled in, see above; empty where one outside of ‹ › is not
    known.
    """
    texts = []
    for place, piece in enumerate(re.split("[‹›]", template)):
        try:
            texts.append(_Fields().vformat(piece, told, fields))
        except (KeyError, TypeError):
            if place % 2 == 0:
                return ""
    return "".join(texts)


def _shown(s: View) -> dict[str, object]:
    """Return what templates read: a summary, and what several keys tell."""
    asked = (s.config.get("method") or {}).get("tolerance") or {}
    last = (s.accuracy.get("meshes") or [None])[-1]
    return vars(s) | {
        "ended": "converged" if s.converged else "NOT converged",
        "why": None if s.stop_reason == "converged" else s.stop_reason,
        "kind": s.error_kind or "guaranteed",
        "fraction": asked.get("fraction"),
        "auto": s.tolerance if asked.get("error") == "auto" else None,
        "tools": [tool if any(tool["rotation"][-1]) else tool | {"rotation": None}
                  for tool in s.tools],
        "bolts": [bolt | {key: [0.0 if x is None or abs(x) <= PLACED * abs(force) else x
                                for x, force in zip(bolt[key], bolt["force"])]  # of rounding
                          for key in ("shear", "bending") if bolt.get(key)} for bolt in s.bolts],
        "mesh": last and last | {"checked": "measured against the mesh before" if last["told"]
                                 else "an estimate that nothing has checked"}}


def _last(entry: object) -> dict[str, object]:
    """An entry, of lists over the load steps the last."""
    return {} if isinstance(entry, str) else {
        key: value[-1] if isinstance(value, list) and value and not isinstance(value[0], str)
        or key == "state" else value for key, value in entry.items()}


def summary_rows(summary: Mapping[str, object], brief: bool = False) -> list[tuple[str, str]]:
    """Return label and text of each line of a summary; what is not known is left out.

    brief : only what most look for, of lists the first ones; verdict and advice are told whole
    """
    s, rows = View(summary), []
    shown = _shown(s)
    for line in LINES:
        if brief and (not line.brief
                      or line.label == "law residual" and s.error_bound is not None):
            continue
        if line.each:
            entries = shown[line.each] or ()
            texts = [filled(line.told, _last(entry) | {"unit": s.unit}, entry)
                     for entry in ([entries] if isinstance(entries, Mapping) else entries)]
        else:
            texts = filled(line.told, shown) if isinstance(line.told, str) else line.told(s)
        texts = [text for text in ([texts] if isinstance(texts, str) else texts) if text]
        if brief and len(texts) > MOST and line.label not in ("verdict", "what to do"):
            texts = [*texts[:MOST], f"… and {len(texts) - MOST} more in summary.json"]
        if texts:
            rows.append((line.label, "\n".join(texts)))
    return rows


def print_summary(summary: Mapping[str, object],
                  directory: str | os.PathLike[str] | None = None,
                  console: object | None = None, verbose: bool = True) -> None:
    """Print a summary as a table of two columns, lines wrapped at the terminal's width.

    summary : as for ``write_summary``
    directory : the results folder, to say where the figures are
    console : a rich Console; default: standard output
    verbose : all of it; else what most look for
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = console or Console(highlight=False, emoji=False,
                                 force_terminal=None if watched() else False)
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    rows = summary_rows(summary, not verbose)
    if not verbose:
        rows.append(("more", MORE.format(directory or "DIR")))
    if directory is not None:
        figures = Path(directory) / "figures"
        rows.append(("results", f"{directory}, figures in {figures}" if any(figures.glob("*.png"))
                     else str(directory)))
    style = STYLES | {"result": "green" if summary.get("converged") else "red"}
    for label, text in rows:
        table.add_row(label, Text(text, style=style.get(label, "")))
    console.print(table)
