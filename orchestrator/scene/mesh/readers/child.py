"""Reads a file of a stranger by gmsh or VTK in a process of its own, which can start no other and
takes no more memory than is free.

    python -P child.py BYTES FILE MESH.msh        by gmsh, which also knows a language with
                                                  SystemCall: its groups become physical names
    python -P child.py BYTES FILE.msh MESH.npz    by gmsh, of a mesh in partitions, what is in each
    python -P child.py BYTES FILE GRID.npz        by VTK, which would end this program where a file
                                                  declares more than there is

It ends with 1 and the reader's complaint on standard output where something is wrong. FILE is for
gmsh in a folder of its own: gmsh runs the options FILE.opt that it finds beside. Nothing of the
orchestrator is imported: that takes longer than to read.
"""

from __future__ import annotations

import ctypes
import errno
import json
import platform
import re
import resource
import struct
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# Linux's numbers: of prctl, of its filter, and of what that answers below
PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, FILTER = 38, 22, 2
# instructions of the kernel's filter
LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
# where they find the call's number, the machine's, its first argument's lower half
NUMBER, ARCHITECTURE, ARGUMENT = 0, 4, 16
ALLOW, REFUSE = 0x7FFF0000, 0x00050000  # its answers
THREAD = 0x00010000  # clone's flag: no process of its own
# machine → its number; calls that start programs, fork, trace others or open connections; clone;
# clone3
MACHINES = {"x86_64": (0xC000003E, (59, 322, 57, 58, 101, 310, 311, 41), 56, 435),
            "aarch64": (0xC00000B7, (221, 281, 117, 270, 271, 198), 220, 435)}


SHOWN = 200  # letters of a complaint


def apart(room: float, source: Path, target: Path, folder: str) -> str:
    """Runs this module in a folder; what the reader complains of, empty where it has written the
    target.

    room : bytes that it may take; source, target : as above
    """
    done = subprocess.run([sys.executable, "-P", __file__, str(int(room)), str(source),
                           str(target)], cwd=folder, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                          errors="replace", process_group=0)
    if not done.returncode and target.is_file():
        return ""
    said = done.stdout.strip().splitlines()[-1:] if done.returncode == 1 else []
    return said[0].replace(str(source),
                           source.name)[
                               :SHOWN] if said else f"its reader ended with {done.returncode}"


def locked() -> bool:
    """Takes from this process, for good, the right to start others; False where the system knows no
    such thing.
    """
    if sys.platform != "linux" or platform.machine() not in MACHINES:
        return False
    machine, calls, clone, clone3 = MACHINES[platform.machine()]
    refuse, unknown = REFUSE | errno.EPERM, REFUSE | errno.ENOSYS
    steps = [(LOAD, 0, 0, ARCHITECTURE), (EQUAL, 1, 0, machine), (RETURN, 0, 0, refuse),
             # calls of another width
             (LOAD, 0, 0, NUMBER), (AT_LEAST, 0, 1, 0x40000000), (RETURN, 0, 0, refuse)]
    for call in calls:
        steps += [(EQUAL, 0, 1, call), (RETURN, 0, 0, refuse)]
    # clone3 hides its flags behind a pointer: the C library then takes clone
    steps += [(EQUAL, 0, 1, clone3), (RETURN, 0, 0, unknown), (EQUAL, 0, 3, clone),
              (LOAD, 0, 0, ARGUMENT), (ANY_BIT, 1, 0, THREAD), (RETURN, 0, 0, refuse),
              (RETURN, 0, 0, ALLOW)]
    # each: code, jumps if true and if false, value
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in steps))
    program = struct.pack("HP", len(steps), ctypes.addressof(code))
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    return not prctl(# Linux's numbers: of prctl, of its filter, and of what that answers below
PR_SET_NO_NEW_PRIVS, 1, 0, 0,
                     0) and not prctl(PR_SET_SECCOMP, FILTER, program, 0, 0)


def by_gmsh(source: str, target: str) -> None:
    """Writes a file that gmsh reads as gmsh's own; raises whatever gmsh raises."""
    gmsh = _opened(source)
    names = {group: gmsh.model.getPhysicalName(*group).strip()  # MED's have 80 letters
             for group in gmsh.model.getPhysicalGroups()}
    free = _free_volumes(gmsh.model, names)
    for name in {gmsh.model.getPhysicalName(*group) for group in (*names, *free)} - {""}:
        gmsh.model.removePhysicalName(name)  # of all dimensions, and of groups that are no more
    for group, name in {**names, **free}.items():
        if name:
            gmsh.model.setPhysicalName(*group, name)
    gmsh.model.mesh.renumberNodes()  # readers keep an array as long as the largest number
    gmsh.model.mesh.renumberElements()
    gmsh.option.setNumber("Mesh.SaveAll", 0 if names else 1)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(target)


