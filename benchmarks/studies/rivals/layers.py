"""Where the wall seconds of whole pipelines go, ours beside a rival's: one table of a study's cubes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.kit.study import Study

# what a reader looks for → stages of the summary's timing; while the codes assemble and factorise, the search direction,
# the bound's weights and the macro basis are made beside them
LAYERS = {
    "start": ("startup", "start"), "mesh": ("mesh", "parts"), "soles": ("soles",),
    "assembling, factorising": ("search_direction", "load"), "macro": ("macro",),
    "iterations, delivery": ("linear_stage", "coarse", "local_stage", "acceleration"), "bound": ("bound",), "output": ("output",),
}
CODES = ("assemble", "factorise", "solve")  # CPU seconds of all processes of the codes


def layers_of(timing: Mapping[str, Any], seconds: float) -> dict[str, float]:
    """Return seconds of each layer from a summary's timing and a command's seconds; ``rest`` is what no stage has counted."""
    found = {layer: sum(timing.get(stage, 0.0) for stage in stages) for layer, stages in LAYERS.items()}
    found["rest"] = seconds - sum(found.values())
    return found | {"in all": seconds} | {f"codes: {kind}": timing["blackbox"][kind] for kind in CODES}


def layers_of_rival(mesh: float, assembly: float, set_up: float | None, solution: float) -> dict[str, float]:
    """Return the same of a rival that is handed an assembled matrix; ``solution``: seconds with its set-up."""
    begun = set_up or 0.0
    return {"mesh": mesh, "assembling, factorising": assembly + begun, "iterations, delivery": solution - begun,
            "in all": mesh + assembly + solution}


def tell(study: Study, pipelines: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the layers of pipelines, by name, a column for each, and write layers.csv."""
    names = [*LAYERS, "rest", *(f"codes: {kind}" for kind in CODES), "in all"]
    study.beside("layers", "Wall seconds by layer; codes: CPU seconds of all processes",
                 [{"layer": name, **{who: found.get(name) for who, found in pipelines.items()}} for name in names])
