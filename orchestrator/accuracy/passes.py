"""Record of the meshes tried so far, kept in the results folder: a run can go on in any.

It tells how many elements seconds and memory leave room for before the next mesh is made. Memory
grows by ``UNKNOWN_BYTES`` an unknown, or by more where it has between the last two meshes.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from orchestrator.accuracy.measured import Energies, Stressed
from orchestrator.accuracy.sizes import WantedMesh
from orchestrator.config.method import Accuracy
from orchestrator.errors import some
from orchestrator.folders import read_arrays, write_arrays
from orchestrator.results.checkpoint import NAME as CHECKPOINT
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.manifest import OWN
from orchestrator.results.summary.summary import NAME as SUMMARY, read_summary
from orchestrator.scene.mesh.size_map import SizeMap
from orchestrator.timing import EXPONENT

NAME, GOOD = f"{OWN}/accuracy.npz", f"{OWN}/last_good"
UNFINISHED_GOOD = f"{GOOD}.new"
SOLVED = "solved"  # of ``Energies``: arrays
UNKNOWN_BYTES = 1e4  # of program and codes: .9 to 1.6 of what 3,000 to 90,000 elements take
Peak = tuple[float, float]  # the largest von Mises stress, and the mean size of the elements there
OF_MESH = ("elements", "refined", "kept", "had")  # of what was asked for, beside its maps


@dataclass
class Pass:
    """One run on one mesh.

    elements, nodes : of the mesh
    mesh_error : estimated, raised where it was measured to tell too little; told : the share that
        the estimate by itself tells of it, no more than one, None where it is not measured
    iterations_error : bound or estimate of the iterations', None where it is not known; error :
        both
    seconds : wall time; memory : the program's and its codes' at the peak so far, bytes
    refined : what was meshed anew for it, nothing in the first; kept : what was not; had : share of
        the squared error before in the first
    peak : the largest stress, and the size of elements there
    numbers : those of its summary, see ``changes.answers``
    """

    elements: int
    nodes: int
    mesh_error: float
    iterations_error: float | None
    error: float
    seconds: float
    memory: float
    refined: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    had: float = 0.0
    told: float | None = None
    peak: Peak | None = None
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def estimated(self) -> float:
        """The mesh's error as its estimate tells it by itself."""
        return self.mesh_error * (self.told or 1.0)

    def line(self, number: int) -> str:
        """For the screen."""
        beside = (
            "iterations' unknown" if self.iterations_error is None
            else f"iterations' {self.iterations_error:.1e}")
        how = "estimated" if self.told is None else "measured against the mesh before"
        kept = f", kept: {some(self.kept)}" if self.kept else ""
        finer = (
            f"; finer: {some(self.refined)} ({self.had:.0%} of the squared error){kept}"
            if number > 1 else "")
        return (
            f"mesh {number}: {self.elements:,} elements, error {self.error:.2%} (mesh's "
            f"{self.mesh_error:.2%} {how}, {beside}), {self.seconds:.1f} s{finer}")


@dataclass(frozen=True)
class Limit:
    """One of those that are set.

    elements : that the next mesh may have; inf: no limit
    short : what is too little, for a sentence; needed : of it for a number of elements, in words
    """

    elements: float
    short: str
    needed: str


def tightest(asked: Accuracy, done: Sequence[Pass], spent: float, enough: float) -> Limit:
    """The limit that leaves room for the fewest elements.

    done : meshes so far; spent : seconds; enough : elements that are needed
    """
    last = done[-1]
    many = f"about {enough:,.0f} elements"
    found = [Limit(asked.elements or math.inf, f"{asked.elements or 0:,} elements", many)]
    if asked.seconds:
        left, times = max(asked.seconds - spent, 0.0), (enough / last.elements) ** EXPONENT
        found.append(Limit(last.elements * (left / last.seconds) ** (1 / EXPONENT),
                           f"{asked.seconds:g} seconds, of which {spent:.0f} are spent,",
                           f"{many}, which take some {last.seconds * times:,.0f} s"))
    if asked.memory:
        each = UNKNOWN_BYTES * 3 * last.nodes / last.elements  # bytes that an element more takes
        if len(done) > 1 and last.elements > done[-2].elements:
            each = max(each, (last.memory - done[-2].memory) / (last.elements - done[-2].elements))
        takes = (last.memory + each * (enough - last.elements)) / 1e9
        found.append(Limit(max(last.elements + (1e9 * asked.memory - last.memory) / each, 0.0),
                           f"{asked.memory:g} GB of memory, of which {last.memory / 1e9:.2g} were "
                           "taken,",
                           f"{many}, which take some {takes:.2g} GB"))
    return min(found, key=lambda limit: limit.elements)


