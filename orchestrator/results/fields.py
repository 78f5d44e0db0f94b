"""Fields of a run: fields.npz for programs, fields/ (.vtu per step and a .pvd) for ParaView.

Stress has six components per cell, in VTK's order XX, YY, ZZ, XY, YZ, XZ (ParaView shows them
under these names and takes them as a symmetric tensor).
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.results import stress as recovery
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.scene.model import Mesh

NAME = "fields.npz"
PVD_NAME = "fields/fields.pvd"
_REQUIRED = ("nodes", "cells", "subdomain", "lame", "displacement")


@dataclass(frozen=True)
class Fields:
    """Displacements of every load step on the undecomposed mesh, and what follows from them.

    Parameters
    ----------
    nodes : (n, 3) float, in the order of the input mesh; cells : (m, 4) int
    subdomain : (m,) int
    lame : (m, 2), Lamé's λ and μ per cell
    displacement : (steps, n, 3)
    """

    nodes: np.ndarray
    cells: np.ndarray
    subdomain: np.ndarray
    lame: np.ndarray
    displacement: np.ndarray

    @property
    def steps(self) -> int:
        return len(self.displacement)

    @cached_property
    def _geometry(self) -> tuple[np.ndarray, np.ndarray]:
        return recovery.shape_gradients(self.nodes, self.cells)

    @property
    def volumes(self) -> np.ndarray:
        """(m,) volumes of the cells."""
        return self._geometry[1]

    @cached_property
    def material(self) -> np.ndarray:
        """(m,) int: cells of equal λ and μ share a number."""
        pairs = np.ascontiguousarray(self.lame).view(np.complex128).ravel()
        return np.unique(pairs, return_inverse=True)[1].ravel()

    def stress(self, step: int) -> np.ndarray:
        """(m, 6) stress of one load step."""
        epsilon = recovery.strain(self._geometry[0], self.cells, self.displacement[step])
        return recovery.stress(epsilon, self.lame)

    def von_mises(self, step: int) -> np.ndarray:
        """(m,) von Mises stress of one load step."""
        return recovery.von_mises(self.stress(step))

    @classmethod
    def read(cls, directory: str | os.PathLike[str]) -> Fields | None:
        """Fields of a results folder; None if the run was asked for none.

        Raises
        ------
        InputError : fields.npz is there but cannot be read
        """
        path = Path(directory) / NAME
        if not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as data:
                return cls(*(data[name] for name in _REQUIRED))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(Problem(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                                     f"arrays {', '.join(_REQUIRED)}, as a run writes them",
                                     "run the configuration again")) from error


def write_fields(folder: ResultsFolder, mesh: Mesh, cell_subdomain: np.ndarray, lame: np.ndarray,
                 displacement: np.ndarray, extra: Mapping[str, np.ndarray] | None = None) -> Fields:
    """Writes fields.npz and fields/step_0001.vtu … with fields/fields.pvd (time = step, from 1).

    Parameters
    ----------
    mesh : the undecomposed mesh
    cell_subdomain : (m,) int; lame : (m, 2), λ and μ per cell; displacement : (steps, n, 3)
    extra : further arrays for fields.npz

    Raises
    ------
    InputError : disk full or folder not writable
    """
    fields = Fields(mesh.nodes, mesh.cells, np.asarray(cell_subdomain), np.asarray(lame, float),
                    np.asarray(displacement, float))
    write_npz(folder, fields, extra)
    folder.remove("fields/*.vtu", "fields/*.pvd")  # of an earlier run with more steps
    names = [f"step_{step + 1:04d}.vtu" for step in range(fields.steps)]
    for step, name in enumerate(names):
        _write_vtu(folder, f"fields/{name}", fields, step)
    folder.write(PVD_NAME, _pvd(names))
    return fields


def write_npz(folder: ResultsFolder, fields: Fields, extra: Mapping[str, np.ndarray] | None = None) -> Path:
    """Writes fields.npz alone, uncompressed (compression would take longer than the solution)."""
    with folder.replacing(NAME) as temporary, open(temporary, "wb") as file:
        np.savez(file, **{name: getattr(fields, name) for name in _REQUIRED}, **(extra or {}))
    return folder / NAME


def _write_vtu(folder: ResultsFolder, name: str, fields: Fields, step: int) -> None:
    import meshio

    sigma = fields.stress(step)
    grid = meshio.Mesh(
        fields.nodes, [("tetra", fields.cells)],
        point_data={"displacement": fields.displacement[step]},
        cell_data={"stress": [sigma], "von_mises": [recovery.von_mises(sigma)],
                   "subdomain": [fields.subdomain.astype(np.int32)]})
    with folder.replacing(name) as temporary:
        meshio.vtu.write(temporary, grid, binary=True, compression=None)


def _pvd(names: list[str]) -> str:
    rows = [f'    <DataSet timestep="{step}" group="" part="0" file="{name}"/>'
            for step, name in enumerate(names, 1)]
    return "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>",
                      *rows, "  </Collection>", "</VTKFile>", ""])
