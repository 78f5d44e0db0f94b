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
from itertools import count

import numpy as np

from orchestrator.blackbox.codes.parts import OwnFields
from orchestrator.method.delivery.interface_fields import SHIFTS
from orchestrator.registry import GROUND, LAWS
from orchestrator.results.fields.fields import Fields
from orchestrator.results.extremes import Nodal
from orchestrator.results.fields.npz import NAME, arrays, write_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.elasticity import principal, von_mises

PVD, INTERFACES_PVD = "fields/fields.pvd", "fields/interfaces.pvd"
STEP, INTERFACE = "step", "interface"  # what names of files begin with


def write_fields(folder: ResultsFolder, fields: Fields, beside: Sequence[OwnFields] = ()) -> None:
    """Writes fields.npz and fields/step_0001.vtu … with fields/fields.pvd (time = step, from 1).

    beside : of parts with a mesh of their own, which have files of theirs in the same collection
    """
    hidden = {part.name for part in beside}  # of what stands for these parts nothing is shown
    with folder.replacing(NAME) as temporary:
        write_npz(temporary, arrays(fields))
    folder.remove("fields/*.vtu", "fields/*.pvd")  # of an earlier run with more steps
    names = [f"{STEP}_{step + 1:04d}.vtu" for step in range(fields.steps)]
    _write_steps(folder, names, fields, hidden)
    write_pvd(folder, PVD, names, [_write_beside(folder, part) for part in beside])
    if fields.interfaces is not None:
        names = [f"{INTERFACE}_{step + 1:04d}.vtu" for step in range(fields.steps)]
        _write_interfaces(folder, names, fields)
        write_pvd(folder, INTERFACES_PVD, names)


def _write_beside(folder: ResultsFolder, part: OwnFields) -> list[str]:
    """Files of a part with a mesh of its own, one per load step; their names."""
    import meshio  # not before there is something to write

    plain = "".join(c if c.isalnum() or c in "-_." else "_" for c in part.name)
    names = [f"{plain}_{step + 1:04d}.vtu" for step in range(len(part.displacement))]
    for name, u, force in zip(names, part.displacement, part.force):
        with folder.replacing(f"fields/{name}") as temporary:
            meshio.vtu.write(temporary,
                             meshio.Mesh(part.points, part.blocks,
                                         point_data={"displacement": u, "joint_force": force}),
                             binary=True, compression=None)
    return names


def _write_steps(folder: ResultsFolder, names: Sequence[str], fields: Fields,
                 hidden: set[str]) -> None:
    """Write a grid of every load step, without parts of these names."""
    nodal, some, at, shown = fields.nodal, fields.apart, slice(None), slice(None)
    if hidden:
        shown = np.flatnonzero(~np.isin(fields.part,
                                        [i for i, name in enumerate(fields.parts)
                                         if name in hidden]))
        some, at = some.some(shown), np.unique(some.cells[shown])
    for step, name in enumerate(names):
        data = _data(nodal, some, step, at, shown)
        write_vtu(folder, f"fields/{name}", some.nodes, some.cells, *data,
                  names=_numbered("part", fields.parts))


def _data(nodal: Nodal, drawn: Fields, step: int, at: np.ndarray | slice,
          shown: np.ndarray | slice) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return what a step's file says of the nodes and cells drawn: places ``at`` of those that have
    a
    stress, cells ``shown`` of all.
    """
    sigma, stress = nodal.fields.stress(step)[shown], nodal.everywhere(nodal.stress(step))
    cells = {"stress": sigma, "von_mises": von_mises(sigma),
             "subdomain": drawn.subdomain.astype(np.int32)}
    if drawn.part is not None:
        cells["part"] = drawn.part.astype(np.int32)
    if drawn.cells.shape[1] == 10:
        cells["von_mises_max"] = nodal.fields.nodal_von_mises(step)[shown].max(axis=1)
    if drawn.discretisation_error is not None:
        cells["discretisation_error"] = drawn.discretisation_error[step]
    return {"displacement": drawn.displacement[step], "nodal_stress": stress[at],
            "nodal_von_mises": von_mises(stress[at]),
            "principal_stress": principal(stress[at])}, cells


def _numbered(what: str, names: Sequence[str]) -> dict[str, int]:
    """Number of each name in the cells' array ``what``, under a name that says what it is of."""
    return {f"{what} {name}": number for number, name in enumerate(names) if name}


