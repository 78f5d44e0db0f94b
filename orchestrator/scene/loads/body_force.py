"""``body_force``: force per volume."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.config.base import Vector, one_or_per_step
from orchestrator.scene.loads.base import Forces, InVolumes, Kind
from orchestrator.scene.mesh.quadratic import TET_SHARES


class BodyForce(Kind):
    takes = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")
    meaning = "force per volume"
    listed = True

    @classmethod
    def made(cls, value: Any, where: InVolumes) -> Forces:
        amounts = np.array(value, dtype=float) if isinstance(value[0], list) else np.outer(where.factors, value)
        return uniform(amounts, where.volume, where)


def uniform(amounts: np.ndarray, sizes: np.ndarray, where: InVolumes) -> Forces:
    """Forces (steps, 3) per unit of the sizes (k,) of cells."""
    return Forces(amounts[:, None], np.outer(sizes, TET_SHARES[where.mesh.cells.shape[1]])[None, :, :, None])
