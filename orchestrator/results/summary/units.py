"""What the numbers of a run are measured in, where the configuration tells."""

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
