"""``resultant``: a force and a moment of a surface as a whole, spread as a traction that varies linearly.

A force F and a moment M about a point p become t = F / A + ω × (x − c), c the centre of the area A, with ω from
J ω = M + (p − c) × F and J = ∫ |r|² I − r rᵀ, r = x − c: the one whose resultant and moment they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Part, Vector
from orchestrator.errors import KeyPath, Problem
from orchestrator.scene.loads.base import Forces, Kind, OnFaces
from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.quadratic import TRIANGLE_MOMENTS


class Resultant(Part):
    """A force and a moment on a surface as a whole, spread over it as a traction that varies linearly."""

    force: Vector = Field([0.0, 0.0, 0.0], description="the force; zero by default, for a moment alone")
    moment: Vector = Field([0.0, 0.0, 0.0], description="the moment about `about`; zero by default")
    about: Vector | None = Field(None, description="where the force acts, on the surface or not; none: the surface's centre")


class Spread(Kind):
    takes = Resultant
    meaning = "force and moment as a whole: {force, moment, about}"
    local = False

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        if isinstance(value, dict) and not value.get("force") and not value.get("moment"):
            yield Problem(path, "neither force nor moment", "one of them, or both", "add force: [0, 0, -1000]")

    @classmethod
    def made(cls, value: Resultant, where: OnFaces) -> Forces:
        moments = TRIANGLE_MOMENTS[where.triangles.shape[1]]
        if not len(where.triangles):
            return Forces(where.factors[:, None, None], np.zeros((1, 0, len(moments), 3)))
        own, corners = where.nodes[where.triangles[:, :3]], where.every
        area = areas(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        centre = area @ corners.mean(axis=1) / area.sum()
        r = corners - centre
        second = np.einsum("k,ab,kax,kby->xy", area, TRIANGLE_MOMENTS[3], r, r)
        force, point = np.array(value.force), centre if value.about is None else np.array(value.about)
        turn = np.linalg.solve(np.trace(second) * np.eye(3) - second, np.array(value.moment) + np.cross(point - centre, force))
        traction = force / area.sum() + np.cross(turn, own - centre)
        return Forces(where.factors[:, None, None], np.einsum("k,ab,kbc->kac", areas(where.nodes, where.triangles), moments, traction)[None])
