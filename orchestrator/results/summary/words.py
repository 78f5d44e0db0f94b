"""Words for units, places, and what each of several codes has spent, as summaries and reports have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from orchestrator.errors import some

if TYPE_CHECKING:  # who draws has no scene, and need not load what makes one
    from orchestrator.scene.model import Scene


def units_of(summary: Mapping[str, object]) -> dict[str, str]:
    """Units of length, force, stress and moment with a space before; empty where none are named."""
    named = ((summary.get("config") or {}).get("output") or {}).get("units")
    if not named:
        return {key: "" for key in ("length", "force", "stress", "moment", "energy")}
    from orchestrator.config.model import Units  # pydantic comes with it, for which who draws would wait

    units = Units.model_validate(named)
    moment = f" {units.force}·{units.length}"
    return {"length": f" {units.length}", "force": f" {units.force}", "stress": f" {units.stress}", "moment": moment, "energy": moment}


def place_text(on: str | Mapping[str, object]) -> str:
    """``on`` of the YAML in words: xmin, x = 0, box (0, 0, 0) … (1, 1, 1)."""
    if isinstance(on, str):
        return on
    if "plane" in on:
        return f"{on['plane']} = {on['at']:g}"
    return "box " + " … ".join("(" + ", ".join(f"{x:g}" for x in corner) + ")" for corner in on["box"])


CODE_HEAD = ("code", "subdomains", "start", "assemble", "factorise", "solve", "seconds", "unit loads")


def code_label(entry: Mapping[str, object]) -> str:
    """Name of a code with its transport."""
    return f"{entry['code']} ({entry['transport']})"


def codes_text(summary: Mapping[str, object]) -> str | None:
    """Seconds in each code and in the orchestrator; None for a single code that was asked for no compliance."""
    codes = summary.get("codes") or []
    if len(codes) < 2 and not any(entry["compliances"] for entry in codes):
        return None
    rows = []
    for entry in codes:
        count, asked = len(entry["subdomains"]), entry["compliances"]
        row = (f"{code_label(entry)}: {entry['seconds']['total']:.2f} s of CPU for {count} subdomain{'s' if count != 1 else ''}")
        if asked:
            loads, seconds = sum(note["unit_loads"] for note in asked), sum(note["seconds"] for note in asked)
            row += (f"; asked once for the interface compliance of {len(asked)} of them ({loads:,} unit loads, "
                    f"{seconds:.2f} s), cheaper than a run per iteration")
        rows.append(row)
    own = summary.get("orchestrator_seconds")
    return "\n".join(rows + ([f"orchestrator: {own:.2f} s of wall clock, between requests"] if own is not None else []))


def code_rows(summary: Mapping[str, object]) -> list[tuple[str, ...]]:
    """As ``CODE_HEAD``: CPU seconds of each code by kind of work, and the orchestrator's seconds of wall clock."""
    if codes_text(summary) is None:
        return []
    rows = [(code_label(entry), str(len(entry["subdomains"])),
             *(f"{entry['seconds'][kind]:.2f}" for kind in ("start", "assemble", "factorise", "solve", "total")),
             f"{sum(note['unit_loads'] for note in entry['compliances']):,}") for entry in summary["codes"]]
    own = summary.get("orchestrator_seconds")
    return rows + ([("orchestrator", "", "", "", "", "", f"{own:.2f}", "")] if own is not None else [])


def foreign_matter(codes: Sequence[Mapping[str, object]]) -> list[str]:
    """What is not to be believed where the matter is a code's own: a sentence, or none. ``codes`` as in the summary."""
    own = list(dict.fromkeys(str(entry["code"]) for entry in codes if entry["own_matter"]))
    return [f"stresses and the estimated error of the mesh are those of the YAML's moduli; the matter of {some(own)} is its own: "
            "there they are not to be believed, displacements and forces are, if that matter, its units included, is the one that is meant: "
            "nothing shows that it is"] if own else []

# What is right only where answers are linear in the forces; the elastic problems that correct iterations still use the rest.
OFF = ["error bound", "superposition", "batches of load steps", "GMRES", "strain energy"]


def nonlinear_parts(scene: Scene, iterations: int) -> dict[str, object]:
    """The summary's entry; empty where all matter is linear.

    iterations : of all load steps; each asked every such subdomain once, and each load step's end once more
    """
    names = [s.name for s in scene.subdomains if s.remembers]
    return {"nonlinear": {"subdomains": names, "answers": len(names) * (iterations + scene.steps), "off": OFF}} if names else {}


def nonlinear_text(summary: Mapping[str, object]) -> str | None:
    """The same in words."""
    found = summary.get("nonlinear")
    if not isinstance(found, Mapping):
        return None
    return (f"{some(found['subdomains'], 6)}: load steps one after the other, {found['answers']:,} answers from the last committed "
            f"one; no error bound is claimed, residuals are; off: {', '.join(found['off'])}")
