"""What a report says next: the answer. Three numbers, whether they are to be trusted, then the rest of what was asked."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from orchestrator.method.stopping.law_residuals import FIXED_POINT, STABILISATION
from orchestrator.registry import LAWS
from orchestrator.results.extremes import NAME as EXTREMES
from orchestrator.results.answers import INTERFACES
from orchestrator.results.report.document import Marked, by_step, heading, number, plain, section, sentences, table
from orchestrator.results.summary.words import units_of
from orchestrator.results.summary.short_form import (answer_rows, hold_sentences, place_sentences,
    shown_statuses, stabilised_sentences, summary_rows)
from orchestrator.results.summary.summary import jsonable

LARGE = 0.1  # an error that stands out
MOST = 40  # rows of a table; of more, the largest
_SHOWN = (("|u|", "max"), ("von_mises", "max"), ("s1", "max"), ("s3", "min"))
_FIRST = {"run", "result", "error bound", "true error", "law residual", "mesh's error"}


def answer(summary: Mapping[str, object]) -> list[str]:
    """The three numbers, and how good they are."""
    first = [row for row in summary_rows(summary) if row[0] in _FIRST]
    asked = [row for row in answer_rows(summary) if row[0] != "probes" and row[1]]
    parts = [heading("The answer"), table(("", ""), [*first[:2], *asked, *first[2:]])]
    return parts + _doubts(summary)


def _doubts(summary: Mapping[str, object]) -> list[str]:
    """Errors above a tenth, where they cannot be overlooked."""
    told = []
    for key, what in (("discretisation_error", "The mesh's own error"), ("true_error", "The true error"),
                      ("error_bound", "The bound on the iterations' error")):
        value = jsonable(summary.get(key))
        if value is not None and value > LARGE:
            told.append(f"{what} is {value:.0%} (relative, energy norm): stresses may be off by as much or more.")
    if not summary.get("converged"):
        told.append("The run has not converged: these numbers are of its last state.")
    return [Marked.of(text) for text in told]


def reactions(summary: Mapping[str, object]) -> list[str]:
    """Force and moment on every entry of ``boundary``."""
    forces = summary.get("reactions")
    if not forces:
        return []
    units = units_of(summary)
    names = summary.get("reaction_names") or [f"boundary[{k}]" for k in range(len(forces))]
    moments = jsonable(summary.get("reaction_moments")) or {}
    about = moments.get("about")
    per_entry = moments.get("moments") or [[()] * len(steps or ()) for steps in forces]
    rows = [(name, str(step), *map(number, force), *map(number, moment)) for name, steps, turned in zip(names, forces, per_entry)
            for step, (force, moment) in enumerate(zip(steps or (), turned), 1)]
    head = ["on", "load step", *(f"F{axis}{units['force']}" for axis in "xyz")]
    head += [f"M{axis}{units['moment']}" for axis in "xyz"] if about else []
    parts = [heading("Reactions"), table(head, rows, numeric=True)]
    if about:
        parts.append(f"Moments about ({', '.join(f'{x:g}' for x in about)}). Of loads, what they add up to.")
    return parts


def probes(summary: Mapping[str, object]) -> list[str]:
    """A table for every probe: components over load steps."""
    parts = []
    for probe in jsonable(summary.get("probes")) or ():
        where = probe.get("at")
        place = f" at ({', '.join(f'{x:.6g}' for x in where)})" if isinstance(where, list) else ""
        kind = "" if probe["quantity"] == "point" else f"{probe['quantity']} of "
        parts.append(plain(f"{probe['name']}: {kind}{probe['of']}{place}"))
        if probe.get("why"):
            parts.append(Marked.of(f"{probe['why']}."))
            continue
        columns = probe["values"]
        parts.append(table(("load step", *columns), by_step(*columns.values()), numeric=True))
    return section("Probes", *parts)


def extremes(folder: Path, summary: Mapping[str, object]) -> list[str]:
    """Per part the largest displacement and stresses, with their places."""
    rows = [row for row in _read(folder / EXTREMES) if (row["quantity"], row["extreme"]) in _SHOWN]
    if not rows:
        return []
    units = units_of(summary)
    largest: dict[str, float] = {}
    for row in rows:
        if row["quantity"] == "von_mises":
            largest[row["part"]] = float(row["value"])
    kept = sorted(largest, key=largest.__getitem__, reverse=True)[:MOST] or list(dict.fromkeys(row["part"] for row in rows))[:MOST]
    lines = [(row["part"], row["quantity"], row["extreme"], number(float(row["value"])),
              *(number(float(row[axis])) for axis in "xyz"), row["load_step"]) for part in kept for row in rows if row["part"] == part]
    text = "The largest displacement and von Mises stress of every part, its largest tension (s1) and compression (s3)."
    if len(kept) < len(largest):
        text += f" The {MOST} parts with the largest stress of {len(largest)}; {EXTREMES} has all."
    unit = f" Displacements in{units['length']}, stresses in{units['stress']}." if units["length"] else ""
    return [heading("Extremes"), text + unit, table(("part", "quantity", "", "value", "x", "y", "z", "load step"), lines, numeric=True)]


def carried(folder: Path, summary: Mapping[str, object]) -> list[str]:
    """Force, moment and centre of pressure of every interface."""
    rows = list(_read(folder / INTERFACES))
    if not rows:
        return []
    size: dict[str, float] = {}
    for row in rows:
        force = max(abs(float(row[key])) for key in ("fx", "fy", "fz"))
        size[row["interface"]] = max(size.get(row["interface"], 0.0), force)
    kept = set(sorted(size, key=size.__getitem__, reverse=True)[:MOST])
    columns = ("fx", "fy", "fz", "mx", "my", "mz", "pressure_x", "pressure_y", "pressure_z")
    works = any(float(row["work"]) or float(row["dissipation"]) for row in rows)
    columns += ("pressure_max",) * any(row.get("pressure_max") for row in rows) + ("work", "dissipation") * works
    lines = [(row["interface"], row["load_step"], *(number(float(row[key])) if row.get(key) else "–" for key in columns))
             for row in rows if row["interface"] in kept]
    text = ("Force of the second body on the first, its moment about the interface's centre, the centre of pressure, the "
            "largest pressure at a node; prescribed nodes on the interface are not counted.")
    if len(kept) < len(size):
        text += f" The {MOST} interfaces with the largest forces of {len(size)}; {INTERFACES} has all."
    return [heading("Interface resultants"), text, table(("interface", "load step", *columns), lines, numeric=True)]


def _read(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def law_quantities() -> list[tuple[str, str, str]]:
    """Quantity, its formula and what it tells, as in the report's table of residuals."""
    return [("law_residual", "the largest of those below", "what the tolerance is compared with"),
        ("interface_residual", "‖f − f̂‖ / ‖f‖, weighted by the inverse search direction",
         "forces in equilibrium against forces that obey the laws"),
        (STABILISATION, "max |f̂ − law(F)| / A / max |f| / A", "what springs carry that hold loose bodies in place"),
        (FIXED_POINT, "‖F(s) − s‖ / ‖F(s)‖, in the same norm", "what nonlinear parts truly do against what is extrapolated"),
        ("imbalance", "‖f₁ + f₂‖ / ‖f‖, in the same norm", "forces the sides do not balance"),
        *((measure.name, measure.formula, measure.meaning) for law in LAWS.values() for measure in law.measures)]


