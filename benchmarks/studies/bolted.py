"""Bolted and press-fitted assemblies: iterations for settings of the method that should not matter."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from benchmarks.kit.commands import whole_command, without_ranks
from benchmarks.kit.drawing import GREY, PALETTE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import CONTACT_RATIO

SCENES = ("assembly_contact", "flange", "stack")
FACTORS, MEMORIES, RANKS = (0.3, 3.0), (15, 50), 2
SPREAD = 0.2  # of the iterations, over those of the defaults
ALONE = ("method.max_iterations=250", "output.fields=false", "output.figures=false")
SOLES = "soles"


class Settings(Keys):
    """Where the scenes are."""

    configs: str = Field("configs", description="folder of the shipped configurations")


def run(study: Study, settings: Settings = Settings()) -> None:
    """Each scene by the defaults, then with one setting changed at a time."""
    study.columns = ("scene", "setting", "iterations", "newton_steps", "law_residual", "stop_reason", "seconds")
    changes = {"defaults": (), **{f"{SOLES} × {f:g}": (f"method.sole.contact_ratio={f * CONTACT_RATIO}",) for f in FACTORS},
               **{f"memory {memory}": (f"method.memory={memory}",) for memory in MEMORIES}}
    for name in SCENES:
        path = Path(settings.configs) / f"{name}.yaml"
        for setting, overrides in changes.items():
            _solve(study, path, setting, 1, *overrides)
        if not without_ranks():
            _solve(study, path, f"{RANKS} ranks", RANKS)
        _judge(study, name)
    study.figure(_picture(study))


def _solve(study: Study, path: Path, setting: str, ranks: int, *overrides: str) -> None:
    summary, seconds = whole_command(study, path.stem, path, ranks, overrides=[*ALONE, *overrides])
    row = {"iterations": summary["iterations"], "newton_steps": summary["newton_steps"],
           "law_residual": summary["residuals"]["law_residual"], "stop_reason": summary["stop_reason"], "seconds": round(seconds, 1)}
    study.add(Case({}, {"scene": path.stem, "setting": setting}), row, {}, f"law residual {row['law_residual']:.1e}")


def _judge(study: Study, name: str) -> None:
    """Soles apart from what else is varied."""
    rows = [row for row in study.rows if row["scene"] == name]
    usual = rows[0]["iterations"]
    for what, some in (("soles × " + " … ".join(f"{f:g}" for f in FACTORS), [r for r in rows if r["setting"].startswith(SOLES)]),
                       ("all other settings", [r for r in rows[1:] if not r["setting"].startswith(SOLES)])):
        counts = [row["iterations"] for row in some]
        study.target(f"{name}: {what}", f"within {SPREAD:.0%} of {usual} iterations", f"{min(counts)} … {max(counts)}",
                     all(row["stop_reason"] == "converged" and abs(row["iterations"] - usual) <= SPREAD * usual for row in some))


def _picture(study: Study):
    figure, ((axes,),) = panels(size=(8.0, 4.0))
    names = list(dict.fromkeys(row["setting"] for row in study.rows))
    for scene, colour, marker in zip(SCENES, PALETTE, "os^"):
        rows = [row for row in study.rows if row["scene"] == scene]
        axes.plot([names.index(row["setting"]) for row in rows], [row["iterations"] for row in rows], marker, color=colour, label=scene)
        axes.axhline(rows[0]["iterations"], color=GREY, linewidth=0.5)
    axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axes.set(ylim=(0, None), ylabel="iterations", title="Iterations for settings of the method that should not matter")
    return figure
