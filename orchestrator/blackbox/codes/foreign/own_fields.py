"""What a part whose mesh is not ours ends with, on its own mesh where that is known, else on its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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