def _opened(source: str) -> Any:
    """Return gmsh, which has read a file; raises whatever it raises."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    try:
        gmsh.merge(source)
    except Exception as error:
        raise RuntimeError(str(error).strip() or gmsh.logger.getLastError()) from None
    return gmsh


def by_parts(source: str, target: str) -> None:
    """Write nodes with their tags, and of each partition elements of volumes, and of surfaces that
    are in groups, with their tags; ``blocks`` tells what they are, ``listed`` all partitions of the
    mesh, ``surfaces`` the names of all its surfaces."""
    import numpy as np

    model, blocks, rows = _opened(source).model, [], {}
    for dimension, word in ((2, "surface"), (3, "volume")):
        for _, tag in model.getEntities(dimension):
            groups = [model.getPhysicalName(dimension, group).strip() or f"{word}_{group}"
                      for group in model.getPhysicalGroupsForEntity(dimension, tag)]
            partitions = model.getPartitions(dimension, tag).tolist()
            if not partitions or dimension == 2 and not groups:
                continue
            for kind, own, nodes in zip(*model.mesh.getElements(dimension, tag)):
                table = np.column_stack([own, nodes.reshape(len(own), -1)])
                rows[f"rows_{len(blocks)}"] = table.astype(int)
                blocks.append([dimension, int(kind), partitions[0], groups])
    tags, points, _ = model.mesh.getNodes()
    listed = sorted({number for entity in model.getEntities(3)
                     for number in model.getPartitions(*entity).tolist()})
    surfaces = [name for group in model.getPhysicalGroups(2)
                if (name := model.getPhysicalName(*group).strip())]
    np.savez(target, tags=tags.astype(int), points=points.reshape(-1, 3), **rows,
             about=np.array(json.dumps({"blocks": blocks, "listed": listed, "surfaces": surfaces})))


def _free_volumes(model: Any, groups: Iterable[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Put gmsh's volumes that are in no physical group in groups, if anything is in one, and
    return the names of these: without, meshio reads no such file."""
    held = [tag for d, number in groups if d == 3
            for tag in model.getEntitiesForPhysicalGroup(3, number)]
    free = [tag for _, tag in model.getEntities(3) if groups and tag not in held
            and len(model.mesh.getElementTypes(3, tag))]
    asked = [(free, "volume_0")] if held and free else [([tag], f"volume_{tag}") for tag in free]
    return {(3, model.addPhysicalGroup(3, tags)): name for tags, name in asked}


def by_vtk(source: str, target: str) -> None:
    """Writes points, cells, and arrays of one component on the cells and of the file, with their
    names.

    Raises RuntimeError: VTK complains
    """
    import numpy as np
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import (
        vtkLogger, vtkOutputWindow, vtkStringOutputWindow, vtkVersion)
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    heard = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(heard)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    legacy = source.lower().endswith(".vtk")
    reader = vtkUnstructuredGridReader() if legacy else vtkXMLUnstructuredGridReader()
    reader.SetFileName(source)
    if legacy:
        reader.ReadAllScalarsOn()
        reader.ReadAllFieldsOn()
    reader.Update()
    # of a grid half read too: "ERROR: In file, line\nvtkReader (0x…): what is wrong"
    if complaints := heard.GetOutput().strip():
        first = re.search(r"\(0x\w+\): (.+)", complaints)
        raise RuntimeError(first[1] if first else complaints)
    grid, found = reader.GetOutput(), {}
    if grid.GetNumberOfCells():
        cells = grid.GetCells()
        renamed = (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 6)
        kinds = grid.GetCellTypes() if renamed else grid.GetCellTypesArray()
        found = {"points": vtk_to_numpy(grid.GetPoints().GetData()),
                 "nodes": vtk_to_numpy(cells.GetConnectivityArray()),
                 "ends": vtk_to_numpy(cells.GetOffsetsArray()), "types": vtk_to_numpy(kinds)}
    for what, data in (("cell", grid.GetCellData()), ("field", grid.GetFieldData())):
        arrays = [data.GetAbstractArray(i) for i in range(data.GetNumberOfArrays())]
        arrays = [a for a in arrays if a.GetName()
                  and (what == "field" or a.GetNumberOfComponents() == 1)]
        found[f"{what}_names"] = np.array([a.GetName() for a in arrays], dtype=str)
        for i, a in enumerate(arrays):
            if a.IsA("vtkStringArray"):
                found[f"{what}_{i}"] = np.array([a.GetValue(j)
                                                 for j in range(a.GetNumberOfValues())], dtype=str)
            else:
                found[f"{what}_{i}"] = vtk_to_numpy(a).ravel()
    np.savez(target, **found)


if __name__ == "__main__":
    limit = int(sys.argv[1]) + (1 << 30)  # and the readers' own code
    gmshs = [name.endswith(".msh") for name in sys.argv[2:]]
    reader = by_gmsh if gmshs[1] else by_parts if gmshs[0] else by_vtk
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    locked()
    try:
        reader(*sys.argv[2:])
    except Exception as error:
        print((str(error).strip().splitlines() or [type(error).__name__])[-1])
        sys.exit(1)
