"""Displacements of every load step on the whole mesh, and the stresses that follow from them.

Stress has six components per cell, in VTK's order XX, YY, ZZ, XY, YZ, XZ. On ten-node tets it is
the cell's mean; the largest von Mises stress at the cell's nodes is beside it.

fields.npz: all fields of a run for programs, written and read back.

| name | array |
|---|---|
| `nodes`, `cells`, `subdomain`, `lame`, `displacement` | as in ``Fields`` |
| `discretisation_error`, `believed` | as there, where it was estimated, where not all is to be
  believed |
| `part`, `parts`, `joined` | as there: parts, their names, and which nodes are one where interfaces
  open |
| `displacement_sides_0`, `…_1`, … | (steps, n_E, 3) per subdomain, where interfaces open |
| `gap`, `initial_gap`, `slip`, `pressure`, `friction_traction`, `status` | as in
  ``InterfaceFields``, where interfaces open |
| `shift_normal`, `shift_tangential` | as there, where they are known |
| `own_…` | the laws' own variables, so `own_damage`, (steps, N) |
| `interface_…` | its other arrays, so `interface_nodes` for `nodes` |
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields as dataclass_fields, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.errors import wrong
from orchestrator.folders import read_arrays
from orchestrator.method.delivery.interface_fields import InterfaceFields, SHIFTS, UNWRITTEN
from orchestrator.results.extremes import Nodal
from orchestrator.results.folder import DIRECTORY_KEY
from orchestrator.scene import elasticity as recovery
from orchestrator.scene.part import Copies
from orchestrator.scene.mesh.checks import check_memory
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.mesh import split_numbering, SplitNumbering
from orchestrator.scene.mesh.quadratic import TET_EDGES


if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields
    from orchestrator.scene.model import Scene


@dataclass(frozen=True)
class Fields:
    """Displacements of every load step on the undecomposed mesh, and what follows from them.

    nodes : (n, 3) float, in the order of the input mesh, mid-edge nodes last; cells : (m, 4 or 10)
        int, VTK's order
    subdomain : (m,) int
    lame : (m, 2), Lamé's λ and μ per cell; 0 of cells that stand for a part of another program, a
        ground or a rigid tool
    displacement : (steps, n, 3); where interfaces open, the mean over the subdomains that have the
        node
    sides : per subdomain (steps, n_E, 3) on its own nodes (``numbering``); None where nothing opens
    interfaces : fields of the interfaces that are not perfect, if there are any
    discretisation_error : (steps, m) estimate of it per cell, relative, energy norm; None where not
        estimated
    part : (m,) int, index into ``parts``, their names; one without a name where it is None
    joined : (N,) int, per node of ``numbering`` a label, equal where perfect interfaces make nodes
        one; None where nothing opens
    believed : (m,) bool, where stresses are those of the matter that was computed; None: everywhere
    thermal : (steps, m, 4) thermal strain at the cells' corners; None where nothing is heated
    """

    nodes: np.ndarray
    cells: np.ndarray
    subdomain: np.ndarray
    lame: np.ndarray
    displacement: np.ndarray
    sides: list[np.ndarray] | None = None
    interfaces: InterfaceFields | None = None
    discretisation_error: np.ndarray | None = None
    part: np.ndarray | None = None
    parts: tuple[str, ...] = ()
    joined: np.ndarray | None = None
    believed: np.ndarray | None = None
    thermal: np.ndarray | None = None

    @classmethod
    def of(cls, scene: Scene, displacement: np.ndarray, sides: list[np.ndarray] | None = None,
           interfaces: InterfaceFields | None = None, lost: Sequence[int] = ()) -> Fields:
        """Fields of a solved scene, without an estimate of their error.

        lost : numbers of subdomains whose stresses are not to be believed
        """
        of_others, moduli = scene.stand_ins[scene.cell_subdomain], scene.lame
        return cls(scene.mesh.nodes, scene.mesh.cells, scene.cell_subdomain,
                   np.where(of_others[:, None], 0.0, moduli) if of_others.any() else moduli,
                   displacement, sides, interfaces,
                   part=scene.mesh.volume, parts=tuple(scene.mesh.volumes),
                   joined=None if sides is None else Copies.of(scene).label,
                   believed=~np.isin(scene.cell_subdomain, lost) if lost else None,
                   thermal=scene.thermal)

    @property
    def steps(self) -> int:
        return len(self.displacement)

    @cached_property
    def numbering(self) -> SplitNumbering:
        """The nodes of all subdomains, one subdomain after another."""
        return split_numbering(self.cells, self.subdomain, len(self.nodes))

    @cached_property
    def opened(self) -> Fields:
        """The same on a mesh whose subdomains share no nodes; these fields themselves where nothing
        opens.
        """
        if self.sides is None:
            return self
        split = self.numbering
        return replace(self, nodes=self.nodes[split.nodes], cells=split.corners, sides=None,
                       displacement=np.concatenate(self.sides, axis=1))

    @cached_property
    def nodal(self) -> Nodal:
        """Stresses at the nodes."""
        return Nodal(self)

    def with_error(self, cells: np.ndarray | None) -> Fields:
        """The same with an estimate of the discretisation error (steps, m), and with all that has
        been found of them.
        """
        result = replace(self)
        vars(result).update(vars(self), discretisation_error=cells)
        return result

    def __getstate__(self) -> dict[str, object]:
        """Return what others cannot compute themselves."""
        return {field.name: getattr(self, field.name) for field in dataclass_fields(self)}

    def interface_displacement(self, side: int) -> np.ndarray:
        """(steps, N, 3) displacement of side 0 (the first) or 1 at the nodes of ``interfaces``."""
        i = self.interfaces
        own = self.numbering.find(i.subdomains[i.interface_of_node, side],
                                  (i.nodes, i.others)[side])
        return self.opened.displacement[:, own]

    @cached_property
    def _geometry(self) -> tuple[np.ndarray, np.ndarray]:
        return shape_gradients(self.nodes, self.cells)

    @cached_property
    def volumes(self) -> np.ndarray:
        """(m,) volumes of the cells."""
        return self._geometry[1]

    @cached_property
    def material(self) -> np.ndarray:
        """(m,) int: cells of equal λ and μ share a number."""
        if (self.lame == self.lame[:1]).all():
            return np.zeros(len(self.lame), int)
        pairs = np.ascontiguousarray(self.lame).view(np.complex128).ravel()
        return np.unique(pairs, return_inverse=True)[1].ravel()

    def stress(self, step: int, at: np.ndarray = recovery.CENTRE) -> np.ndarray:
        """(m, 6) stress of the cells at one load step, at barycentric coordinates (4,); in the
        centre it is the mean.
        """
        epsilon = recovery.strain(self._geometry[0], self.cells, self.displacement[step], at)
        if self.thermal is not None:  # what matter expands by itself
            epsilon[:, :3] -= (self.thermal[step] @ at)[:, None]
        return recovery.stress(epsilon, self.lame)

    def corner_stress(self, step: int) -> np.ndarray:
        """(m, 4, 6) stress in the cells' corners, each cell by itself: what is largest in a
        ten-node tet is there. In a four-node one it is the mean.
        """
        if self.cells.shape[1] == 4:
            return np.broadcast_to(self.stress(step)[:, None], (len(self.cells), 4, 6))
        return np.stack([self.stress(step, at) for at in np.eye(4)], axis=1)

    def nodal_von_mises(self, step: int) -> np.ndarray:
        """(m, 10) von Mises stress at the nodes of ten-node tets, each cell by itself."""
        corners = self.corner_stress(step)
        middles = corners[:, TET_EDGES].mean(axis=2)
        return recovery.von_mises(np.concatenate([corners, middles], axis=1))


NAME = "fields.npz"
_ALWAYS = ("nodes", "cells", "subdomain", "lame", "displacement")
_OWN_NAMES = (*_ALWAYS, "discretisation_error", "part", "joined", "believed", "thermal")
SIDES, _OWN = "displacement_sides_", "own_"  # + index of the subdomain; + name of a law's variable
# of ``InterfaceFields``, those whose names say what they are of: no body has them
_ONLY_THERE = {"initial_gap", "gap", "slip", "pressure", "friction_traction", "status", *SHIFTS}
_INTERFACE = {f.name: f.name if f.name in _ONLY_THERE else f"interface_{f.name}"
              for f in fields(InterfaceFields) if f.name not in ("own", *UNWRITTEN)}


def write_npz(path: Path, written: Fields) -> None:
    """Write the file, uncompressed (compression would take longer than the solution)."""
    found = {name: getattr(written, name) for name in _OWN_NAMES}
    found |= {f"{SIDES}{e}": u for e, u in enumerate(written.sides or ())}
    if (met := written.interfaces) is not None:
        found |= {key: getattr(met, name) for name, key in _INTERFACE.items()}
        found |= {_OWN + name: x for name, x in met.own.items()}
    found["parts"] = np.array(written.parts, str)
    with open(path, "wb") as file:
        np.savez(file, **{name: x for name, x in found.items() if x is not None})


def read_npz(directory: str | os.PathLike[str]) -> Fields | None:
    """Return the fields of a results folder; None if the run was asked for none.

    Raises InputError: fields.npz is there but cannot be read, or does not fit in memory
    """
    path = Path(directory) / NAME
    if not path.is_file():
        return None
    try:
        with zipfile.ZipFile(path) as packed:  # a few bytes may unpack to any size
            check_memory(sum(entry.file_size for entry in packed.infolist()), DIRECTORY_KEY,
                         str(path), "check the file: is it this run's?")
        data = read_arrays(path)
        sides = [data[f"{SIDES}{e}"] for e in range(sum(name.startswith(SIDES) for name in data))]
        return Fields(**{name: data[name] for name in _OWN_NAMES if name in data},
                      sides=sides or None, interfaces=_interfaces(data),
                      parts=tuple(data["parts"].tolist()))
    except (OSError, ValueError, KeyError, TypeError, EOFError, MemoryError, zlib.error,
            zipfile.BadZipFile) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                    f"arrays {', '.join(_ALWAYS)}, as a run writes them",
                    "run the configuration again") from error


def _interfaces(data: Mapping[str, np.ndarray]) -> InterfaceFields | None:
    """None where all interfaces are perfect."""
    if _INTERFACE["nodes"] not in data:
        return None
    own = {name.removeprefix(_OWN): x for name, x in data.items() if name.startswith(_OWN)}
    return InterfaceFields(**{name: data[key] for name, key in _INTERFACE.items() if key in data},
                           own=own)
