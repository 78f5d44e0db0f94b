"""``symmetry``: a plane across x, y or z, held along its normal."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from orchestrator.scene.loads.base import Kind, OnFaces, Prescribed, Uniform
from orchestrator.scene.mesh.geometry import area_vectors

STRAIGHT = 1e-6  # how far a plane's normal may be from its axis: coordinates in files have that many digits


class Symmetry(Kind):
    takes = Literal[True]
    meaning = "true: held along the normal of a plane across an axis"
    local = False

    @classmethod
    def made(cls, value: Any, where: OnFaces) -> Prescribed:
        vectors = np.abs(area_vectors(where.every.reshape(-1, 3), np.arange(3 * len(where.every)).reshape(-1, 3)))
        axis = int(vectors.sum(axis=0).argmax())
        if not (np.delete(vectors, axis, axis=1) <= STRAIGHT * vectors[:, axis, None]).all():
            where.problems.add((*where.path[:-1], "on"), "a plane of symmetry that is curved, or across no axis",
                               "faces on a plane across x, y or z", "turn the model so that the plane is across an axis (parts have "
                               "move: {rotate: …}), or select the plane's faces alone")
        return Prescribed(np.arange(3) == axis, np.zeros((len(where.factors), 3)), Uniform())
