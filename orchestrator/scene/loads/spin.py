"""``spin``: the centrifugal force ρ ω² r of a steady rotation, r from the axis; linear on every tet."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from orchestrator.config.base import Axis, Part, Vector, unit
from orchestrator.scene.loads.base import Forces, InVolumes, Kind
from orchestrator.scene.loads.gravity import DENSITY
from orchestrator.scene.mesh.quadratic import TET_MOMENTS


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
