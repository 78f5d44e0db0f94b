"""Reads a mesh file by gmsh in a process of its own, which can start no other: gmsh also knows a language with SystemCall.

    python -P gmsh_child.py FILE MESH.msh

It writes what it has read, its groups as physical names; or ends with 1 and gmsh's complaint on standard output. FILE is in
a folder of its own: gmsh runs the options FILE.opt that it finds beside. Nothing of the orchestrator is imported: that
takes longer than to read.
"""

from __future__ import annotations

import ctypes
import errno
import platform
import struct
import sys

import gmsh

PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, FILTER = 38, 22, 2
LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # instructions of the kernel's filter
NUMBER, ARCHITECTURE, ARGUMENT = 0, 4, 16  # where they find the call's number, the machine's, its first argument's lower half
ALLOW, REFUSE = 0x7FFF0000, 0x00050000
THREAD = 0x00010000  # clone's flag: no process of its own
# machine → its number; calls that start programs, fork, trace others or open connections; clone; clone3
MACHINES = {"x86_64": (0xC000003E, (59, 322, 57, 58, 101, 310, 311, 41), 56, 435),
            "aarch64": (0xC00000B7, (221, 281, 117, 270, 271, 198), 220, 435)}


def locked() -> bool:
    """Takes from this process, for good, the right to start others; False where the system knows no such thing."""
    if sys.platform != "linux" or platform.machine() not in MACHINES:
        return False
    machine, calls, clone, clone3 = MACHINES[platform.machine()]
    refuse, unknown = REFUSE | errno.EPERM, REFUSE | errno.ENOSYS
    steps = [(LOAD, 0, 0, ARCHITECTURE), (EQUAL, 1, 0, machine), (RETURN, 0, 0, refuse),
             (LOAD, 0, 0, NUMBER), (AT_LEAST, 0, 1, 0x40000000), (RETURN, 0, 0, refuse)]  # calls of another width
    for call in calls:
        steps += [(EQUAL, 0, 1, call), (RETURN, 0, 0, refuse)]
    # clone3 hides its flags behind a pointer: the C library then takes clone
    steps += [(EQUAL, 0, 1, clone3), (RETURN, 0, 0, unknown), (EQUAL, 0, 3, clone),
              (LOAD, 0, 0, ARGUMENT), (ANY_BIT, 1, 0, THREAD), (RETURN, 0, 0, refuse), (RETURN, 0, 0, ALLOW)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in steps))  # each: code, jumps if true and if false, value
    program = struct.pack("HP", len(steps), ctypes.addressof(code))
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    return not prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) and not prctl(PR_SET_SECCOMP, FILTER, program, 0, 0)


def convert(source: str, target: str) -> None:
    """Writes a file that gmsh reads as gmsh's own; raises whatever gmsh raises."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.merge(source)
    for group in gmsh.model.getPhysicalGroups():
        name = gmsh.model.getPhysicalName(*group)
        if name != name.strip():  # MED's have 80 letters
            gmsh.model.removePhysicalName(name)
            gmsh.model.setPhysicalName(*group, name.strip())
    gmsh.option.setNumber("Mesh.SaveAll", 0 if _all_in_groups() else 1)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(target)


def _all_in_groups() -> bool:
    """Puts gmsh's volumes that are in no physical group in groups, if anything is in one: without, meshio reads no such file."""
    groups = gmsh.model.getPhysicalGroups()
    if not groups:
        return False
    held = [tag for d, number in groups if d == 3 for tag in gmsh.model.getEntitiesForPhysicalGroup(3, number)]
    free = [tag for _, tag in gmsh.model.getEntities(3) if tag not in held]
    for tags, name in [(free, "volume_0")] if held and free else [([tag], f"volume_{tag}") for tag in free]:
        number = gmsh.model.addPhysicalGroup(3, tags)
        if old := gmsh.model.getPhysicalName(3, number):  # of a group that is no more
            gmsh.model.removePhysicalName(old)
        gmsh.model.setPhysicalName(3, number, name)
    return True


if __name__ == "__main__":
    locked()
    try:
        convert(*sys.argv[1:])
    except Exception as error:
        lines = str(error).strip().splitlines() or gmsh.logger.getLastError().strip().splitlines() or [type(error).__name__]
        print(lines[-1])
        sys.exit(1)
