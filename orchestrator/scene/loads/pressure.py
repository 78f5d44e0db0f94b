"""``pressure``: force per area against the outward normal, the same everywhere or linear in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Part, Vector, either
from orchestrator.scene.loads.base import Forces, Kind, OnFaces
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quadratic import TRIANGLE_MOMENTS


class LinearPressure(Part):
    """A pressure that varies linearly, as a liquid's."""

    value: float = Field(0.0, description="at the point `at`, force per area along the inward normal")
    at: Vector = Field(description="a point, as one of a liquid's surface")
    gradient: Vector = Field(description="change per length along x, y and z")


class Pressure(Kind):
    takes = either(LinearPressure, float, lambda value: isinstance(value, (dict, LinearPressure)),
                   "a number, or {at: [0, 0, 10], gradient: [0, 0, -9.81e-6]}")
    meaning = "force per area along the inward normal: a number, or {value, at, gradient}"

    @classmethod
    def made(cls, value: Any, where: OnFaces) -> Forces:
        corners = where.nodes[where.triangles[:, :3]]
        there = np.full(corners.shape[:2], float(value)) if not isinstance(value, LinearPressure) else \
            value.value + (corners - np.array(value.at)) @ np.array(value.gradient)
        return against_normal(there @ TRIANGLE_MOMENTS[where.triangles.shape[1]].T, where)


def against_normal(weights: np.ndarray, where: OnFaces) -> Forces:
    """The forces of a pressure, from its integrals (k, 3 or 6) with the shape functions, over the area of each face."""
    return Forces(where.factors[:, None, None], -weights[None, :, :, None] * area_vectors(where.nodes, where.triangles)[:, None])
