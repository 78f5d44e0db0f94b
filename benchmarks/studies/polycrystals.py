"""Polycrystals of many seeds, up to a thousand grains: do they mesh, how good are the tets, in which time?

Seconds are the processor's own, so that other work on the machine hardly counts.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Part, Positive
from orchestrator.config.mesh import Mesh as MeshEntry
from orchestrator.errors import InputError
from orchestrator.results.figures.plotting import BLUE, GREY, ORANGE, new_figure, png, tidy
from orchestrator.scene.mesh.sources import make_mesh
from orchestrator.scene.mesh.tets import dihedral_range, roundness
from benchmarks.kit.study import Study
from benchmarks.problems.soundness import unsound

SIZE = np.ones(3)
# Seconds per tet of the largest polycrystals over the smallest: in proportion to their size. It counts from so many
# grains on: of fewer, most lie at the sides of the cube and have fewer faces, for which the mesher takes most of its time.
GROWTH, MANY = 1.5, 100
LARGE, SECONDS = 1000, 60.0  # grains; for each of their meshes with a third of a grain as element size
USUAL = 10 / 3
COLUMNS = ("grains", "elements", "seed", "tets", "interfaces", "roundness", "sharp", "blunt", "seconds", "per_thousand",
           "wrong", "remarks")


class Settings(Part):
    """What to mesh: every number of grains with every seed, in every fineness."""

    counts: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)] = Field(
        [27, 125], description="numbers of grains in a unit cube; all that the aims are about: [27, 125, 343, 1000]")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = Field(
        list(range(1, 21)), description="of the grains' centres")
    elements: Annotated[list[Positive], Field(min_length=1)] = Field(
        [USUAL], description="elements across a grain, whose size is that of a cube of its volume")
    lloyd: int = Field(0, ge=0, description="relaxation steps towards rounder grains")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All meshes, the smallest first; table and figure grow with each."""
    study.columns = COLUMNS
    for elements, count, seed in product(sorted(settings.elements), sorted(settings.counts), settings.seeds):
        h = float(f"{count ** (-1 / 3) / elements:.2g}")
        study.rows.append({"grains": count, "elements": elements, "h": h, "seed": seed,
                           **_measured(count, h, seed, settings.lloyd)})
        study.write()
        study.console.print(f"  {len(study.rows):3}  {_told(study.rows[-1])}")
        study.figure(picture(study.rows))
    judge(study)


def _measured(count: int, h: float, seed: int, lloyd: int) -> dict[str, Any]:
    """Columns of one mesh."""
    entry = MeshEntry.model_validate({"polycrystal": {"grains": count, "size": 1.0, "h": h, "seed": seed, "lloyd": lloyd}})
    begin = time.process_time()
    try:
        mesh, faces = make_mesh(entry)
    except InputError as error:
        return {"wrong": f"refused: {error.problems[0].found}", "seconds": time.process_time() - begin}
    seconds = time.process_time() - begin
    sharp, blunt = dihedral_range(mesh.nodes, mesh.cells)
    sides = np.sort(mesh.volume[np.stack([faces.owner, faces.neighbour])[:, faces.inner]], axis=0)
    return {
        "nodes": len(mesh.nodes), "tets": len(mesh.cells),
        "interfaces": len(np.unique(sides[:, sides[0] != sides[1]], axis=1).T),
        "roundness": float(roundness(mesh.nodes, mesh.cells).min()), "sharp": sharp, "blunt": blunt,
        "seconds": seconds, "per_thousand": 1000 * seconds / len(mesh.cells), "wrong": "; ".join(unsound(mesh, faces, SIZE)),
        "remarks": "; ".join(remark.removeprefix(f"{mesh.source}: ") for remark in mesh.remarks),
    }


def _told(row: Mapping[str, Any]) -> str:
    """A row as a line."""
    what = f"{row['grains']} grains, h = {row['h']:g}, seed {row['seed']}: "
    if "tets" not in row:
        return what + row["wrong"]
    return what + (f"{row['tets']} tets, roundness {row['roundness']:.3f}, angles {row['sharp']:.1f} to {row['blunt']:.1f}, "
                   f"{row['seconds']:.1f} s" + "".join(f"; {row[key]}" for key in ("wrong", "remarks") if row[key]))


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
        study.target(f"{LARGE} grains, {USUAL:.2g} elements a grain: seconds of the slowest mesh", f"at most {SECONDS:g}",
                     f"{max(large):.0f}", max(large) <= SECONDS)


def picture(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Seconds over tets, and the worst tet's roundness over the number of grains: a mark per mesh."""
    figure = new_figure(10.0, 3.8)
    left, right = figure.subplots(1, 2)
    for mended, colour, label in ((False, BLUE, "as it came"), (True, ORANGE, "mended")):
        those = [row for row in rows if "tets" in row and bool(row["remarks"]) == mended]
        if those:
            left.loglog([r["tets"] for r in those], [r["seconds"] for r in those], "o", color=colour, markersize=4, label=label)
            right.semilogx([r["grains"] for r in those], [r["roundness"] for r in those], "o", color=colour, markersize=4,
                           label=label)
    done = [row for row in rows if "tets" in row]
    if done:
        ends = np.array([min(r["tets"] for r in done), max(r["tets"] for r in done)])
        left.loglog(ends, ends * np.median([r["seconds"] / r["tets"] for r in done]), color=GREY, linewidth=1,
                    label="in proportion")
        left.legend(fontsize=8.5, frameon=False)
    left.set_xlabel("tets", fontsize=9.5)
    left.set_ylabel("seconds of the processor", fontsize=9.5)
    right.set_ylabel("roundness of the worst tet", fontsize=9.5)
    right.set_ylim(bottom=0)
    counts = sorted({row["grains"] for row in rows})
    right.set_xticks(counts, [str(count) for count in counts])
    right.minorticks_off()
    right.set_xlabel("grains", fontsize=9.5)
    for axes in (left, right):
        axes.tick_params(labelsize=8.5)
        tidy(axes)
    figure.tight_layout()
    return png(figure)
