"""Values along lines: paths.csv has a line for each point and load step, summary.json and paths.png the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from orchestrator.results.extremes import DISPLACEMENT, STRESS
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.probes import Reader
from orchestrator.scene.conditions.probes import Line
from orchestrator.scene.model import Scene

NAME = "paths.csv"
COLUMNS = ("path", "load_step", "distance", "x", "y", "z", *DISPLACEMENT, *STRESS)


def read_paths(scene: Scene, read: Reader) -> list[dict[str, object]]:
    """Per path of the scene ``name``, ``of``, ``distance`` (n,) from its first end, ``at`` (n, 3), and ``values``: component → (T, n), nan
    outside the body and where stresses are not to be believed."""
    return [_read(probe, read) for probe in scene.probes if isinstance(probe, Line)]


def _read(probe: Line, read: Reader) -> dict[str, object]:
    names, values = read(probe)
    return {"name": probe.name, "of": probe.quantity, "distance": probe.distance, "at": probe.at,
            "values": {name: values[:, :, k] for k, name in enumerate(names)}}


def write_paths(folder: ResultsFolder, found: Sequence[Mapping[str, object]]) -> Path:
    """Writes paths.csv; what a path does not tell is empty."""
    rows = []
    for path in found:
        columns = [path["values"].get(name) for name in COLUMNS[6:]]
        for step in range(len(next(iter(path["values"].values())))):
            for k, (distance, at) in enumerate(zip(path["distance"].tolist(), path["at"].tolist())):
                numbers = [np.nan if column is None else float(column[step, k]) for column in columns]
                rows.append([path["name"], step + 1, repr(distance), *map(repr, at), *("" if x != x else repr(x) for x in numbers)])
    return folder.write_table(NAME, [COLUMNS, *rows])
