"""What a part whose mesh is not ours ends with, on its own mesh where that is known, else on its joints."""

from __future__ import annotations

from dataclasses import dataclass

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from orchestrator.blackbox.codes.foreign.condensed import Condensed


@dataclass(frozen=True)
class OwnFields:
    """Displacements of a part at every load step.

    Parameters
    ----------
    name : of the part
    points : (n, 3) its own nodes
    blocks : (meshio's name of the element, (m, nodes) int) of its elements, or of its joints' faces
    displacement : (steps, n, 3)
    force : (steps, n, 3) what acts on it through its joints
    """

    name: str
    points: np.ndarray
    blocks: list[tuple[str, np.ndarray]]
    displacement: np.ndarray
    force: np.ndarray


def on_joints(name: str, part: Condensed, u: np.ndarray, loads: np.ndarray) -> OwnFields:
    """Of the joints alone, from their displacements (steps, n, 3) and own loads (steps, 3n)."""
    force = (u.reshape(len(u), -1) @ part.stiffness - loads).reshape(u.shape)
    return OwnFields(name, part.joints.points, [("triangle", part.joints.triangles)], u, force)
