"""``coupling``: a point that a surface follows, rigidly or in the mean; each of its six motions is prescribed or loaded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from orchestrator.config.base import Part, PartlyFree, Vector
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import GROUND
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.loads.base import Ground, Kind, OnFaces
from orchestrator.scene.mesh.geometry import areas


class Coupling(Part):
    """A point that the surface follows: each of its six motions is prescribed, or null and loaded."""

    kind: Literal["rigid", "distributed"] = Field("rigid", description=(
        "rigid: the surface moves as a rigid body; distributed: so in the mean, weighted by area, and free to deform"))
    about: Vector | None = Field(None, description="the point, on the surface or not; none: the surface's centre")
    displacement: PartlyFree = Field([None, None, None], description="of the point; null where it is loaded, by `force`")
    rotation: PartlyFree = Field([None, None, None], description="degrees about x, y and z, small; null where loaded, by `moment`")
    force: Vector = Field([0.0, 0.0, 0.0], description="at the point, in components that are not prescribed")
    moment: Vector = Field([0.0, 0.0, 0.0], description="about the point, in components that are not prescribed")


@dataclass(frozen=True)
class Followed(Ground):
    """The point: what is prescribed of its motions or loads it, times factors (steps,)."""

    coupling: Coupling
    factors: np.ndarray

    whole = True

    def laws(self, points: np.ndarray, triangles: np.ndarray) -> list[Any]:
        c = self.coupling
        area = areas(points, triangles)
        about = area @ points[triangles[:, :3]].mean(axis=1) / area.sum() if c.about is None else np.array(c.about)
        motions = np.ascontiguousarray(motions_about(points, about, 1.0).transpose(2, 1, 0))
        amounts = [*c.displacement, *(None if x is None else np.radians(x) for x in c.rotation)]
        prescribed = np.array([x is not None for x in amounts])
        given = np.where(prescribed, [x or 0.0 for x in amounts], [*c.force, *c.moment])
        return [GROUND["coupling"](motions, prescribed, factor * given, c.kind == "rigid") for factor in self.factors]


class Remote(Kind):
    takes = Coupling
    meaning = "remote displacement or load: {kind, about, displacement, rotation, force, moment}"

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        if not isinstance(value, dict):
            return
        pairs = [(held, load, value.get(held) or [], value.get(load) or [])
                 for held, load in (("displacement", "force"), ("rotation", "moment"))]
        if not all(isinstance(given, list) for pair in pairs for given in pair[2:]):
            return
        for held, load, motions, forces in pairs:
            both = [k for k, (x, f) in enumerate(zip(motions, forces)) if x is not None and f]
            if both:
                yield Problem((*path, load), f"component {'xyz'[both[0]]} of {load} and of {held}",
                              "one of the two: what is prescribed is not loaded", f"write null for it in {held}, or 0 in {load}")
        if value.get("kind", "rigid") != "rigid" and not any(x is not None for pair in pairs for x in pair[2]) and \
                not any(f for pair in pairs for f in pair[3]):
            yield Problem(path, "nothing prescribed and nothing loaded", "a displacement, rotation, force or moment",
                          "leave the entry out; kind: rigid alone keeps a surface rigid")

    @classmethod
    def made(cls, value: Coupling, where: OnFaces) -> Followed:
        return Followed(value, where.factors)