def interface_section(summary: Mapping[str, object]) -> list[str]:
    """Laws, status, bodies that nothing holds, resultants; what is not known is left out."""
    summary = {key: jsonable(value) for key, value in summary.items() if key != "config"}
    resultants, counts = summary.get("interface_resultants") or [], summary.get("status_counts")
    laws = [(law, str(sum(entry["law"] == law for entry in resultants)), *_told(law)) for law in sorted({r["law"] for r in resultants})]
    names = shown_statuses(counts)
    return [
        *section("Warnings", *sentences(summary.get("warnings") or ())),
        *section("Interface laws", table(("law", "interfaces", "formula", "meaning"), laws),
                 "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force on side 1; A: a node's share "
                 "of the area; p: pressure; μ: friction; g₀: initial gap." * bool(laws)),
        *section("Bolts", *_bolts(summary.get("bolts") or [])),
        *section("Interface status", table(("load step", *names), [
            (str(step), *map(str, row)) for step, row in enumerate(zip(*(counts[name] for name in names)), 1)], numeric=True)),
        *section("Stabilisation", *sentences(stabilised_sentences(summary))),
        *section("Places of loose bodies", *sentences(place_sentences(summary))),
        *section("Bodies that are not held", *sentences(hold_sentences(summary)))]


def _told(law: str) -> tuple[str, str]:
    """Formula and meaning of a law; nothing of one that is not registered here."""
    return (LAWS[law].formula, LAWS[law].meaning) if law in LAWS else ("", "")


def _bolts(bolts: list[dict]) -> list[str]:
    rows = [(bolt["name"], str(step), number(force), number(shorter), state) for bolt in bolts
            for step, (force, shorter, state) in enumerate(zip(bolt["force"], bolt["shortening"], bolt["state"]), 1)]
    return ["Force along the bolt, positive where it is pulled; what tightening has taken off its length." * bool(rows),
            table(("bolt", "load step", "force", "shortening", "state"), rows, numeric=True)]
