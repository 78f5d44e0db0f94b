"""The field files of a run: fields.npz for programs (``npz``), fields/ (.vtu per step and a .pvd)
for ParaView.

ParaView shows the six components of the stress under their names and takes them as a symmetric
tensor. In the .vtu files every part and every matter has its own nodes, and where interfaces can
open every body, so that bodies separate and stresses at nodes are of one body each; what happens on
the interfaces is in files of their own.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from orchestrator.blackbox.codes.parts import OwnFields
from orchestrator.method.delivery.interface_fields import SHIFTS
from orchestrator.registry import GROUND, LAWS
from orchestrator.results.fields.fields import Fields, NAME, write_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.elasticity import principal, von_mises

PVD, INTERFACES_PVD = "fields/fields.pvd", "fields/interfaces.pvd"
STEP, INTERFACE = "step", "interface"  # what names of files begin with


def write_fields(folder: ResultsFolder, fields: Fields, beside: Sequence[OwnFields] = ()) -> None:
    """Write fields.npz and fields/step_0001.vtu … with fields/fields.pvd (time = step, from 1).

    beside : of parts with a mesh of their own, which have files of theirs in the same collection
    """
    with folder.replacing(NAME) as temporary:
        write_npz(temporary, fields)
    folder.remove("fields/*.vtu", "fields/*.pvd")  # of an earlier run with more steps
    # of what stands for these parts nothing is shown
    hidden = [k for k, name in enumerate(fields.parts) if name in {part.name for part in beside}]
    shown = np.flatnonzero(~np.isin(fields.part, hidden)) if hidden else slice(None)
    _write_steps(folder, _names(STEP, fields.steps), fields, shown)
    write_pvd(folder, PVD, _names(STEP, fields.steps),
              [_write_beside(folder, part) for part in beside])
    if fields.interfaces is not None:
        names = _names(INTERFACE, fields.steps)
        _write_interfaces(folder, names, fields)
        write_pvd(folder, INTERFACES_PVD, names)


def _names(what: str, steps: int) -> list[str]:
    return [f"{what}_{step:04d}.vtu" for step in range(1, steps + 1)]


def _write_beside(folder: ResultsFolder, part: OwnFields) -> list[str]:
    """Files of a part with a mesh of its own, one per load step; their names."""
    import meshio  # not before there is something to write

    plain = "".join(c if c.isalnum() or c in "-_." else "_" for c in part.name)
    names = _names(plain, len(part.displacement))
    for name, u, force in zip(names, part.displacement, part.force):
        grid = meshio.Mesh(part.points, part.blocks,
                           point_data={"displacement": u, "joint_force": force})
        with folder.replacing(f"fields/{name}") as temporary:
            meshio.vtu.write(temporary, grid, binary=True, compression=None)
    return names


def _write_steps(folder: ResultsFolder, names: Sequence[str], fields: Fields,
                 shown: np.ndarray | slice) -> None:
    """Write a grid of every load step, of the cells ``shown``: every stress at the nodes has nodes
    of its own.
    """
    nodal, opened = fields.nodal, fields.opened
    node, cells = nodal.split
    at, corners = np.arange(len(node)), cells[shown]
    if not isinstance(shown, slice):
        at, corners = np.unique(corners, return_inverse=True)
        corners = corners.reshape(-1, cells.shape[1])
    for step, name in enumerate(names):
        stress, sigma = nodal.everywhere(nodal.stress(step))[at], opened.stress(step)[shown]
        inside = {"stress": sigma, "von_mises": von_mises(sigma),
                  "subdomain": fields.subdomain[shown].astype(np.int32)}
        if fields.part is not None:
            inside["part"] = fields.part[shown].astype(np.int32)
        if cells.shape[1] == 10:
            inside["von_mises_max"] = opened.nodal_von_mises(step)[shown].max(axis=1)
        if fields.discretisation_error is not None:
            inside["discretisation_error"] = fields.discretisation_error[step][shown]
        write_vtu(folder, f"fields/{name}", opened.nodes[node[at]], corners,
                  {"displacement": opened.displacement[step][node[at]], "nodal_stress": stress,
                   "nodal_von_mises": von_mises(stress), "principal_stress": principal(stress)},
                  inside, {f"part {name}": k for k, name in enumerate(fields.parts) if name})


def _write_interfaces(folder: ResultsFolder, names: Sequence[str], fields: Fields) -> None:
    """Write the triangles of interfaces with gap, slip, pressure, friction traction, status, and
    shifts where they are known; what pulls at the cut through a bolt is a tension, and no pressure.

    names : of files, one for each load step
    """
    i, sides = fields.interfaces, [fields.interface_displacement(side) for side in (0, 1)]
    shifts = {name: x for name in SHIFTS if (x := getattr(i, name)) is not None}
    pulled = np.array([(LAWS if law in LAWS else GROUND)[law].axial for law in map(str, i.laws)],
                      bool)[i.interface_of_node]
    told = {"displacement_1": sides[0], "displacement_2": sides[1], "gap": i.gap, "slip": i.slip,
            "pressure": np.where(pulled, 0.0, i.pressure)}
    if pulled.any():
        told["tension"] = np.where(pulled, -i.pressure, 0.0)
    told |= {"friction_traction": i.friction_traction, "status": i.status.astype(np.int32),
             **shifts, **i.own}
    for step, name in enumerate(names):
        write_vtu(folder, f"fields/{name}", fields.nodes[i.nodes], i.triangles,
                  {what: x[step] for what, x in told.items()},
                  {"interface": i.owner.astype(np.int32)},
                  {f"interface {name}": number for number, name in enumerate(i.names)})


_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_TYPES = {3: 5, 4: 10, 10: 24}  # VTK's, by nodes of a cell
_COUNT = np.dtype(np.uint64)  # of an array's bytes, ahead of them


def write_vtu(folder: ResultsFolder, name: str, points: np.ndarray, cells: np.ndarray,
              point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray],
              names: Mapping[str, int] | None = None) -> None:
    """Write one grid.

    name : of the file in the folder
    points : (n, 3) float
    cells : (m, 3, 4 or 10) int: triangles, tets or ten-node tets
    point_data, cell_data : name → (n,) or (n, components), (m,) or (m, components)
    names : name → number in an array of the cells; ParaView lists them as field data (texts there
        are what other readers stumble on)
    """
    m, width = cells.shape
    sets = {"Points": {"Points": points.astype(float, copy=False)},
            "Cells": {"connectivity": cells.astype(np.int64, copy=False).ravel(),
                      "offsets": np.arange(width, width * m + 1, width),
                      "types": np.full(m, _TYPES[width], np.uint8)},
            "PointData": point_data, "CellData": cell_data}
    every = [np.ascontiguousarray(values) for each in sets.values() for values in each.values()]
    sizes = [_COUNT.itemsize + values.nbytes for values in every]
    order = _in_order(sizes)
    offsets = iter(np.cumsum([0, *(sizes[k] for k in order)])[np.argsort(order)].tolist())
    rows = ['<?xml version="1.0"?>',
            f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{_ORDER}" '
            'header_type="UInt64">', "  <UnstructuredGrid>"]
    if names:
        rows += ["    <FieldData>", *(
            f'      <DataArray type="Int32" Name="{escape(text)}" NumberOfTuples="1" '
            f'format="ascii">{number}</DataArray>' for text, number in names.items()),
            "    </FieldData>"]
    rows.append(f'    <Piece NumberOfPoints="{len(points)}" NumberOfCells="{m}">')
    for what, each in sets.items():
        rows += [f"      <{what}>", *(
            f'        <DataArray {_kind(text, x)} format="appended" offset="{next(offsets)}"/>'
            for text, x in each.items()), f"      </{what}>"]
    rows += ["    </Piece>", "  </UnstructuredGrid>", '  <AppendedData encoding="raw">', "_"]
    with folder.replacing(name) as temporary, open(temporary, "wb") as file:
        file.write("\n".join(rows).encode())
        for values in (every[k] for k in order):
            file.write(_COUNT.type(values.nbytes))
            file.write(values.data.cast("B") if values.size else b"")
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _in_order(sizes: Sequence[int]) -> list[int]:
    """An order of arrays of so many bytes in which meshio 5 reads them.

    It writes base64's offset in the place of each array's own, one after the other, and looks the
    next array up among both: where they are equal it exchanges two arrays.
    """
    order, raw = list(range(len(sizes))), np.array(sizes)
    for _ in sizes:
        own, coded = (np.cumsum(each[order]) for each in (raw, 4 * -(-raw // 3)))
        if not any(np.isin(own[k:-1], coded[k - 1]).any() for k in range(1, len(order))):
            break
        order = order[1:] + order[:1]
    return order


def _kind(name: str, values: np.ndarray) -> str:
    """Return what is said of an array's numbers."""
    kind = {"i": "Int", "u": "UInt", "f": "Float"}[values.dtype.kind]
    wide = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    return f'type="{kind}{8 * values.dtype.itemsize}" Name="{name}"{wide}'


def write_pvd(folder: ResultsFolder, name: str, steps: Sequence[str],
              parts: Sequence[Sequence[str]] = ()) -> None:
    """Write a ParaView collection of one file per load step beside it, time = step from 1.

    parts : of further parts, one file per load step each
    """
    rows = [f'    <DataSet timestep="{step}" group="" part="{part}" file="{file}"/>'
            for part, files in enumerate([steps, *parts]) for step, file in enumerate(files, 1)]
    folder.write(name, "\n".join([
        '<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>",
        *rows, "  </Collection>", "</VTKFile>", ""]))
