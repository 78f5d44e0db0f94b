"""Polycrystals of many seeds, up to a thousand grains: do they mesh, how good are the tets, in which time?

Seconds are the processor's own, so that other work on the machine hardly counts.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.cases import grains
from benchmarks.problems.soundness import interfaces, unsound
from orchestrator import InputError, build_scene, config_from

SIZE = np.ones(3)
# Seconds per tet of the largest polycrystals over the smallest: in proportion to their size. It counts from so many
# grains on: of fewer, most lie at the sides of the cube and have fewer faces, for which the mesher takes most of its time.
GROWTH, MANY = 1.5, 100
LARGE, SECONDS = 1000, 60.0  # grains; for each of their meshes with a third of a grain as element size
USUAL = 10 / 3


class Settings(Keys):
    """What to mesh: every number of grains with every seed, in every fineness."""

    counts: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)] = Field(
        [27, 125], description="numbers of grains in a unit cube; all that the aims are about: [27, 125, 343, 1000]")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = Field(
        list(range(1, 21)), description="of the grains' centres")
    elements: Annotated[list[PositiveFloat], Field(min_length=1)] = Field(
        [USUAL], description="elements across a grain, whose size is that of a cube of its volume")
    lloyd: int = Field(0, ge=0, description="relaxation steps towards rounder grains")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All meshes, the smallest first; table and figure grow with each."""
    study.columns = ("grains", "elements", "seed", "tets", "interfaces", "roundness", "sharp", "blunt", "seconds", "per_thousand",
                     "wrong", "remarks")
    for elements, count, seed in product(sorted(settings.elements), sorted(settings.counts), settings.seeds):
        h = float(f"{count ** (-1 / 3) / elements:.2g}")
        row = {"grains": count, "elements": elements, "h": h, "seed": seed, **_measured(count, h, seed, settings.lloyd)}
        what = f"{count} grains, h = {h:g}, seed {seed}: "
        study.note(row, what + (f"{row['tets']} tets, roundness {row['roundness']:.3f}, angles {row['sharp']:.1f} to "
                                f"{row['blunt']:.1f}, {row['seconds']:.1f} s; {row['wrong']}; {row['remarks']}"
                                if "tets" in row else row["wrong"]))
        study.figure(_picture(study.rows))
    judge(study)


def _measured(count: int, h: float, seed: int, lloyd: int) -> dict[str, Any]:
    """Columns of one mesh."""
    begin = time.process_time()
    try:
        scene = build_scene(config_from(grains(count, h, seed=seed, lloyd=lloyd)))
    except InputError as error:
        return {"wrong": f"refused: {error.problems[0].found}", "remarks": "", "seconds": time.process_time() - begin}
    seconds, mesh = time.process_time() - begin, scene.mesh
    round_, sharp, blunt = quality(mesh.nodes, mesh.cells)
    return {
        "nodes": len(mesh.nodes), "tets": len(mesh.cells), "interfaces": len(interfaces(mesh.cells, mesh.volume)),
        "roundness": round_, "sharp": sharp, "blunt": blunt,
        "seconds": seconds, "per_thousand": 1000 * seconds / len(mesh.cells), "wrong": "; ".join(unsound(mesh, SIZE)),
        "remarks": "; ".join(warning for warning in scene.warnings if "mended" in warning or "passed over" in warning),
    }


def quality(nodes: np.ndarray, cells: np.ndarray) -> tuple[float, float, float]:
    """Of the worst tets: three times the inner over the outer radius, smallest and largest dihedral angle in degrees."""
    x = nodes[cells]
    area = np.stack([np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a]) for a, b, c in ((1, 3, 2), (0, 2, 3), (0, 3, 1), (0, 1, 2))], 1) / 2
    size = np.linalg.norm(area, axis=2)
    volume = np.einsum("mi,mi->m", x[:, 1] - x[:, 0], np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 0])) / 6
    edges = x[:, 1:] - x[:, :1]
    centre = np.linalg.solve(2 * edges, (edges**2).sum(axis=2)[..., None])[..., 0]
    roundness = 3 * (3 * volume / size.sum(axis=1)) / np.linalg.norm(centre, axis=1)
    unit = area / size[..., None]
    angles = np.degrees(np.arccos(np.clip(-np.einsum("mai,mbi->mab", unit, unit)[:, *np.triu_indices(4, 1)], -1, 1)))
    return float(roundness.min()), float(angles.min()), float(angles.max())


def judge(study: Study) -> None:
    """The aims, of what has been meshed."""
    good = [row for row in study.rows if not row["wrong"] and "passed over" not in row["remarks"]]
    study.target("meshes of the seed that was asked for, partitions of the cube into balls", f"all {len(study.rows)}",
                 len(good), len(good) == len(study.rows))
    for elements in sorted({row["elements"] for row in study.rows}):
        mean = {count: float(np.mean([row["per_thousand"] for row in those])) for count in sorted({r["grains"] for r in good})
                if count >= MANY and (those := [r for r in good if (r["grains"], r["elements"]) == (count, elements)])}
        if len(mean) > 1:
            least, *_, most = mean
            growth = mean[most] / mean[least]
            study.target(f"{elements:.2g} elements a grain: seconds per tet, {most} grains over {least}",
                         f"at most {GROWTH:g}", f"{growth:.2f}", growth <= GROWTH)
    large = [row["seconds"] for row in study.rows if row["grains"] == LARGE and row["elements"] == USUAL]
    if large:
        study.target(f"{LARGE} grains: the longest of {len(large)} meshes", f"at most {SECONDS:g} s", f"{max(large):.0f} s",
                     max(large) <= SECONDS)


def _picture(rows: Sequence[dict[str, Any]]):
    """Seconds, and the worst tet, of every mesh over its tets."""
    figure, axes = panels(1, 2, (9.0, 3.6))
    found = [row for row in rows if "tets" in row]
    for panel, quantity, colour in zip(axes[0], ("seconds", "roundness"), (BLUE, ORANGE)):
        panel.loglog([row["tets"] for row in found], [row[quantity] for row in found], "o", color=colour, markersize=3)
        panel.set(xlabel="tets", title=quantity)
    axes[0, 1].axhline(0.05, color=GREY, linestyle=":", linewidth=1)
    return figure
