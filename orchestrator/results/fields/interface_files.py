"""fields/interfaces.pvd and fields/interface_0001.vtu …: what happens on the interfaces, for ParaView.

All interfaces that are not perfect are in one file per load step, on the undeformed position: warp
by ``displacement_1`` or ``displacement_2`` to see either side where it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.results.fields.vtu import write_pvd, write_vtu
from orchestrator.results.folder import ResultsFolder

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
        write_vtu(folder, f"fields/{name}", nodes[interfaces.nodes], interfaces.triangles,
                  {"displacement_1": displacement[0][step], "displacement_2": displacement[1][step],
                   "gap": interfaces.gap[step], "slip": interfaces.slip[step], "pressure": interfaces.pressure[step],
                   "friction_traction": interfaces.friction_traction[step],
                   "status": interfaces.status[step].astype(np.int32)},
                  {"interface": interfaces.owner.astype(np.int32)})
    write_pvd(folder, PVD_NAME, names)
