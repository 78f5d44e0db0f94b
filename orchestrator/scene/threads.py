"""Threads: where along its shank a bolt is bonded to other parts, and the free stretch between these and its head.

What a thread is bonded to takes the bolt's force off it face by face. A cut within the thread tightens the bolt against
the part that it is screwed into: next to nothing arrives under the head.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.search import Laws
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching
from orchestrator.scene.shanks import ALIKE, away_from_joints, Shank


@dataclass(frozen=True)
class Thread:
    """Bonded faces around a shank.

    low, high : heights along the shank, from its middle
    part : name of the volume that they are of
    """

    low: float
    high: float
    part: str


def bonds(entries: Sequence[Any], names: Sequence[str], bolt: str) -> Callable[[str], bool]:
    """Return what tells whether a law of perfect interfaces holds between a bolt and the volume of a name.

    entries : of ``interfaces``; names : of all volumes; bolt : as the configuration names it
    """
    laws, own = Laws(list(entries), names), matching(bolt, names)
    return lambda name: LAWS[laws[laws.foreseen(own, [name])].law].perfect


def threads_of(mesh: Mesh, faces: Faces, own: np.ndarray, shank: Shank, holds: Callable[[str], bool]) -> list[Thread]:
    """Return the bonded stretches of a shank, one for each volume around it.

    own : (k,) int, cells of the bolt; holds : whether the volume of a name is bonded to it
    """
    mine, inner = np.isin(faces.owner, own), faces.neighbour >= 0
    beyond = inner & np.isin(faces.neighbour, own)
    around = np.flatnonzero(np.where(inner, mine ^ beyond, ~mine))
    volume = mesh.volume[np.where(mine, faces.neighbour, faces.owner)[around]]
    arm = mesh.nodes[faces.triangles[around, :3]] - shank.middle
    along = arm @ shank.axis
    off = np.linalg.norm(arm - along[..., None] * shank.axis, axis=2) - shank.radius
    near = (np.abs(off) < ALIKE * shank.radius).all(axis=1) & (np.abs(along) < shank.length / 2).any(axis=1)
    found = []
    for v in np.unique(volume[near]):
        name = mesh.volumes[v]
        if holds(name):
            heights = along[near & (volume == v)]
            found.append(Thread(float(heights.min()), float(heights.max()), name))
    return found


def free_stretch(mesh: Mesh, own: np.ndarray, shank: Shank, threads: Sequence[Thread]) -> tuple[float, float] | None:
    """Return lowest and highest place along a shank between its head and the nearest thread; None where it is bonded all along.

    Of several free stretches it is one with a head or a thread at both ends, then the longest.
    """
    half, places = shank.length / 2, [-shank.length / 2]
    arm = mesh.nodes[mesh.cells[own, :4]].reshape(-1, 3) - shank.middle
    along = arm @ shank.axis
    wide = np.linalg.norm(arm - along[:, None] * shank.axis, axis=1) > (1 + ALIKE) * shank.radius
    ends = {-half: bool((wide & (along <= -half)).any()), half: bool((wide & (along >= half)).any())}
    for thread in sorted(threads, key=lambda thread: thread.low):
        places[-1:] = [places[-1], max(thread.low, places[-1]), max(thread.high, places[-1])]
    places.append(max(half, places[-1]))
    places, room = np.clip(places, -half, half), ALIKE * shank.radius
    stretches = [(low, high) for low, high in zip(places[::2], places[1::2]) if high - low > room]
    return max(stretches, key=lambda at: (sum(ends.get(end, True) for end in at), at[1] - at[0]), default=None)


def auto_cut(mesh: Mesh, own: np.ndarray, shank: Shank, threads: Sequence[Thread], ends: np.ndarray) -> np.ndarray:
    """Return the point (3,) of the cut across a shank, between head and thread, away from where parts end beside it.

    ends : of ``ends_beside``
    """
    return shank.middle + away_from_joints(mesh, own, shank, ends, 0.0, free_stretch(mesh, own, shank, threads)) * shank.axis


def within(threads: Sequence[Thread], at: float) -> Thread | None:
    """Return the thread that a place along the shank is within."""
    return next((thread for thread in threads if thread.low < at < thread.high), None)