def _write_interfaces(folder: ResultsFolder, names: Sequence[str], fields: Fields) -> None:
    """Write the triangles of interfaces with gap, slip, pressure, friction traction, status, and
    shifts where they are known; what pulls at the cut through a bolt is a tension, and no pressure.

    names : of files, one for each load step
    """
    i, displacement = fields.interfaces, [fields.interface_displacement(side) for side in (0, 1)]
    shifts = {name: x for name in SHIFTS if (x := getattr(i, name)) is not None}
    pulled = np.array([(LAWS if law in LAWS else GROUND)[law].axial for law in map(str, i.laws)],
                      dtype=bool)[i.interface_of_node]
    for step, name in enumerate(names):
        pressure = i.pressure[step]
        tension = {"tension": np.where(pulled, -pressure, 0.0)} if pulled.any() else {}
        write_vtu(folder, f"fields/{name}", fields.nodes[i.nodes], i.triangles,
                  {"displacement_1": displacement[0][step], "displacement_2": displacement[1][step],
                   "gap": i.gap[step], "slip": i.slip[step],
                   "pressure": np.where(pulled, 0.0, pressure), **tension,
                   "friction_traction": i.friction_traction[step],
                   "status": i.status[step].astype(np.int32),
                   **{name: x[step] for name, x in (shifts | i.own).items()}},
                  {"interface": i.owner.astype(np.int32)},
                  {f"interface {name}": number for number, name in enumerate(i.names)})


_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_TYPES = {3: 5, 4: 10, 10: 24}  # VTK's, by nodes of a cell
_COUNT = np.dtype(np.uint64)  # of an array's bytes, ahead of them


def write_vtu(folder: ResultsFolder, name: str, points: np.ndarray, cells: np.ndarray,
              point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray],
              names: Mapping[str, int] | None = None) -> None:
    """Writes one grid.

    name : of the file in the folder
    points : (n, 3) float
    cells : (m, 3, 4 or 10) int: triangles, tets or ten-node tets
    point_data, cell_data : name → (n,) or (n, components), (m,) or (m, components)
    names : name → number in an array of the cells; ParaView lists them as field data (texts there
        are what other readers stumble on)
    """
    m, width = cells.shape
    triangles = {"connectivity": cells.astype(np.int64, copy=False).ravel(),
                 "offsets": np.arange(width, width * m + 1, width),
                 "types": np.full(m, _TYPES[width], np.uint8)}
    sets = [{"Points": points.astype(float, copy=False)}, triangles, point_data, cell_data]
    every = [np.ascontiguousarray(values) for each in sets for values in each.values()]
    order = _in_order([_COUNT.itemsize + values.nbytes for values in every])
    offsets = dict(
        zip(order, np.cumsum([0, *(_COUNT.itemsize + every[k].nbytes for k in order)]).tolist()))
    number = count()

    def array(name: str, values: np.ndarray) -> str:
        return f'        <DataArray {_kind(name, values)} format="appended" offset="{offsets[next(number)]}"/>'

    listed = [
        f'      <DataArray type="Int32" Name="{escape(name)}" NumberOfTuples="1" '
        f'format="ascii">{number}</DataArray>'
              for name, number in (names or {}).items()]
    of_points, of_cells, at_points, in_cells = ([array(*item) for item in each.items()]
                                                for each in sets)
    rows = ['<?xml version="1.0"?>',
            f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{_ORDER}" '
            'header_type="UInt64">',
            "  <UnstructuredGrid>",
            *(["    <FieldData>", *listed, "    </FieldData>"] if listed else []),
            f'    <Piece NumberOfPoints="{len(points)}" NumberOfCells="{m}">',
            "      <Points>", *of_points, "      </Points>", "      <Cells>", *of_cells,
            "      </Cells>",
            "      <PointData>", *at_points, "      </PointData>", "      <CellData>", *in_cells,
            "      </CellData>",
            "    </Piece>", "  </UnstructuredGrid>", '  <AppendedData encoding="raw">', "_"]
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
    kind = {"i": "Int", "u": "UInt",
            "f": "Float"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
    return f'type="{kind}" Name="{name}"' + (f' NumberOfComponents="{values.shape[1]}"'
                                             if values.ndim > 1 else "")


def write_pvd(folder: ResultsFolder, name: str, steps: Sequence[str],
              parts: Sequence[Sequence[str]] = ()) -> None:
    """Writes a ParaView collection of one file per load step beside it, time = step from 1.

    parts : of further parts, one file per load step each
    """
    rows = [f'    <DataSet timestep="{step}" group="" part="{part}" file="{file}"/>'
            for part, files in enumerate([steps, *parts]) for step, file in enumerate(files, 1)]
    folder.write(name,
                 "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">',
                            "  <Collection>",
                            *rows, "  </Collection>", "</VTKFile>", ""]))
