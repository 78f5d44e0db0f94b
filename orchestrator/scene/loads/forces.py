"""Forces on faces, ``traction``, ``pressure`` and ``resultant``; and in volumes,
``body_force``, ``gravity``, an acceleration times the density of matter, and ``spin``, the
centrifugal force ρ ω² r of a steady rotation, r from the axis; linear on every tet.

A force F and a moment M about a point p become t = F / A + ω × (x − c), c the centre of the area A,
with ω from J ω = M + (p − c) × F and J = ∫ |r|² I − r rᵀ, r = x − c: the one whose resultant and
moment they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Axis, either, one_or_per_step, Part, unit, Vector
from orchestrator.errors import KeyPath, Problem
from orchestrator.scene.loads.base import Forces, VolumePlace, Kind, FacePlace
from orchestrator.scene.mesh.geometry import area_vectors, areas
from orchestrator.scene.mesh.quadratic import (TET_MOMENTS, TET_SHARES, TRIANGLE_MOMENTS,
                                               TRIANGLE_SHARES)


class Traction(Kind):
    takes = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")
    meaning = "force per area"
    listed = True

    @classmethod
    def turned(cls, value: Any) -> bool:
        return True

    @classmethod
    def made(cls, value: Any, where: FacePlace) -> Forces:
        _, values = where.rows(value)
        area = areas(where.nodes, where.triangles)
        if where.frame is None:
            return Forces(values[:, None],
                          np.outer(area,
                                   TRIANGLE_SHARES[where.triangles.shape[1]])[None, :, :, None])
        where.check_frame(values)
        # (k, 3 corners, 3 directions, 3), taken as linear between
        along = where.frame.directions(where.nodes[where.triangles[:, :3]])
        return Forces(values[:, :, None],
                      np.einsum("k,ab,kbmc->mkac", area, TRIANGLE_MOMENTS[where.triangles.shape[1]],
                                along))


class LinearPressure(Part):
    """A pressure that varies linearly, as a liquid's."""

    value: float = Field(0.0,
                         description="at the point `at`, force per area along the inward normal")
    at: Vector = Field(description="a point, as one of a liquid's surface")
    gradient: Vector = Field(description="change per length along x, y and z")


class Pressure(Kind):
    takes = either(LinearPressure, float, lambda value: isinstance(value, (dict, LinearPressure)),
                   "a number, or {at: [0, 0, 10], gradient: [0, 0, -9.81e-6]}")
    meaning = "force per area along the inward normal: a number, or {value, at, gradient}"

    @classmethod
    def made(cls, value: Any, where: FacePlace) -> Forces:
        corners = where.nodes[where.triangles[:, :3]]
        there = np.full(corners.shape[:2],
                        float(value)) if not isinstance(value, LinearPressure) else \
            value.value + (corners - np.array(value.at)) @ np.array(value.gradient)
        weights = there @ TRIANGLE_MOMENTS[where.triangles.shape[1]].T
        return Forces(where.factors[:, None, None], -weights[None, :, :, None]
                      * area_vectors(where.nodes, where.triangles)[:, None])


class Resultant(Part):
    """A force and a moment on a surface as a whole, spread over it as a traction that varies
    linearly.
    """

    force: Vector = Field([0.0, 0.0, 0.0],
                          description="the force; zero by default, for a moment alone")
    moment: Vector = Field([0.0, 0.0, 0.0], description="the moment about `about`; zero by default")
    about: Vector | None = Field(None,
                                 description="where the force acts, on the surface or not; none: "
                                 "the surface's centre")


class Spread(Kind):
    takes = Resultant
    meaning = "force and moment as a whole: {force, moment, about}"

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        if isinstance(value, dict) and not value.get("force") and not value.get("moment"):
            yield Problem(path, "neither force nor moment", "one of them, or both",
                          "add force: [0, 0, -1000]")

    @classmethod
    def made(cls, value: Resultant, where: FacePlace) -> Forces:
        moments = TRIANGLE_MOMENTS[where.triangles.shape[1]]
        if not len(where.triangles):
            return Forces(where.factors[:, None, None], np.zeros((1, 0, len(moments), 3)))
        corners, area = where.corners, areas(where.nodes, where.triangles)
        centre = area @ corners.mean(axis=1) / area.sum()
        r = corners - centre
        second = np.einsum("k,ab,kax,kby->xy", area, TRIANGLE_MOMENTS[3], r, r)
        force, point = np.array(value.force), centre if value.about is None else np.array(
            value.about)
        turn = np.linalg.solve(np.trace(second) * np.eye(3) - second,
                               np.array(value.moment) + np.cross(point - centre, force))
        traction = force / area.sum() + np.cross(turn, corners - centre)
        return Forces(where.factors[:, None, None],
                      np.einsum("k,ab,kbc->kac", area, moments, traction)[None])


class BodyForce(Kind):
    takes = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")
    meaning = "force per volume"
    listed = True

    @classmethod
    def made(cls, value: Any, where: VolumePlace) -> Forces:
        amounts = np.array(value,
                           dtype=float) if isinstance(value[0],
                                                      list) else np.outer(where.factors, value)
        return uniform(amounts, where.volume, where)


def uniform(amounts: np.ndarray, sizes: np.ndarray, where: VolumePlace) -> Forces:
    """Forces (steps, 3) per unit of the sizes (k,) of cells."""
    return Forces(amounts[:, None],
                  np.outer(sizes, TET_SHARES[where.mesh.cells.shape[1]])[None, :, :, None])


DENSITY = "add density: to the material, mass per volume in your units (steel in t, mm, s: 7.85e-9)"


class Gravity(Kind):
    takes = Vector
    meaning = "acceleration, times the materials' density"

    @classmethod
    def made(cls, value: Any, where: VolumePlace) -> Forces | None:
        density = where.of_matter("density", DENSITY)
        return None if density is None else uniform(np.outer(where.factors, value),
                                                    where.volume * density, where)


class Spin(Part):
    """A steady rotation, whose centrifugal force acts on matter that has a density."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    rate: float = Field(description="angle in radians per time")
    about: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")


class Centrifugal(Kind):
    takes = Spin
    meaning = "{axis, rate, about}: centrifugal force by the materials' density"
    axes = (("axis",),)

    @classmethod
    def made(cls, value: Spin, where: VolumePlace) -> Forces | None:
        density = where.of_matter("density", DENSITY)
        if density is None:
            return None
        axis, mesh = np.array(unit(value.axis)), where.mesh
        corners = mesh.nodes[mesh.cells[where.cells, :4]] - np.array(value.about)
        outward = value.rate**2 * (corners - (corners @ axis)[..., None] * axis)
        return Forces(where.factors[:, None, None],
                      np.einsum("k,ab,kbi->kai", where.volume * density,
                                TET_MOMENTS[mesh.cells.shape[1]], outward)[None])
