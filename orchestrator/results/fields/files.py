"""The field files of a run: fields.npz for programs (``npz``), fields/ (.vtu per step and a .pvd) for ParaView.

ParaView shows the six components of the stress under their names and takes them as a symmetric tensor. In the .vtu files
every part and every matter has its own nodes, and where interfaces can open every body, so that bodies separate and
stresses at nodes are of one body each; what happens on the interfaces is in files of their own (``interface_files``).
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from orchestrator.blackbox.codes.foreign.own_fields import OwnFields
from orchestrator.method.stopping.stress import von_mises
from orchestrator.parallel.team import ALONE, Team
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.interface_files import write_interfaces
from orchestrator.results.fields.nodal import Nodal, principal
from orchestrator.results.fields.npz import write_npz
from orchestrator.results.fields.vtu import write_pvd, write_pvtu, write_vtu
from orchestrator.results.folder import ResultsFolder

PVD_NAME = "fields/fields.pvd"


def write_fields(folder: ResultsFolder, fields: Fields, team: Team = ALONE, beside: Sequence[OwnFields] = ()) -> None:
    """Writes fields.npz and fields/step_0001.vtu … with fields/fields.pvd (time = step, from 1).

    Several ranks write a piece of every step each, step_0001_0.vtu …, that step_0001.pvtu puts together; the others
    ``write_piece`` meanwhile.

    Parameters
    ----------
    team : the ranks; this is rank 0
    beside : of parts with a mesh of their own, which have files of theirs in the same collection

    Raises
    ------
    InputError : disk full or folder not writable
    """
    write_npz(folder, fields)
    folder.remove("fields/*.vtu", "fields/*.pvtu", "fields/*.pvd")  # of an earlier run with more steps
    grid, shown = fields.apart, None
    if beside:  # of what stands for these parts nothing is shown
        hidden = [i for i, name in enumerate(fields.parts) if name in {part.name for part in beside}]
        shown = np.flatnonzero(~np.isin(fields.part, hidden))
    if team.size > 1:
        names = _in_pieces(folder, grid, fields.nodal, team, shown)
    else:
        names = [f"step_{step + 1:04d}.vtu" for step in range(fields.steps)]
        some = grid if shown is None else grid.some(shown)
        at = slice(None) if shown is None else np.unique(grid.cells[shown])
        for step, name in enumerate(names):
            _write_step(folder, f"fields/{name}", some, step, fields.nodal.everywhere(fields.nodal.stress(step))[at])
    write_pvd(folder, PVD_NAME, names, [_write_beside(folder, part) for part in beside])
    if fields.interfaces is not None:
        write_interfaces(folder, fields.nodes, fields.interfaces,
                         [fields.interface_displacement(side) for side in (0, 1)])


def _write_beside(folder: ResultsFolder, part: OwnFields) -> list[str]:
    """Files of a part with a mesh of its own, one per load step; their names."""
    import meshio  # not before there is something to write

    plain = "".join(c if c.isalnum() or c in "-_." else "_" for c in part.name)
    names = [f"{plain}_{step + 1:04d}.vtu" for step in range(len(part.displacement))]
    for name, u, force in zip(names, part.displacement, part.force):
        with folder.replacing(f"fields/{name}") as temporary:
            meshio.vtu.write(temporary, meshio.Mesh(part.points, part.blocks, point_data={"displacement": u, "joint_force": force}),
                             binary=True, compression=None)
    return names


def write_piece(team: Team) -> None:
    """What the other ranks do while rank 0 writes fields: a piece of every step."""
    directory, *piece = team.hand_out(lambda rank: None)
    _write_piece(ResultsFolder(directory), *piece, team.rank)
    team.gather(None)


def _in_pieces(folder: ResultsFolder, fields: Fields, nodal: Nodal, team: Team, shown: np.ndarray | None = None) -> list[str]:
    """Have every rank write its piece; names of the files that put them together.

    Parameters
    ----------
    shown : (k,) int, which of the cells; None: all
    """
    order = np.argsort(fields.subdomain, kind="stable")
    if shown is not None:
        order = order[np.isin(order, shown)]
    ends = np.linspace(0, len(order), team.size + 1).astype(int)
    stress = np.array([nodal.everywhere(nodal.stress(step)) for step in range(fields.steps)])

    def piece(rank: int) -> tuple[Fields, np.ndarray]:
        chosen = np.sort(order[ends[rank] : ends[rank + 1]])
        return fields.some(chosen), stress[:, np.unique(fields.cells[chosen])]

    _write_piece(folder, *team.hand_out(lambda rank: (os.fspath(folder.path.absolute()), *piece(rank)))[1:], 0)
    team.gather(None)
    for rank in range(1, team.size):
        if not all((folder / f"fields/{name}").is_file() for name in _names(fields.steps, rank)):
            _write_piece(folder, *piece(rank), rank)  # that rank's disk is another one
    names = [f"step_{step + 1:04d}.pvtu" for step in range(fields.steps)]
    one = np.arange(min(1, len(fields.cells)))
    for step, name in enumerate(names):
        write_pvtu(folder, f"fields/{name}", [_names(fields.steps, rank)[step] for rank in range(team.size)],
                   *_data(fields.some(one), step, stress[step, np.unique(fields.cells[one])]))
    return names


def _names(steps: int, rank: int) -> list[str]:
    return [f"step_{step + 1:04d}_{rank}.vtu" for step in range(steps)]


def _write_piece(folder: ResultsFolder, piece: Fields, stress: np.ndarray, rank: int) -> None:
    for step, name in enumerate(_names(piece.steps, rank)):
        _write_step(folder, f"fields/{name}", piece, step, stress[step])


def _write_step(folder: ResultsFolder, name: str, fields: Fields, step: int, stress: np.ndarray) -> None:
    write_vtu(folder, name, fields.nodes, fields.cells, *_data(fields, step, stress))


def _data(fields: Fields, step: int, stress: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What a step's file says of nodes, with their stress (n, 6), and of cells."""
    sigma = fields.stress(step)
    cells = {"stress": sigma, "von_mises": von_mises(sigma), "subdomain": fields.subdomain.astype(np.int32)}
    if fields.cells.shape[1] == 10:
        cells["von_mises_max"] = fields.nodal_von_mises(step).max(axis=1)
    if fields.discretisation_error is not None:
        cells["discretisation_error"] = fields.discretisation_error[step]
    return {"displacement": fields.displacement[step], "nodal_stress": stress, "principal_stress": principal(stress)}, cells
