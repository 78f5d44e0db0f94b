"""A bolted scene in contact in CalculiX, in one piece: its face-to-face contact with penalties, ties, bolts by equations.

The halves of a bolt have nodes of their own at its cut, tied across the axis, and along it apart by the one displacement of a reference
node, on which the pretension acts and which is held from then on. Contact is penalised: pressures and sticking friction are those of
springs, ``STIFFNESS`` and ``STICK`` per area. Clearances that never close are left out. Stiffer springs press facets of different
meshes into one another's planes: the joint gets stiffer than either mesh is, the more so the coarser they are.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.kit.calculix_whole import FACETS, printed
from orchestrator import Scene

STIFFNESS, STICK = 1e6, 1e6  # N/mm³: some ten times what elements of steel of three millimetres have


@dataclass(frozen=True)
class Found:
    """Per load step: of each contact pair its normal force and friction, by names of the bodies; of each bolt its shortening."""

    normal: dict[tuple[str, str], np.ndarray]
    friction: dict[tuple[str, str], np.ndarray]
    shortening: np.ndarray


def contact_deck(scene: Scene) -> tuple[str, list[tuple[str, str]], list[int]]:
    """The input file; the bodies of each pair of surfaces; the bolts' reference nodes. For bolts along z, laws with one friction."""
    cells, nodes, equations, references = scene.mesh.cells.copy(), [*scene.mesh.nodes], [], []
    for bolt in scene.bolts:
        cut, own = bolt.interface, scene.subdomains[bolt.interface.subdomains[1]].cells
        copies = {int(node): len(nodes) + k for k, node in enumerate(cut.global_nodes)}
        nodes += [scene.mesh.nodes[node] for node in copies]
        cells[own] = np.vectorize(lambda node, copies=copies: copies.get(node, node))(cells[own])
        nodes.append(bolt.point)
        references.append(len(nodes))
        for node, copy in copies.items():
            equations += [f"*EQUATION\n2\n{copy + 1},{c},1.,{node + 1},{c},-1." for c in (1, 2)]
            equations.append(f"*EQUATION\n3\n{copy + 1},3,1.,{node + 1},3,-1.,{references[-1]},1,{-bolt.axis[2]:.12e}")
    lines = ["*NODE", *(f"{k},{x:.12e},{y:.12e},{z:.12e}" for k, (x, y, z) in enumerate(nodes, 1)),
             "*NSET,NSET=REFERENCE", ",".join(map(str, references)), f"*ELEMENT,TYPE=C3D{cells.shape[1]},ELSET=ALL",
             *(",".join(map(str, [e, *(own + 1)])) for e, own in enumerate(cells, 1)), "*MATERIAL,NAME=M", "*ELASTIC",
             f"{scene.materials[0].young},{scene.materials[0].poisson}", "*SOLID SECTION,ELSET=ALL,MATERIAL=M", *equations]
    friction = {i.law.friction for i in scene.interfaces if i.law.slips}
    lines += ["*SURFACE INTERACTION,NAME=RUB", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", f"{STIFFNESS:g}", "*FRICTION",
              f"{friction.pop():g},{STICK:g}"]
    prints, pairs = [], []
    for k, i in enumerate(i for i in scene.interfaces if i.mortar is not None and (i.law.perfect or np.min(i.law.distance) <= 0)):
        for side, sign in ((0, "S"), (1, "M")):
            lines += [f"*SURFACE,NAME={sign}{k},TYPE=ELEMENT", *_faces(scene, i, side)]
        if i.law.perfect:
            lines += [f"*TIE,NAME=T{k},POSITION TOLERANCE=0.5,ADJUST=NO", f"S{k},M{k}"]
        else:
            lines += ["*CONTACT PAIR,INTERACTION=RUB,TYPE=SURFACE TO SURFACE", f"S{k},M{k}"]
            prints += [f"*CONTACT PRINT,SLAVE=S{k},MASTER=M{k},FREQUENCY=1000", "CF"]
            pairs.append(tuple(sorted(scene.subdomains[e].body for e in i.subdomains)))
    for step in range(scene.steps):
        lines += ["*STEP,INC=200", "*STATIC", "0.25,1.,1e-4,1.", "*BOUNDARY,OP=NEW"]
        lines += [f"{n + 1},{c + 1},{c + 1},{scene.prescribed[step, n, c]:.12e}" for n, c in np.argwhere(scene.fixed)]
        pulls = [(node, bolt.interface.laws(scene.steps)[step].pull) for node, bolt in zip(references, scene.bolts)]
        lines += [f"*BOUNDARY,FIXED\n{node},1,1" for node, pull in pulls if pull is None]
        lines += ["*CLOAD,OP=NEW", *(f"{node},1,{-pull:.12e}" for node, pull in pulls if pull is not None),
                  *(f"{n + 1},{c + 1},{scene.loads[step, n, c]:.12e}" for n, c in np.argwhere(scene.loads[step])),
                  "*NODE PRINT,NSET=REFERENCE,FREQUENCY=1000", "U", *prints, "*END STEP"]
    return "\n".join(lines) + "\n", pairs, references


def _faces(scene: Scene, interface: object, side: int) -> list[str]:
    """Elements and their faces on one side of an interface."""
    corners = {frozenset(face[:3]): number for number, face in enumerate(FACETS.tolist(), 1)}
    at, cells = scene.side_nodes(interface, side)[interface.triangles_on(side)[:, :3]], interface.cells_on(side)[:, side]
    own = [scene.mesh.cells[cell, :4].tolist() for cell in cells]
    return [f"{cell + 1},S{corners[frozenset(map(nodes.index, face))]}" for cell, nodes, face in zip(cells, own, at.tolist())]


def contact_forces(scene: Scene, folder: Path) -> Found:
    """What CalculiX finds of a scene, its files in ``folder``.

    Raises BlackBoxError: it does not solve it
    """
    text, pairs, references = contact_deck(scene)
    folder.mkdir(exist_ok=True)
    lines, forces, lengths = printed(folder, text), [], []
    for k, line in enumerate(lines):
        if re.search(r"total surface force", line):
            forces.append([float(x) for x in lines[k + 2].split()[:3]])
        elif "displacements" in line:
            lengths.append([float(lines[k + 2 + b].split()[1]) for b in range(len(references))])
    force = np.reshape(forces, (scene.steps, len(pairs), 3))
    normal, friction = ({pair: sum(size[:, k] for k, own in enumerate(pairs) if own == pair) for pair in dict.fromkeys(pairs)}
                        for size in (np.abs(force[:, :, 2]), np.linalg.norm(force[:, :, :2], axis=2)))
    return Found(normal, friction, np.abs(lengths))
