"""What four-node tets in some parts beside ten-node ones in others would save, of assemblies whose parts are meshed each by itself.

Every part p has an estimated error η_p² on N_p tets of either element, on the last graded mesh of each. With others it would have
η_p² (N/N_p)^−2s, s the rate of the element, and no fewer than on the first mesh. The least unknowns for an error ε of all come of

    min Σ n_p N    where    Σ η_p² ≤ ε²,      n_p unknowns a tet of the element,

whose parts each take the element that is the least of n_p N + λ η_p², λ the same for all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.studies.accuracy import graded, problem
from orchestrator import Solution
from orchestrator.method.stopping.recovered_stresses import estimator_of

FINER = np.geomspace(1, 1e4, 400)  # tets over those of the first mesh


class Settings(Keys):
    """What to solve."""

    cases: list[str] = ["lap_joint", "as1"]
    most: dict[str, int] = {"P1": 40_000, "P2": 15_000}  # elements
    rates: dict[str, float] = {"P1": 1 / 3, "P2": 0.5}  # N^-s; ten-node tets are slower beside edges than the 2/3 of smooth fields
    asked: list[float] = [0.4, 0.2, 0.1, 0.05, 0.02]


def run(study: Study, settings: Settings = Settings()) -> None:
    """Unknowns of all parts of one element, of the other, and of each part's own."""
    study.columns = ("case", "asked", "P1", "P2", "by_part", "parts_P1", "parts", "saved")
    figure, (axes,) = panels(1, len(settings.cases), (4.5 * len(settings.cases), 3.5))
    for panel, name in zip(axes, settings.cases):
        choices = {element: _choices(study, name, element, settings) for element in ("P1", "P2")}
        for asked in settings.asked:
            (one, _), (two, _), (mixed, linear) = (_least(parts, asked) for parts in ([choices["P1"]], [choices["P2"]], list(choices.values())))
            saved, count = 1 - mixed / min(one, two), len(linear)
            study.note({"case": name, "asked": asked, "P1": round(one), "P2": round(two), "by_part": round(mixed), "parts_P1": int(linear.sum()),
                        "parts": count, "saved": saved}, f"{name}, {asked:.0%}: {one:,.0f} unknowns of P1, {two:,.0f} of P2, {mixed:,.0f} by "
                       f"part, {linear.sum()} of {count} P1: {saved:.0%} saved")
        rows = [row for row in study.rows if row["case"] == name]
        for key, colour in (("P1", ORANGE), ("P2", BLUE), ("by_part", "k")):
            panel.loglog([row[key] for row in rows], settings.asked, "o-" if key != "by_part" else "x--", color=colour, label=key)
        panel.set(title=name, xlabel="unknowns", ylabel="error")
        panel.legend()
    study.figure(figure)


@dataclass(frozen=True)
class Choices:
    """Of one element: (parts, k) η² and unknowns of meshes, coarse to fine."""

    squares: np.ndarray
    unknowns: np.ndarray


def _choices(study: Study, name: str, element: str, settings: Settings) -> Choices:
    found, _ = graded(study, {**problem(study.folder, name, element), "name": f"{name}-{element}"},
                      {"accuracy": {"error": 1e-3, "elements": settings.most[element]}})
    first, (count, squares, unknowns) = _parts(found[0])[0], _parts(found[-1])
    counts = first[:, None] * FINER
    return Choices(squares[:, None] * (counts / count[:, None]) ** (-2 * settings.rates[element]), (unknowns / count)[:, None] * counts)


def _parts(solution: Solution) -> tuple[np.ndarray, ...]:
    """Of each part its tets, η² and unknowns."""
    mesh, found = solution.scene.mesh, estimator_of(solution.scene)(solution.sides)
    unknowns = [3 * len(np.unique(mesh.cells[mesh.volume == v])) for v in range(len(mesh.volumes))]
    return np.bincount(mesh.volume), np.bincount(mesh.volume, (found.cells**2).max(axis=0)), np.array(unknowns)


def _least(choices: Sequence[Choices], asked: float) -> tuple[float, np.ndarray]:
    """The least unknowns for an error, and (parts,) bool, which then are of the first element."""
    squares, unknowns = (np.concatenate([getattr(c, key) for c in choices], axis=1) for key in ("squares", "unknowns"))
    low, high, part = -60.0, 60.0, np.arange(len(squares))
    for _ in range(100):
        middle = (low + high) / 2
        best = (math.exp(middle) * squares + unknowns).argmin(axis=1)
        low, high = (middle, high) if squares[part, best].sum() > asked**2 else (low, middle)
    return float(unknowns[part, best].sum()), best < len(FINER)
