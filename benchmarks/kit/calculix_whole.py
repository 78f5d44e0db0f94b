"""A scene in one piece in CalculiX: elements C3D4 or C3D10, supports, forces, and bolts by ``*PRE-TENSION SECTION``.

Displacements are printed with seven digits: that is what two solutions agree to at most. Of a number 20 characters are read,
so that 13 digits are written. CalculiX separates at a section
those elements alone that have a face on it; tets beside them, which only touch it, are given the numbers of the copies here
that it is going to make. It does so for plane sections: where an element has two faces on one, it makes copies of copies.
"""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator import BlackBoxError, Scene

# nodes of a tet's faces S1 … S4, in the order in which CalculiX goes through them
FACETS = np.array([[1, 3, 2, 7, 6, 5], [1, 2, 4, 5, 9, 8], [2, 3, 4, 6, 10, 9], [1, 4, 3, 8, 10, 7]]) - 1


TIMEOUT = 600  # seconds; more is no comparison but a benchmark


def section(scene: Scene, bolt: Any) -> list[tuple[int, int]]:
    """Tets and faces at the cut of a bolt of the scene, on its first side."""
    corners = {frozenset(face[:3]): number for number, face in enumerate(FACETS.tolist())}
    found = []
    for triangle, cell in zip(bolt.interface.global_nodes[bolt.interface.triangles[:, :3]], bolt.interface.cells[:, 0]):
        own = scene.mesh.cells[cell, :4].tolist()
        found.append((int(cell), corners[frozenset(own.index(node) for node in triangle)]))
    return found


def connectivity(scene: Scene) -> np.ndarray:
    """(m, 4 or 10) node numbers from 1, the copies' where an element touches a section."""
    cells, told = scene.mesh.cells, scene.mesh.cells + 1
    number = len(scene.mesh.nodes) + len(scene.bolts)
    for bolt in scene.bolts:
        copies, known = {}, set()
        for cell, face in section(scene, bolt):
            for corner in FACETS[face][: 3 if cells.shape[1] == 4 else 6]:
                if cells[cell, corner] not in copies:
                    number += 1
                    copies[cells[cell, corner]] = number
                known.add((cell, int(corner)))
        for cell in scene.subdomains[bolt.interface.subdomains[0]].cells:
            for corner, node in enumerate(cells[cell]):
                if node in copies and (cell, corner) not in known:
                    told[cell, corner] = copies[node]
    return told


def deck(scene: Scene, pulls: Sequence[Sequence[float | None]] = (), heat: np.ndarray | None = None, more: str = "",
         loads: str = "") -> str:
    """The input file.

    Parameters
    ----------
    pulls : per bolt, per load step, its force; None: it keeps its length
    heat : (steps, n) temperatures, in place of all forces; None: cold
    more, loads : lines of the model, and of concentrated loads at every step
    """
    nodes, kind = scene.mesh.nodes, "C3D10" if scene.mesh.cells.shape[1] == 10 else "C3D4"
    reference = [len(nodes) + 1 + b for b in range(len(scene.bolts))]
    lines = ["*NODE,NSET=ALL", *(f"{i},{x:.12e},{y:.12e},{z:.12e}" for i, (x, y, z) in enumerate(nodes, 1))]
    told = connectivity(scene)
    for index, material in enumerate(scene.materials):
        own = np.flatnonzero(scene.cell_material == index)
        lines += [f"*ELEMENT,TYPE={kind},ELSET=M{index}", *(",".join(map(str, [e + 1, *told[e]])) for e in own),
                  f"*MATERIAL,NAME=M{index}", "*ELASTIC", f"{material.young:.12e},{material.poisson:.12e}",
                  *([f"*EXPANSION,ZERO=0.\n{material.expansion:.12e}"] if heat is not None else []),
                  f"*SOLID SECTION,ELSET=M{index},MATERIAL=M{index}"]
    for node, bolt in zip(reference, scene.bolts):
        lines += [f"*NODE,NSET=REFERENCE\n{node},{bolt.point[0]:.12e},{bolt.point[1]:.12e},{bolt.point[2]:.12e}"]
    for node, bolt in zip(reference, scene.bolts):
        lines += [f"*SURFACE,NAME=CUT{node},TYPE=ELEMENT", *(f"{c + 1},S{f + 1}" for c, f in section(scene, bolt)),
                  f"*PRE-TENSION SECTION,SURFACE=CUT{node},NODE={node}", ",".join(f"{x:.12e}" for x in bolt.axis)]
    lines += ["*INITIAL CONDITIONS,TYPE=TEMPERATURE\nALL,0."] if heat is not None else []
    lines += [more] if more else []
    for step in range(scene.steps):
        lines += ["*STEP\n*STATIC\n*BOUNDARY,OP=NEW"]
        lines += [f"{n + 1},{c + 1},{c + 1},{scene.prescribed[step, n, c]:.12e}" for n, c in np.argwhere(scene.fixed)]
        forces = ["1,1,0."]
        for node, row in zip(reference, pulls):
            if row[step] is None:
                lines += [("*BOUNDARY,FIXED" if step else "*BOUNDARY") + f"\n{node},1,1"]
            else:
                forces += [f"{node},1,{row[step]:.12e}"]
        forces += [f"{n + 1},{c + 1},{scene.loads[step, n, c]:.12e}" for n, c in np.argwhere(scene.loads[step])] if heat is None else []
        lines += ["*CLOAD,OP=NEW", *forces, *([loads] if loads else [])]
        lines += [] if heat is None else ["*TEMPERATURE,OP=NEW", *(f"{n},{t:.12e}" for n, t in enumerate(heat[step], 1))]
        lines += ["*NODE PRINT,NSET=ALL\nU\n*END STEP"]
    return "\n".join(lines) + "\n"


def printed(folder: Path, text: str) -> list[str]:
    """The lines that CalculiX prints of an input file, its files in ``folder``. Raises BlackBoxError where it does not solve it."""
    (folder / "job.inp").write_text(text)
    done = subprocess.run(["ccx", "-i", "job"], cwd=folder, capture_output=True, text=True, timeout=TIMEOUT,
                          env=dict(os.environ, OMP_NUM_THREADS="1"))
    if done.returncode or "ERROR" in done.stdout:
        raise BlackBoxError(f"CalculiX does not solve {folder / 'job.inp'}", log_tail=done.stdout[-2000:])
    return (folder / "job.dat").read_text().splitlines()


def displacements(scene: Scene, folder: Path, *rest: object, **others: object) -> np.ndarray:
    """(T, n, 3) as CalculiX has them, parameters as for ``deck``; at a section those of side 2."""
    found = []
    for line in printed(folder, deck(scene, *rest, **others)):
        if "displacements" in line:
            found.append(np.zeros((len(scene.mesh.nodes), 3)))
        elif found and len(parts := line.split()) == 4 and int(parts[0]) <= len(scene.mesh.nodes):
            found[-1][int(parts[0]) - 1] = [float(x) for x in parts[1:]]
    return np.array(found)
