"""Scenes at their limit loads, with what theory says of them: bodies that friction, and nothing else, keeps where they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import cos, exp, pi, radians, sin, tan
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from benchmarks.kit.meshes import positive

Shape = Callable[[np.ndarray], np.ndarray]  # nodes (n, 3) → where they are


def _bricks(size: Sequence[float], counts: Sequence[int], shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a box of bricks, where a shape takes these, and tets: bricks are cut into 24 each about their centres and those of their
    faces, as symmetric as the brick, so that a face bent about an axis has normals through that axis."""
    halves = 2 * np.array(counts) + 1
    index = np.stack(np.meshgrid(*map(np.arange, halves), indexing="ij"), -1)  # of half bricks
    nodes = (index * np.asarray(size) / (2 * np.asarray(counts))).reshape(-1, 3)
    bent = shape(nodes).reshape(*halves, 3)
    for axis in range(3):  # centres are the means of corners, on flat faces
        along = np.moveaxis(bent, axis, 0)
        along[1::2] = (along[:-1:2] + along[2::2]) / 2
    middle = 2 * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3) + 1
    tets = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        around = np.zeros((4, 3), int)
        around[:, one], around[:, two] = (-1, 1, 1, -1), (-1, -1, 1, 1)
        for side in (-1, 1):
            face = np.eye(3, dtype=int)[axis] * side
            for a, b in zip(around, np.roll(around, -1, axis=0)):
                tets.append(np.stack([middle, middle + face, middle + face + a, middle + face + b], axis=1))
    cells = np.ravel_multi_index(tuple(np.moveaxis(np.concatenate(tets), -1, 0)), tuple(halves))
    used, cells = np.unique(cells, return_inverse=True)
    return nodes[used], bent.reshape(-1, 3)[used], cells.reshape(-1, 4)


