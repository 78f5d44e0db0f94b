"""Several meshes put together: each moved to its place, its volumes and surfaces named after its part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.config.parts import Move
from orchestrator.config.turning import Rotate, unit
from orchestrator.scene.mesh.geometry import cross
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import INSIDE


def placed(mesh: Mesh, name: str, move: Move | None) -> Mesh:
    """A part's mesh where it belongs, with the part's names.

    A single volume is called as the part is, several ``part/volume``; surfaces are ``part/surface``.
    """
    inside = name + INSIDE
    volumes = [name] if len(mesh.volumes) == 1 else [inside + volume for volume in mesh.volumes]
    nodes = mesh.nodes if move is None else moved(mesh.nodes, move)
    return replace(mesh, nodes=nodes, volumes=volumes, surfaces={inside + s: t for s, t in mesh.surfaces.items()},
                   source=f"{name} ({mesh.source})", remarks=[f"{name}: {text}" for text in mesh.remarks],
                   smooth=[inside + s for s in mesh.smooth])


def moved(nodes: np.ndarray, move: Move) -> np.ndarray:
    """Points (n, 3) turned, one turn after another, then shifted."""
    for turn in move.rotate or []:
        nodes = turned(nodes, turn)
    return nodes if move.translate is None else nodes + np.array(move.translate)


def turned(nodes: np.ndarray, turn: Rotate) -> np.ndarray:
    """Points (n, 3) turned about an axis, by Rodrigues' formula."""
    axis = np.array(unit(turn.axis))
    sine, cosine = _exact(turn.degrees)
    arm = nodes - np.array(turn.about)
    along = np.outer(arm @ axis, axis)
    return np.array(turn.about) + along + cosine * (arm - along) + sine * cross(np.broadcast_to(axis, arm.shape), arm)


def _exact(degrees: float) -> tuple[float, float]:
    """Sine and cosine; of right angles exactly, so that faces turned onto a plane lie in it."""
    quarters, rest = divmod(degrees, 90.0)
    if rest:
        angle = np.deg2rad(degrees)
        return float(np.sin(angle)), float(np.cos(angle))
    return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[int(quarters) % 4]


def joined(meshes: list[Mesh]) -> Mesh:
    """One mesh of several that share no nodes; names of volumes and of surfaces must differ."""
    nodes = np.cumsum([0, *(len(m.nodes) for m in meshes)])
    volumes = np.cumsum([0, *(len(m.volumes) for m in meshes)])
    return Mesh(np.concatenate([m.nodes for m in meshes]),
                np.concatenate([m.cells + start for m, start in zip(meshes, nodes)]),
                np.concatenate([m.volume + start for m, start in zip(meshes, volumes)]),
                [name for m in meshes for name in m.volumes],
                {name: t + start for m, start in zip(meshes, nodes) for name, t in m.surfaces.items()},
                " + ".join(m.source for m in meshes), [text for m in meshes for text in m.remarks],
                [name for m in meshes for name in m.smooth],
                [replace(stand, volume=stand.volume + v, first=stand.first + n, triangles=stand.triangles + n)
                 for m, v, n in zip(meshes, volumes.tolist(), nodes.tolist()) for stand in m.foreign])
