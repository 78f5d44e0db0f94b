"""Fields of a run: fields.npz for programs, fields/ (.vtu per step and a .pvd) for ParaView.

Stress has six components per cell, in VTK's order XX, YY, ZZ, XY, YZ, XZ (ParaView shows them
under these names and takes them as a symmetric tensor). On ten-node tets it is the cell's mean; the
largest von Mises stress at the cell's nodes is beside it.

Where interfaces can open, every subdomain has its own nodes in the .vtu files, so that bodies
separate; what happens on the interfaces is in files of their own (``interface_files``).
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.results.fields import stress as recovery
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.results.fields.interface_files import pvd, write_interfaces
from orchestrator.results.fields.vtu import write_vtu
from orchestrator.scene.partition.numbering import SplitNumbering, split_numbering
from orchestrator.scene.mesh.quadratic import TET_EDGES

if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields

NAME = "fields.npz"
PVD_NAME = "fields/fields.pvd"
_REQUIRED = ("nodes", "cells", "subdomain", "lame", "displacement")
_ERROR = "discretisation_error"
_SIDES = "displacement_sides_"  # + index of the subdomain


@dataclass(frozen=True)
class Fields:
    """Displacements of every load step on the undecomposed mesh, and what follows from them.

    Parameters
    ----------
    nodes : (n, 3) float, in the order of the input mesh, mid-edge nodes last; cells : (m, 4 or 10) int, VTK's order
    subdomain : (m,) int
    lame : (m, 2), Lamé's λ and μ per cell
    displacement : (steps, n, 3); where interfaces open, the mean over the subdomains that have the node
    sides : per subdomain (steps, n_E, 3) on its own nodes (``numbering``); None where nothing opens
    interfaces : fields of the interfaces that are not perfect, if there are any
    discretisation_error : (steps, m) estimate of it per cell, relative, energy norm; None where not estimated
    """

    nodes: np.ndarray
    cells: np.ndarray
    subdomain: np.ndarray
    lame: np.ndarray
    displacement: np.ndarray
    sides: list[np.ndarray] | None = None
    interfaces: InterfaceFields | None = None
    discretisation_error: np.ndarray | None = None

    @property
    def steps(self) -> int:
        return len(self.displacement)

    @cached_property
    def numbering(self) -> SplitNumbering:
        """The nodes of all subdomains, one subdomain after another."""
        return split_numbering(self.cells, self.subdomain, len(self.nodes))

    @cached_property
    def opened(self) -> Fields:
        """The same on a mesh whose subdomains share no nodes; these fields themselves where nothing opens."""
        if self.sides is None:
            return self
        split = self.numbering
        return Fields(self.nodes[split.nodes], split.corners, self.subdomain, self.lame,
                      np.concatenate(self.sides, axis=1), interfaces=self.interfaces,
                      discretisation_error=self.discretisation_error)

    def interface_displacement(self, side: int) -> np.ndarray:
        """(steps, N, 3) displacement of side 0 (the first) or 1 at the nodes of ``interfaces``."""
        i = self.interfaces
        return self.opened.displacement[:, self.numbering.find(i.subdomains[i.interface_of_node, side],
                                                                  (i.nodes, i.others)[side])]

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
        """(m, 6) mean stress of the cells at one load step."""
        epsilon = recovery.strain(self._geometry[0], self.cells, self.displacement[step])
        return recovery.stress(epsilon, self.lame)

    def von_mises(self, step: int) -> np.ndarray:
        """(m,) von Mises stress of the mean stress at one load step."""
        return recovery.von_mises(self.stress(step))

    def corner_stress(self, step: int) -> np.ndarray:
        """(m, 4, 6) stress in the cells' corners, each cell by itself: what is largest in a ten-node tet is there."""
        if self.cells.shape[1] == 4:
            return np.broadcast_to(self.stress(step)[:, None], (len(self.cells), 4, 6))
        strains = (recovery.strain(self._geometry[0], self.cells, self.displacement[step], at) for at in np.eye(4))
        return np.stack([recovery.stress(epsilon, self.lame) for epsilon in strains], axis=1)

    def nodal_von_mises(self, step: int) -> np.ndarray:
        """(m, 4 or 10) von Mises stress at the cells' nodes, each cell by itself."""
        if self.cells.shape[1] == 4:
            return np.broadcast_to(self.von_mises(step)[:, None], self.cells.shape)
        corners = self.corner_stress(step)
        return recovery.von_mises(np.concatenate([corners, corners[:, TET_EDGES].mean(axis=2)], axis=1))

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
        from orchestrator.method.delivery.interface_fields import InterfaceFields  # what draws does without the method

        try:
            with np.load(path, allow_pickle=False) as data:
                count = sum(name.startswith(_SIDES) for name in data)
                return cls(*(data[name] for name in _REQUIRED),
                           [data[f"{_SIDES}{e}"] for e in range(count)] or None, InterfaceFields.from_arrays(data),
                           data[_ERROR] if _ERROR in data else None)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(Problem(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                                     f"arrays {', '.join(_REQUIRED)}, as a run writes them",
                                     "run the configuration again")) from error


def write_fields(folder: ResultsFolder, fields: Fields) -> None:
    """Writes fields.npz and fields/step_0001.vtu … with fields/fields.pvd (time = step, from 1).

    Raises
    ------
    InputError : disk full or folder not writable
    """
    write_npz(folder, fields)
    folder.remove("fields/*.vtu", "fields/*.pvd")  # of an earlier run with more steps
    names = [f"step_{step + 1:04d}.vtu" for step in range(fields.steps)]
    for step, name in enumerate(names):
        _write_vtu(folder, f"fields/{name}", fields.opened, step)
    folder.write(PVD_NAME, pvd(names))
    if fields.interfaces is not None:
        write_interfaces(folder, fields.nodes, fields.interfaces,
                         [fields.interface_displacement(side) for side in (0, 1)])


def write_npz(folder: ResultsFolder, fields: Fields) -> Path:
    """Writes fields.npz alone, uncompressed (compression would take longer than the solution)."""
    more = {f"{_SIDES}{e}": u for e, u in enumerate(fields.sides or ())}
    if fields.interfaces is not None:
        more |= fields.interfaces.arrays()
    if fields.discretisation_error is not None:
        more[_ERROR] = fields.discretisation_error
    with folder.replacing(NAME) as temporary, open(temporary, "wb") as file:
        np.savez(file, **{name: getattr(fields, name) for name in _REQUIRED}, **more)
    return folder / NAME


def _write_vtu(folder: ResultsFolder, name: str, fields: Fields, step: int) -> None:
    sigma = fields.stress(step)
    ten = fields.cells.shape[1] == 10
    peak = {"von_mises_max": fields.nodal_von_mises(step).max(axis=1)} if ten else {}
    estimated = {} if fields.discretisation_error is None else {_ERROR: fields.discretisation_error[step]}
    with folder.replacing(name) as temporary:
        write_vtu(temporary, fields.nodes, fields.cells, {"displacement": fields.displacement[step]},
                  {"stress": sigma, "von_mises": recovery.von_mises(sigma), **peak,
                   "subdomain": fields.subdomain.astype(np.int32), **estimated})
