"""``traction``: force per area, along x, y and z or along cylindrical directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.config.base import Vector, one_or_per_step
from orchestrator.scene.loads.base import Forces, Kind, OnFaces
from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.quadratic import TRIANGLE_MOMENTS, TRIANGLE_SHARES


class Traction(Kind):
    takes = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")
    meaning = "force per area"
    listed = True

    @classmethod
    def turned(cls, value: Any) -> bool:
        return True

    @classmethod
    def made(cls, value: Any, where: OnFaces) -> Forces:
        _, values = where.rows(value)
        area = areas(where.nodes, where.triangles)
        if where.frame is None:
            return Forces(values[:, None], np.outer(area, TRIANGLE_SHARES[where.triangles.shape[1]])[None, :, :, None])
        where.check_frame(values)
        along = where.frame.directions(where.nodes[where.triangles[:, :3]])  # (k, 3 corners, 3 directions, 3), taken as linear between
        return Forces(values[:, :, None], np.einsum("k,ab,kbmc->mkac", area, TRIANGLE_MOMENTS[where.triangles.shape[1]], along))
