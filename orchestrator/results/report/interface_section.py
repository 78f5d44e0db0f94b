"""The report's section on interfaces that are not perfect."""

from __future__ import annotations

from collections.abc import Mapping

from orchestrator.method.stopping.law_residuals import FIXED_POINT, STABILISATION
from orchestrator.registry import LAWS
from orchestrator.results.report.document import heading, number, plain, table
from orchestrator.results.summary.short_form import hold_sentences, place_sentences, shown_statuses, stabilised_sentences
from orchestrator.results.summary.summary import jsonable


def law_quantities() -> list[tuple[str, str, str]]:
    """Quantity, its formula and what it tells, as in the report's table of residuals."""
    return [
        ("law_residual", "the largest of those below", "what the tolerance is compared with"),
        ("interface_residual", "‖f − f̂‖ / ‖f‖, weighted by the inverse search direction",
         "forces in equilibrium against forces that obey the laws"),
        (STABILISATION, "max |f̂ − law(F)| / A / max |f| / A", "what springs carry that hold loose bodies in place"),
        (FIXED_POINT, "‖F(s) − s‖ / ‖F(s)‖, in the same norm", "what nonlinear parts truly do against what is extrapolated"),
        ("imbalance", "‖f₁ + f₂‖ / ‖f‖, in the same norm", "forces the sides do not balance"),
        *((measure.name, measure.formula, measure.meaning) for law in LAWS.values() for measure in law.measures)]


def interface_section(summary: Mapping[str, object]) -> list[str]:
    """Laws, status, bodies that nothing holds, resultants; what is not known is left out."""
    summary = {key: jsonable(value) for key, value in summary.items() if key != "config"}
    parts: list[str] = []
    warnings = summary.get("warnings") or ()
    if warnings:
        parts += [heading("Warnings"), *(plain(f"{text}.") for text in warnings)]
    resultants = summary.get("interface_resultants") or []
    found = sorted({entry["law"] for entry in resultants})
    if found:
        parts += [heading("Interface laws"), table(("law", "interfaces", "formula", "meaning"), [
            (law, str(sum(entry["law"] == law for entry in resultants)), *_told(law)) for law in found]),
            "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force on "
            "side 1; A: a node's share of the area; p: pressure; μ: friction; g₀: initial gap."]
    if bolts := summary.get("bolts"):
        parts += [heading("Bolts"), *_bolts(bolts)]
    status = _status(summary.get("status_counts"))
    if status:
        parts += [heading("Interface status"), status]
    springs = stabilised_sentences(summary)
    if springs:
        parts += [heading("Stabilisation"), *(plain(f"{text}.") for text in springs)]
    places = place_sentences(summary)
    if places:
        parts += [heading("Places of loose bodies"), *(plain(f"{text}.") for text in places)]
    held = hold_sentences(summary)
    if held:
        parts += [heading("Bodies that are not held"), *(plain(f"{text}.") for text in held)]
    return parts


def _told(law: str) -> tuple[str, str]:
    """Formula and meaning of a law; nothing of one that is not registered here."""
    return (LAWS[law].formula, LAWS[law].meaning) if law in LAWS else ("", "")


def _status(counts: object) -> str:
    names = shown_statuses(counts)
    if not names:
        return ""
    rows = [(str(step), *map(str, row)) for step, row in enumerate(zip(*(counts[name] for name in names)), 1)]
    return table(("load step", *names), rows, numeric=True)


def _bolts(bolts: list[dict]) -> list[str]:
    rows = [(bolt["name"], str(step), number(force), number(shorter), state) for bolt in bolts
            for step, (force, shorter, state) in enumerate(zip(bolt["force"], bolt["shortening"], bolt["state"]), 1)]
    return ["Force along the bolt, positive where it is pulled; what tightening has taken off its length.",
            table(("bolt", "load step", "force", "shortening", "state"), rows, numeric=True)]
