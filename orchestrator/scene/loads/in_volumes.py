"""Forces in volumes: ``body_force``, ``gravity``, an acceleration times the density of matter, and
``spin``, the centrifugal force ρ ω² r of a steady rotation, r from the axis; linear on every
tet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Axis, one_or_per_step, Part, unit, Vector
from orchestrator.scene.loads.base import Forces, InVolumes, Kind
from orchestrator.scene.mesh.quadratic import TET_MOMENTS, TET_SHARES


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


DENSITY = "add density: to the material, mass per volume in your units (steel in t, mm, s: 7.85e-9)"


class Gravity(Kind):
    takes = Vector
    meaning = "acceleration, times the materials' density"

    @classmethod
    def made(cls, value: Any, where: InVolumes) -> Forces | None:
        density = where.of_matter("density", DENSITY)
        return None if density is None else uniform(np.outer(where.factors, value), where.volume * density, where)


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
    def made(cls, value: Spin, where: InVolumes) -> Forces | None:
        density = where.of_matter("density", DENSITY)
        if density is None:
            return None
        axis, mesh = np.array(unit(value.axis)), where.mesh
        corners = mesh.nodes[mesh.cells[where.cells, :4]] - np.array(value.about)
        outward = value.rate**2 * (corners - (corners @ axis)[..., None] * axis)
        return Forces(where.factors[:, None, None],
                      np.einsum("k,ab,kbi->kai", where.volume * density, TET_MOMENTS[mesh.cells.shape[1]], outward)[None])
