"""Rigid tools beside Hertz and beside a meshed body: a ball and a roller on a block, a cap a thousand times as stiff."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.scene.mesh.sources import bricks

YOUNG, POISSON = 1e3, 0.3
MODULUS = YOUNG / (1 - POISSON**2)  # E* beside a rigid tool
RADIUS, SIDE, CAP, STIFFER = 1.0, 1.0, 2.0, 1000  # the tools' radius, the block's side; the cap's radius, its modulus over the block's
DEPTH = 0.0093  # of the ball: a contact of a tenth of the block


def graded(path: Path, cells: tuple[int, int, int], width: float = SIDE, grade: float = 4.0, cap: bool = False) -> None:
    """A quarter of a block, or half a slice of one, below z = 0, with fine elements at the origin.

    cells : along x, y and z, along y of one size where there are few
    width : along y
    cap : with another block on it, whose lower face is the paraboloid of radius ``CAP``
    """
    mesh = bricks(np.ones(3), np.array(cells), "block")
    t = mesh.nodes
    fine = SIDE * np.sinh(grade * t) / np.sinh(grade)
    across = fine[:, 1] if cells[1] > 2 else width * t[:, 1]
    below = -SIDE * np.sinh(grade * (1 - t[:, 2])) / np.sinh(grade)
    nodes, tets, group = [np.c_[fine[:, 0], across, below]], [mesh.cells[:, :4]], [np.ones(len(mesh.cells), int)]
    if cap:
        low = (fine[:, 0] ** 2 + across**2) / (2 * CAP)
        nodes.append(np.c_[fine[:, 0], across, low + fine[:, 2] / SIDE * (1.5 * SIDE - low)])
        tets.append(mesh.cells[:, :4] + len(t))
        group.append(np.full(len(mesh.cells), 2))
    group = np.concatenate(group)
    names = {"block": np.array([1, 3])} | ({"cap": np.array([2, 3])} if cap else {})
    meshio.write(path, meshio.Mesh(np.vstack(nodes), [("tetra", np.vstack(tets))], field_data=names, cell_data={
        "gmsh:physical": [group], "gmsh:geometrical": [group]}), file_format="gmsh22", binary=False)


def _scene(path: Path, width: float, boundary: list[dict[str, Any]], interface: dict[str, Any], **more: Any) -> dict[str, Any]:
    held = [{"on": {"plane": "z", "at": -SIDE}, "displacement": [0, 0, 0]}, {"on": {"plane": "x", "at": 0}, "symmetry": True},
            {"on": {"plane": "y", "at": 0}, "symmetry": True}] + [{"on": {"plane": "y", "at": width}, "symmetry": True}] * (width < SIDE)
    return {"name": path.stem, "mesh": {"file": str(path)}, "subdomains": "groups", "boundary": held + boundary,
            "materials": [{"young": YOUNG, "poisson": POISSON}], "interfaces": [{"law": "contact", "friction": 0.0, **interface}],
            "blackbox": {"element": "P2"}, **more}


def ball(folder: Path, count: int = 10, element: str = "P2") -> dict[str, Any]:
    """A rigid ball on a quarter of a block, ``count`` elements along each edge."""
    graded(folder / "ball.msh", (count, count, count))
    tool = {"sphere": {"centre": [0, 0, RADIUS], "radius": RADIUS}, "displacement": [0, 0, -DEPTH]}
    return _scene(folder / "ball.msh", SIDE, [], {"between": ["block", tool], "within": 0.03}) | {"blackbox": {"element": element}}


def roller(folder: Path, count: int = 24) -> dict[str, Any]:
    """A rigid roller on half a slice of a block in plane strain."""
    width = SIDE / 50
    graded(folder / "roller.msh", (count, 1, count), width)
    tool = {"cylinder": {"axis": "y", "at": [0, 0, RADIUS], "radius": RADIUS}, "displacement": [0, 0, -DEPTH]}
    return _scene(folder / "roller.msh", width, [], {"between": ["block", tool], "within": 0.03})


def cap(folder: Path, meshed: bool, count: int = 8) -> dict[str, Any]:
    """A quarter of a block under a meshed cap, ``STIFFER`` times as stiff, or under the ball that it is a part of."""
    path = folder / ("cap.msh" if meshed else "ball_of_cap.msh")
    graded(path, (count, count, count), grade=3.0, cap=meshed)
    if not meshed:
        tool = {"sphere": {"centre": [0, 0, CAP], "radius": CAP}, "displacement": [0, 0, -DEPTH]}
        return _scene(path, SIDE, [], {"between": ["block", tool], "within": 0.03})
    top = {"on": {"plane": "z", "at": 1.5 * SIDE}, "displacement": [0, 0, -DEPTH]}
    stiff = {"young": STIFFER * YOUNG, "poisson": 0.0, "on": "cap"}
    scene = _scene(path, SIDE, [top], {"between": ["block", "cap"], "gap": "geometry", "within": 0.03})
    return {**scene, "materials": [*scene["materials"], stiff]}
