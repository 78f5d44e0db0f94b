"""fields/interfaces.pvd and fields/interface_0001.vtu …: what happens on the interfaces, for ParaView.

All interfaces that are not perfect are in one file per load step, on the undeformed position: warp
by ``displacement_1`` or ``displacement_2`` to see either side where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.folder import ResultsFolder
from orchestrator.results.fields.vtu import write_vtu

if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields

PVD_NAME = "fields/interfaces.pvd"


def write_interfaces(folder: ResultsFolder, nodes: np.ndarray, interfaces: InterfaceFields,
                     displacement: Sequence[np.ndarray]) -> None:
    """Writes the triangles of all interfaces with gap, slip, pressure, friction traction and status.

    Parameters
    ----------
    nodes : (n, 3) of the mesh
    displacement : of side 1 and side 2, (steps, N, 3) each

    Raises
    ------
    InputError : disk full or folder not writable
    """
    names = [f"interface_{step + 1:04d}.vtu" for step in range(interfaces.steps)]
    for step, name in enumerate(names):
        with folder.replacing(f"fields/{name}") as temporary:
            write_vtu(temporary, nodes[interfaces.nodes], interfaces.triangles,
                      {"displacement_1": displacement[0][step], "displacement_2": displacement[1][step],
                       "gap": interfaces.gap[step], "slip": interfaces.slip[step],
                       "pressure": interfaces.pressure[step],
                       "friction_traction": interfaces.friction_traction[step],
                       "status": interfaces.status[step].astype(np.int32)},
                      {"interface": interfaces.owner.astype(np.int32)})
    folder.write(PVD_NAME, pvd(names))


def pvd(names: Sequence[str]) -> str:
    """A ParaView collection of one file per load step, time = step from 1."""
    rows = [f'    <DataSet timestep="{step}" group="" part="0" file="{name}"/>'
            for step, name in enumerate(names, 1)]
    return "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>",
                      *rows, "  </Collection>", "</VTKFile>", ""])
