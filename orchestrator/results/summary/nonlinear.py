"""What is said of a run in which some matter is nonlinear."""

from __future__ import annotations

from collections.abc import Mapping

from orchestrator.scene.model import Scene
from orchestrator.wording import some

# What is right only where answers are linear in the forces; the elastic problems that correct iterations still use the rest.
OFF = ["error bound", "superposition", "proportional", "frozen", "batches of load steps", "GMRES", "strain energy"]


def nonlinear_parts(scene: Scene, iterations: int) -> dict[str, object]:
    """The summary's entry; empty where all matter is linear.

    Parameters
    ----------
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
