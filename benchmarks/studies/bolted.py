"""Bolted and press-fitted assemblies: iterations for settings of the method that should not matter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field

from orchestrator.config import load_config
from orchestrator.config.base import Name, Part
from orchestrator.config.load import Loaded
from orchestrator.method.coarse import problem
from orchestrator.results.figures.plotting import BLUE, GREEN, GREY, ORANGE, new_figure, png, tidy
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from benchmarks.kit.commands import whole_command, without_ranks
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import CONTACT_RATIO

SCENES = ("assembly_contact", "flange", "stack")
FACTORS, MEMORIES, ACCURACIES, RANKS = (0.3, 3.0), (15, 50), (1e-1, 1e-3), 2
SPREAD = 0.2  # of the iterations, over those of the defaults
LIMIT = "method.max_iterations=250"
COLUMNS = ("scene", "setting", "iterations", "newton_steps", "law_residual", "stop_reason", "seconds")
SOLES = "soles"


class Settings(Part):
    """Where the scenes are."""

    configs: Name = Field("configs", description="folder of the shipped configurations")


def run(study: Study, settings: Settings = Settings()) -> None:
    """Each scene by the defaults, then with one setting changed at a time."""
    study.columns = COLUMNS
    for name in SCENES:
        path = Path(settings.configs) / f"{name}.yaml"
        scene = build_scene(load_config(path).config)
        _solve(study, path, scene, "defaults")
        for factor in FACTORS:
            _solve(study, path, scene, f"{SOLES} × {factor:g}", f"method.sole.contact_ratio={factor * CONTACT_RATIO}")
        for memory in MEMORIES:
            _solve(study, path, scene, f"memory {memory}", f"method.memory={memory}")
        for accuracy in ACCURACIES:
            with coarse_accuracy(accuracy):
                _solve(study, path, scene, f"coarse problem to {accuracy:g}")
        if not without_ranks():
            _over_ranks(study, load_config(path, [LIMIT]), name)
        _judge(study, name)
    study.figure(_picture(study))


@contextmanager
def coarse_accuracy(reduction: float) -> Iterator[None]:
    """Within this context the coarse contact problem is solved to another share of what it starts from."""
    usual, problem.REDUCTION = problem.REDUCTION, reduction
    try:
        yield
    finally:
        problem.REDUCTION = usual


def _solve(study: Study, path: Path, scene: Scene, setting: str, *overrides: str) -> None:
    config = load_config(path, [LIMIT, *overrides]).config
    solved = solve(config, scene)
    _add(study, path.stem, setting, solved.summary, solved.summary["timing"]["total"], solved.iterated.history)


def _over_ranks(study: Study, loaded: Loaded, name: str) -> None:
    config = loaded.config.model_dump(mode="json", exclude_unset=True)
    config["output"] = {**config.get("output", {}), "fields": False, "figures": False}
    summary, seconds = whole_command(study, name, config, RANKS)
    _add(study, name, f"{RANKS} ranks", summary, seconds, [])


def _add(study: Study, scene: str, setting: str, summary: dict[str, Any], seconds: float, history: list) -> None:
    row = {"iterations": summary["iterations"], "newton_steps": summary["newton_steps"],
           "law_residual": summary["residuals"]["law_residual"], "stop_reason": summary["stop_reason"],
           "seconds": round(seconds, 1)}
    study.add(Case({}, {"scene": scene, "setting": setting}), row, history, f"law residual {row['law_residual']:.1e}")


def _judge(study: Study, name: str) -> None:
    """Soles apart from what else is varied."""
    rows = [row for row in study.rows if row["scene"] == name]
    usual = rows[0]["iterations"]
    for what, some in (("soles × " + " … ".join(f"{f:g}" for f in FACTORS), [r for r in rows if r["setting"].startswith(SOLES)]),
                       ("all other settings", [r for r in rows[1:] if not r["setting"].startswith(SOLES)])):
        counts = [row["iterations"] for row in some]
        ended = all(row["stop_reason"] == "converged" for row in some)
        study.target(f"{name}: {what}", f"within {SPREAD:.0%} of {usual} iterations", f"{min(counts)} … {max(counts)}",
                     ended and max(abs(count - usual) for count in counts) <= SPREAD * usual)


def _picture(study: Study) -> bytes:
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots()
    names = list(dict.fromkeys(row["setting"] for row in study.rows))
    for scene, colour, marker in zip(SCENES, (BLUE, ORANGE, GREEN), "os^"):
        rows = [row for row in study.rows if row["scene"] == scene]
        axes.plot([names.index(row["setting"]) for row in rows], [row["iterations"] for row in rows], marker, color=colour,
                  label=scene)
        axes.axhline(rows[0]["iterations"], color=GREY, linewidth=0.5)
    axes.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=9)
    axes.set(ylim=(0, None), ylabel="iterations")
    axes.set_title("Iterations for settings of the method that should not matter", fontsize=11)
    tidy(axes)
    axes.legend(fontsize=9, frameon=False)
    figure.tight_layout()
    return png(figure)
