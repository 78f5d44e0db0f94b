"""Two cantilevers, one on the other, clamped at the same end, the upper one loaded at its tip: contact along their whole common face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator import Scene

NEAR = 1e-6  # of a box around a face


def beams(length: float, friction: float = 0.0, element: str = "P1", across: int = 2, law: float = 1e-4) -> dict[str, Any]:
    """Configuration of two beams of length × 1 × 1.

    across : elements across a beam, and per unit of length
    law : law residual asked for
    """
    return {"name": "cantilevers", "mesh": {"box": {"size": [length, 1, 2], "cells": [across * round(length), across, 2 * across]}},
            "subdomains": {"grid": [1, 1, 2]}, "materials": [{"young": 200e3, "poisson": 0.3}],
            "interfaces": [{"law": "contact", "friction": friction}],
            "boundary": [{"on": {"plane": "x", "at": 0.0}, "displacement": [0, 0, 0]},
                         {"on": {"box": [[length - NEAR, -NEAR, 1 - NEAR], [length + NEAR, 1 + NEAR, 2 + NEAR]]}, "traction": [0, 0, -1]}],
            "blackbox": {"element": element}, "method": {"tolerance": {"law": law}}}


def tip(parts: Sequence[np.ndarray], scene: Scene) -> float:
    """Deflection of the upper beam's tip, given the displacements (n, 3) of the bodies."""
    x = scene.mesh.nodes[scene.subdomains[1].nodes][:, 0]
    return float(parts[1][x > x.max() - NEAR, 2].mean())
