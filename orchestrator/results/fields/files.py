"""The field files of a run: fields.npz for programs (``npz``), fields/ (.vtu per step and a .pvd) for ParaView.

ParaView shows the six components of the stress under their names and takes them as a symmetric tensor. Where interfaces
can open, every subdomain has its own nodes in the .vtu files, so that bodies separate; what happens on the interfaces
is in files of their own (``interface_files``).
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.stopping.stress import von_mises
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.interface_files import write_interfaces
from orchestrator.results.fields.npz import write_npz
from orchestrator.results.fields.vtu import write_pvd, write_vtu
from orchestrator.results.folder import ResultsFolder

PVD_NAME = "fields/fields.pvd"


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
        _write_step(folder, f"fields/{name}", fields.opened, step)
    write_pvd(folder, PVD_NAME, names)
    if fields.interfaces is not None:
        write_interfaces(folder, fields.nodes, fields.interfaces,
                         [fields.interface_displacement(side) for side in (0, 1)])


def _write_step(folder: ResultsFolder, name: str, fields: Fields, step: int) -> None:
    sigma = fields.stress(step)
    cells = {"stress": sigma, "von_mises": von_mises(sigma), "subdomain": fields.subdomain.astype(np.int32)}
    if fields.cells.shape[1] == 10:
        cells["von_mises_max"] = fields.nodal_von_mises(step).max(axis=1)
    if fields.discretisation_error is not None:
        cells["discretisation_error"] = fields.discretisation_error[step]
    write_vtu(folder, name, fields.nodes, fields.cells, {"displacement": fields.displacement[step]}, cells)