@dataclass
class Passes:
    """All so far, and how the next mesh is made.

    mesh : as it was asked for, the one that is solved on or will be next
    tolerance : of its iterations, 0 where it is the configuration's
    before : energies of the last that was solved on, None where they tell nothing
    element : of all meshes, "" before the first
    """

    done: list[Pass] = field(default_factory=list)
    mesh: WantedMesh = WantedMesh()
    before: Energies | None = None
    tolerance: float = 0.0
    element: str = ""

    def write(self, folder: Path) -> None:
        """Into a results folder, whole or not at all."""
        arrays = {f"{k}/{name}": getattr(one, name) for k, one in enumerate(self.mesh.maps.values())
                  for name in ("nodes", "cells", "size")}
        if self.before and self.before.solved:
            arrays |= {f"{SOLVED}/{name}": array
                       for name, array in vars(self.before.solved).items()}
        before = self.before and {name: value for name, value in vars(self.before).items()
                                  if name != SOLVED}
        told = {"done": [asdict(one) for one in self.done], "keys": list(self.mesh.maps),
                "before": before,
                **{name: getattr(self.mesh, name) for name in OF_MESH}, "tolerance": self.tolerance,
                "element": self.element}
        write_arrays(folder / NAME, told=json.dumps(told), **arrays)

    @classmethod
    def read(cls, folder: Path) -> Passes:
        """From a results folder; none where nothing is there."""
        if not (folder / NAME).is_file():
            return cls()
        arrays = read_arrays(folder / NAME)
        told = json.loads(str(arrays["told"]))
        maps = {
            (int(part),
             name): SizeMap(*(arrays[f"{k}/{what}"] for what in ("nodes", "cells", "size")))
                for k, (part, name) in enumerate(told["keys"])}
        solved = {name.partition("/")[2]: array for name, array in arrays.items()
                  if name.startswith(f"{SOLVED}/")}
        before = told["before"] and Energies(**told["before"],
                                             solved=Stressed(**solved) if solved else None)
        mesh = WantedMesh(maps, *(told[name] for name in OF_MESH))
        return cls([Pass(**one) for one in told["done"]], mesh, before, told["tolerance"],
                   told["element"])


def set_aside(folder: ResultsFolder) -> None:
    """Keep a copy of the results that are in a folder, for ``put_back``; whole or not at all."""
    unfinished = folder / UNFINISHED_GOOD
    with folder.guarded("a copy of the last good results"):
        shutil.rmtree(unfinished, ignore_errors=True)
        for name in list(folder.manifest.owned()):
            if not name.startswith(f"{CHECKPOINT}/"):
                (unfinished / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(folder / name, unfinished / name)
        shutil.rmtree(folder / GOOD, ignore_errors=True)
        os.replace(unfinished, folder / GOOD)


def put_back(folder: ResultsFolder) -> bool:
    """Whether there are results that were set aside; if so they take the place of those that are
    there.
    """
    kept = [path for path in sorted((folder / GOOD).rglob("*")) if path.is_file()]
    if kept:
        folder.clear()
    for path in kept:
        with folder.replacing(str(path.relative_to(folder / GOOD))) as file:
            shutil.copy2(path, file)
    return bool(kept)


def set_aside_again(folder: ResultsFolder) -> None:
    """Keep a copy of the results that an earlier run has ended with, unless it was killed, which
    leaves one.
    """
    if not (folder / GOOD).exists() and (folder / SUMMARY).is_file() and read_summary(
        folder.path).get("accuracy"):
        set_aside(folder)


def drop(folder: ResultsFolder) -> None:
    """Remove what was set aside."""
    for name in (GOOD, UNFINISHED_GOOD):
        shutil.rmtree(folder / name, ignore_errors=True)
