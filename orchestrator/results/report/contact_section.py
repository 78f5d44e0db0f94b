"""The report's section on interfaces that open, slip or jump."""

from __future__ import annotations

from collections.abc import Mapping

from orchestrator.results.report.document import heading, number, plain, table
from orchestrator.results.summary.summary import hold_sentences, jsonable

# quantity, its formula, what it tells; as in the report's table of residuals
LAW_QUANTITIES = [
    ("law_residual", "the largest of the six below", "what the tolerance is compared with"),
    ("interface_residual", "‖f − f̂‖ / ‖f‖, weighted by the inverse search direction",
     "forces in equilibrium against forces that obey the laws"),
    ("imbalance", "‖f₁ + f₂‖ / ‖f‖, in the same norm", "forces the sides do not balance"),
    ("penetration", "max −(g₀ + n·d) / max |u|", "sides inside each other"),
    ("tension", "max (n·f / A) / max pressure", "sides that pull each other"),
    ("cone", "max (|f_t| − μ |f_n|) / A / max pressure", "more friction than Coulomb's law allows"),
    ("slip_direction", "max (|f_t| |Δs| − f_t·Δs) / A / (max pressure · max |u|)", "friction that does not oppose the slip Δs"),
]
_LAWS = {
    "contact": ("g = g₀ + n·d ≥ 0,  p = −n·f/A ≥ 0,  g p = 0;  |f_t| ≤ μ p A,  where less: no slip, "
                "where equal: slip along f_t", "unilateral contact with Coulomb friction"),
    "jump": ("d = given", "imposed jump of displacement"),
}
_MOST = 60  # interfaces with their own rows: of many, those with the largest resultants


def contact_section(summary: Mapping[str, object]) -> list[str]:
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
            (law, str(sum(entry["law"] == law for entry in resultants)), *_LAWS.get(law, ("", ""))) for law in found]),
            "d: displacement of side 2 relative to side 1; n: normal from side 1 to side 2; f: force on "
            "side 1; A: a node's share of the area; p: pressure; μ: friction; g₀: initial gap."]
    status = _status(summary.get("status_counts"))
    if status:
        parts += [heading("Interface status"), status]
    held = hold_sentences(summary)
    if held:
        parts += [heading("Bodies that are not held"), *(plain(f"{text}.") for text in held)]
    if resultants:
        parts += [heading("Interface resultants"), *_resultants(resultants)]
    return parts


def _status(counts: object) -> str:
    # per step a mapping, or a mapping of lists; none without contact
    if isinstance(counts, Mapping):
        names = [name for name in counts if isinstance(counts[name], list)]
        counts = [dict(zip(names, row)) for row in zip(*(counts[name] for name in names))]
    if not isinstance(counts, list) or not any(isinstance(c, Mapping) and any(c.values()) for c in counts):
        return ""
    names = ("open", "stick", "slip")
    rows = [(str(step), *(str(c.get(name, 0)) for name in names)) for step, c in enumerate(counts, 1)]
    return table(("load step", *names), rows, numeric=True)


def _resultants(entries: list[dict]) -> list[str]:
    """Force on side 1, per interface and load step."""
    size = [max((abs(x or 0.0) for force in entry["resultant"] for x in force), default=0.0) for entry in entries]
    least = sorted(size, reverse=True)[min(_MOST, len(size)) - 1]
    kept = [entry for entry, s in zip(entries, size) if s >= least]
    rows = [(entry["name"], str(step), *map(number, force))
            for entry in kept for step, force in enumerate(entry["resultant"], 1)]
    text = "Force of the second body on the first; prescribed nodes on the interface are not counted."
    if len(kept) < len(entries):
        text += f" The {_MOST} interfaces with the largest of {len(entries)}; summary.json has all."
    return [text, table(("interface", "load step", "x", "y", "z"), rows, numeric=True)]