def _block(size: Sequence[float], counts: Sequence[int], shape: Shape = lambda x: x,
           **surfaces: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Nodes, tets, and named triangles of a box of bricks, bent to a shape; surfaces: what says which nodes of the box lie on each."""
    nodes, bent, cells = _bricks(size, counts, shape)
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    faces, times = np.unique(faces, axis=0, return_counts=True)
    outside = faces[times == 1]
    named = {name: outside[on(nodes)[outside].all(axis=1)] for name, on in surfaces.items()}
    _, first, place = np.unique(np.round(bent, 9), axis=0, return_index=True, return_inverse=True)  # a ring that is bent round closes
    place = place.ravel()
    nodes, cells, named = bent[first], place[cells], {name: place[faces] for name, faces in named.items()}
    return nodes, positive(nodes, cells), named


def _written(path: Path, **parts: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]) -> dict[str, str]:
    """The ``mesh`` section of a file with parts by name, numbered separately, and their surfaces."""
    nodes, tets, triangles, names, start = [], [], [], {}, 0
    volume, surface = [], []
    for number, (name, (own, cells, surfaces)) in enumerate(parts.items(), 1):
        names[name] = np.array([number, 3])
        nodes.append(own)
        tets.append(cells + start)
        volume.append(np.full(len(cells), number))
        for called, faces in surfaces.items():
            names.setdefault(called, np.array([len(names) + 100, 2]))
            triangles.append(faces + start)
            surface.append(np.full(len(faces), names[called][0]))
        start += len(own)
    refs = [np.concatenate(volume), np.concatenate(surface)]
    meshio.write(path, meshio.Mesh(np.concatenate(nodes), [("tetra", np.concatenate(tets)), ("triangle", np.concatenate(triangles))],
                                   cell_data={"gmsh:physical": refs, "gmsh:geometrical": refs}, field_data=names),
                 file_format="gmsh22", binary=False)
    return {"file": str(path)}


RADIUS, OFF = 10.0, radians(10.0)  # of the belt's drum, and the angle by which its ends are pulled away from it
HALF_ANGLE, WEDGE_FRICTION = radians(10.0), 0.3


def _plane(axis: int, at: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.abs(x[:, axis] - at) < 1e-9


def _ring(inner: float, angle: float = pi) -> Shape:
    """A box bent about z: its first coordinate, up to 1, is the angle, its second one the distance from a radius."""
    def bent(x: np.ndarray) -> np.ndarray:
        r, turn = inner + x[:, 1], angle * x[:, 0]
        return np.column_stack([r * np.cos(turn), r * np.sin(turn), x[:, 2]])
    return bent


def belt(folder: Path, ratio: float, friction: float = 0.2, along: int = 60) -> dict[str, Any]:
    """A thin belt over half a drum, pulled at its ends by T and ``ratio`` T."""
    thickness, width, below = 0.1, 0.5, 0.5
    drum = _block([1, below, width], [along, 1, 1], _ring(RADIUS - below), inside=_plane(1, 0))
    band = _block([1, thickness, width], [along, 1, 1], _ring(RADIUS), slack=_plane(0, 0), tight=_plane(0, 1))
    x, y = sin(OFF), -cos(OFF)
    return _problem("belt", _written(folder / "belt.msh", drum=drum, belt=band), friction, [
        {"on": "inside", "displacement": [0, 0, 0]}, {"on": "slack", "traction": [x, y, 0]},
        {"on": "tight", "traction": [-ratio * x, ratio * y, 0]}], materials=[{"young": 20e3, "poisson": 0.3}])


def belt_limit(friction: float) -> float:
    """Euler and Eytelwein: the ratio of the forces at which a thin belt slides."""
    return exp(friction * (pi - 2 * OFF))


def wedge(folder: Path, pull: float, fine: int = 2) -> dict[str, Any]:
    """A wedge pressed between two cheeks, let go, and pulled by a share of what it was pressed with."""
    slope, half, depth = tan(HALF_ANGLE), 0.5, 1.0

    def cheek(side: int) -> Shape:
        def shaped(x: np.ndarray) -> np.ndarray:
            face = half + slope * x[:, 1]
            return np.column_stack([side * (face + x[:, 0] * (1.5 - face)), x[:, 1], x[:, 2]])
        return shaped

    def shaped(x: np.ndarray) -> np.ndarray:
        return np.column_stack([(2 * x[:, 0] - 1) * (half + slope * x[:, 1]), x[:, 1], x[:, 2]])

    counts = [fine + 1, 2 * fine, fine]
    parts = {"wedge": _block([1, 1, depth], [2 * fine, 2 * fine, fine], shaped, top=_plane(1, 1)),
             "left": _block([1, 1, depth], counts, cheek(-1), out_left=_plane(0, 1)),
             "right": _block([1, 1, depth], counts, cheek(1), out_right=_plane(0, 1))}
    return _problem("wedge", _written(folder / "wedge.msh", **parts), WEDGE_FRICTION, [
        {"on": "out_*", "displacement": [0, 0, 0]}, {"on": "top", "traction": [[0, -100.0, 0], [0, 0, 0], [0, 100.0 * pull, 0]]}])


def wedge_limit() -> float:
    """The pull over the press load at which a rigid wedge comes out, if nothing of the pressure is lost when it is let go."""
    return (WEDGE_FRICTION * cos(HALF_ANGLE) - sin(HALF_ANGLE)) / (WEDGE_FRICTION * cos(HALF_ANGLE) + sin(HALF_ANGLE))


def shaft(folder: Path, pull: float, friction: float = 0.2, around: int = 24) -> dict[str, Any]:
    """A hollow shaft of radius 1 and length 1 that is pressed into a ring, then pulled along by a force; nothing contracts sideways,
    so that pulling presses neither more nor less."""
    inside = _block([1, 0.5, 1], [around, 2, 4], _ring(0.5, 2 * pi), end=_plane(2, 1))
    outside = _block([1, 0.5, 1], [around, 2, 4], _ring(1.0, 2 * pi), held=_plane(1, 0.5))
    area = pi * (1 - 0.25) * sin(2 * pi / around) / (2 * pi / around)
    made = _problem("shaft", _written(folder / "shaft.msh", shaft=inside, ring=outside), friction, [
        {"on": "held", "displacement": [0, 0, 0]}, {"on": "end", "traction": [[0, 0, 0], [0, 0, pull / area]]}],
        materials=[{"young": 200e3, "poisson": 0.0}])
    made["interfaces"][0]["gap"] = -1e-3
    return made


ARCH = 0.1075  # thickness over radius of the thinnest semicircular arch that stands (Milankovitch 1907, Heyman 1969)


def arch(folder: Path, thickness: float, voussoirs: int = 15, friction: float = 0.7) -> dict[str, Any]:
    """A semicircular arch of loose voussoirs under its own weight; its thickness over its mean radius 1."""
    parts = {}
    for k in range(-1, voussoirs + 1):  # the first and the last are what it springs from
        def placed(x: np.ndarray, k: int = k) -> np.ndarray:
            return _ring(1 - thickness / 2)(np.column_stack([(k + x[:, 0]) / voussoirs, thickness * x[:, 1], x[:, 2]]))
        ends = {"held": _plane(0, 0 if k < 0 else 1)} if k in (-1, voussoirs) else {}
        parts[f"stone_{k + 1:02d}"] = _block([1, 1, 0.2], [2, 2, 1], placed, **ends)
    return _problem("arch", _written(folder / "arch.msh", **parts), friction, [{"on": "held", "displacement": [0, 0, 0]}],
                    loads=[{"body_force": [0, -1.0, 0], "on": [f"stone_{k + 1:02d}" for k in range(voussoirs)]}])


def incline(folder: Path, share: float, friction: float = 0.2) -> dict[str, Any]:
    """A light box on an incline of ``share`` times the angle of friction, in tangents, beside a press fit."""
    parts = {}
    for name, at, ends in (("ground", (0, 0, 0), {"held": _plane(2, 0)}), ("box", (0, 0, 0.5), {}),
                           ("seat", (3, 0, 0), {"held": _plane(2, 0)}), ("plug", (3, 0, 0.5), {"held": _plane(2, 0.5)})):
        parts[name] = _block([1, 1, 0.5], [3, 3, 2], lambda x, at=at: x + np.array(at), **ends)
    made = _problem("incline", _written(folder / "incline.msh", **parts), friction, [{"on": "held", "displacement": [0, 0, 0]}],
                    loads=[{"body_force": [1e-4 * share * friction, 0, -1e-4]}])
    made["interfaces"] = [*made["interfaces"], {"between": ["seat", "plug"], "law": "contact", "friction": friction, "gap": -1e-3}]
    return made


def stack(folder: Path, push: float, friction: float, boxes: int = 5) -> dict[str, Any]:
    """Loose boxes on each other, 1 wide and 1/2 high each, pushed sideways by a share of their weight."""
    parts = {"ground": _block([1, 1, 0.5], [3, 3, 1], lambda x: x - np.array([0, 0, 0.5]), held=_plane(2, 0))}
    for k in range(boxes):
        parts[f"box_{k + 1}"] = _block([1, 1, 0.5], [3, 3, 1], lambda x, k=k: x + np.array([0, 0, 0.5 * k]))
    return _problem("stack", _written(folder / "stack.msh", **parts), friction, [{"on": "held", "displacement": [0, 0, 0]}],
                    loads=[{"body_force": [push, 0, -1.0]}])


def stack_limit(friction: float, boxes: int = 5) -> float:
    """The push over the weight at which boxes slide, or tip over the lowest one's edge."""
    return min(friction, 1 / (0.5 * boxes))


def _problem(name: str, mesh: Mapping[str, Any], friction: float, boundary: Sequence[Mapping[str, Any]], **more: Any) -> dict[str, Any]:
    return {"name": name, "mesh": mesh, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
            "interfaces": [{"between": ["*", "*"], "law": "contact", "friction": friction}], "boundary": list(boundary), **more}
