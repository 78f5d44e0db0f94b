"""Words for units and places, as summaries and reports have them."""

from __future__ import annotations

from collections.abc import Mapping


def units_of(summary: Mapping[str, object]) -> dict[str, str]:
    """Units of length, force, stress and moment with a space before; empty where none are named."""
    named = ((summary.get("config") or {}).get("output") or {}).get("units")
    if not named:
        return {key: "" for key in ("length", "force", "stress", "moment", "energy")}
    from orchestrator.config.output import Units  # pydantic comes with it, for which who draws would wait

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
