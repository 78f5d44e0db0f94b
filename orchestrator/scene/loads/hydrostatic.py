"""``hydrostatic``: the pressure γ (level − x·up) of a liquid on what is below its level, and none above.

It is linear in space where a face is wet, so that the forces are exact on faces that the level runs through, too: of the piece at the
corner that lies alone on its side, wet or dry, they are integrals of polynomials.
"""

from __future__ import annotations


import numpy as np
from pydantic import Field

from orchestrator.config.base import Axis, Part, Positive, unit
from orchestrator.scene.loads.base import Forces, Kind, OnFaces
from orchestrator.scene.loads.pressure import against_normal
from orchestrator.scene.mesh.quadratic import DEGREE_4, TRIANGLE_MOMENTS, six_functions


class Hydrostatic(Part):
    """A liquid at rest that stands at a level."""

    level: float = Field(description="coordinate of the liquid's surface along `up`, from the origin")
    weight: Positive = Field(description="force per volume of the liquid, its density times gravity (water in N and mm: 9.81e-6)")
    up: Axis = Field("z", description="x, y, z, or a direction [x, y, z]: against gravity")


class Liquid(Kind):
    takes = Hydrostatic
    meaning = "a liquid's pressure on faces below its level, none above: {level, weight, up}"
    axes = (("up",),)
    local = False  # a liquid reaches some of the faces, if not those of every rank

    @classmethod
    def made(cls, value: Hydrostatic, where: OnFaces) -> Forces:
        depth, every = (value.level - corners @ np.array(unit(value.up)) for corners in (where.nodes[where.triangles[:, :3]], where.every))
        if len(every) and not (every > 0).any():
            where.problems.add(where.path, f"faces that are all above the level, by {-every.max():.6g} at least",
                               "a level above some of the faces", "raise level, or turn up to look against gravity")
        return against_normal(value.weight * wet_moments(depth, where.triangles.shape[1]), where)


def wet_moments(depth: np.ndarray, nodes: int) -> np.ndarray:
    """(k, nodes) integrals of the shape functions of triangles times max(depth, 0), over their areas.

    depth : (k, 3) at the corners, linear between
    nodes : 3 or 6 per triangle
    """
    wet = depth > 0
    count = wet.sum(axis=1)
    result = np.where(count[:, None] >= 2, depth @ TRIANGLE_MOMENTS[nodes].T, 0.0)
    cut = np.flatnonzero((count == 1) | (count == 2))
    alone = (wet[cut] == (count[cut] == 1)[:, None]).argmax(axis=1)
    order = (alone[:, None] + np.arange(3)) % 3  # of the corners, from the one that is alone on its side of the level
    d = np.take_along_axis(depth[cut], order, axis=1)
    reach = d[:, :1] / (d[:, :1] - d[:, 1:])  # share of the two edges from it, up to the level
    weights, within = DEGREE_4
    along = within[None, :, 1:] * reach[:, None]
    at = np.zeros((len(cut), len(within), 3))
    there = np.concatenate([1 - along.sum(axis=2, keepdims=True), along], axis=2)
    np.put_along_axis(at, np.repeat(order[:, None], len(within), axis=1), there, axis=2)
    piece = np.einsum("q,kqa,q,k->ka", weights, at if nodes == 3 else six_functions(at), within[:, 0], d[:, 0] * reach.prod(axis=1))
    result[cut] += np.where(count[cut] == 1, 1.0, -1.0)[:, None] * piece
    return result
