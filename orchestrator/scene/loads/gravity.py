"""``gravity``: an acceleration, times the density of matter."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.config.base import Vector
from orchestrator.scene.loads.base import Forces, InVolumes, Kind
from orchestrator.scene.loads.body_force import uniform

DENSITY = "add density: to the material, mass per volume in your units (steel in t, mm, s: 7.85e-9)"


class Gravity(Kind):
    takes = Vector
    meaning = "acceleration, times the materials' density"

    @classmethod
    def made(cls, value: Any, where: InVolumes) -> Forces | None:
        density = where.of_matter("density", DENSITY)
        return None if density is None else uniform(np.outer(where.factors, value), where.volume * density, where)
