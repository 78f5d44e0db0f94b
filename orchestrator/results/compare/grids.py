"""The .vtu files of a results folder, one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np

from orchestrator.errors import wrong
from orchestrator.results.compare.quantities import FORCE, LENGTH, STRESS, Quantity
from orchestrator.results.folder import DIRECTORY_KEY
from orchestrator.scene.mesh.geometry import format_point

KIND_OF = {**dict.fromkeys(("displacement", "displacement_1", "displacement_2", "gap", "slip"), LENGTH), "joint_force": FORCE,
           **dict.fromkeys(("stress", "von_mises", "von_mises_max", "nodal_stress", "nodal_von_mises", "principal_stress", "pressure",
                            "tension", "friction_traction"), STRESS)}
# how exact a result is, and statuses, which flip where nothing else does, are no result
LEFT_OUT = {"status", "shift_normal", "shift_tangential"}


def names_of(folder: Path) -> list[str]:
    """The grids of a folder; those of several ranks are pieces, which are another number's."""
    return sorted(path.name for path in folder.glob("fields/*.vtu"))


def of_grid(folder: Path, name: str) -> tuple[list[Quantity], np.ndarray]:
    """Arrays of a grid, and its points (n, 3), whose places differences are told by.

    Raises InputError: it cannot be read
    """
    path = folder / "fields" / name
    try:
        grid = meshio.vtu.read(path)
    except Exception as error:  # noqa: BLE001 - of meshio's, whatever is wrong with the file
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}", "a file of a results folder",
                    "run the configuration again") from error
    return list(_arrays(grid, path.name.removesuffix(".vtu"))), grid.points


def _arrays(grid: meshio.Mesh, file: str) -> Iterator[Quantity]:
    points = grid.points
    yield Quantity("nodes", "place", points, lambda i: file)
    for block in grid.cells:
        yield Quantity("cells", "cells", block.data, lambda i: file)
    for name, values in grid.point_data.items():
        if name not in LEFT_OUT:
            yield Quantity(name, KIND_OF.get(name, name), values, lambda i: f"{file}, at {format_point(points[i])}")
    for name, blocks in grid.cell_data.items():
        for values, block in zip(blocks, grid.cells):
            yield Quantity(name, KIND_OF.get(name, name), values,
                           lambda i, block=block: f"{file}, around {format_point(points[block.data[i]].mean(axis=0))}")
