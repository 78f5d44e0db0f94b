"""Supports on a rigid ground: ``foundation``, springs along the normal and across it, or along
three directions, and ``coupling``, a point that a surface follows, rigidly or in the mean; each
of its six motions is prescribed or loaded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from orchestrator.config.base import Part, PartlyFree, Positive, Vector
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import GROUND
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.loads.base import Cylindrical, FacePlace, Ground, Kind
from orchestrator.scene.mesh.geometry import areas, node_normals, summed, unit
from orchestrator.scene.mesh.quadratic import LUMPED_SHARES, TRIANGLE_MOMENTS, TRIANGLE_SHARES


class Foundation(Part):
    """Springs to a rigid ground: along the normal and across it, or along three directions."""

    normal: Positive | None = Field(None,
                                    description="stiffness along the surface's normal, force per "
                                    "area and per length")
    tangential: float | None = Field(None, ge=0,
                                     description="stiffness across it, beside normal; none: 0")
    stiffness: Annotated[list[Annotated[float, Field(ge=0)]],
                         Field(min_length=3, max_length=3)] | None = Field(None, description=(
        "in place of the others: stiffness along x, y and z, or along the directions of a frame"))


@dataclass(frozen=True)
class Springs(Ground):
    """Springs, or directions that are held.

    stiffness : (3,) per area, infinite where held, 0 where free
    given : (steps, 3) displacements along the directions
    frame : of the directions; None: x, y and z
    upright : the normal and two directions across it instead
    """

    stiffness: np.ndarray
    given: np.ndarray
    frame: Cylindrical | None
    upright: bool = False

    def laws(self, points: np.ndarray, triangles: np.ndarray) -> list[Any]:
        normal, count = node_normals(points, triangles), len(points)
        directions = np.broadcast_to(np.eye(3),
                                     (count, 3,
                                      3)) if self.frame is None else self.frame.directions(points)
        if self.upright:
            across = unit(np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)]))
            directions = np.stack([normal, across, np.cross(normal, across)], axis=1)
        each = self.stiffness[:, None]
        stiffness = each * np.where(np.isfinite(each), _spring_shares(triangles, count), 1.0)
        return [GROUND["support"](np.ascontiguousarray(directions.transpose(1, 2, 0)), stiffness,
                                  np.repeat(row[:, None], count, axis=1), normal.T)
                for row in self.given]

    def gives(self, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        springs = np.where(np.isfinite(self.stiffness), self.stiffness, 0.0)
        return np.abs(springs[:, None, None] * self.laws(points, triangles)[0].frame).max(
            axis=(0, 2))


def _spring_shares(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return (count,) what springs at nodes of faces (k, 3 or 6) have of the area that laws act on:
    an even pressure on a six-node face is one of the middles of its edges.
    """
    result, size = np.zeros(count), triangles.shape[1]
    result[triangles] = TRIANGLE_SHARES[size] / LUMPED_SHARES[size]
    return result


class Bedding(Kind):
    takes = Foundation
    meaning = "springs to the ground: {normal, tangential}, or {stiffness: [x, y, z]}"

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        if entry.get("history") is not None:
            yield Problem((*path[:-1], "history"),
                          "history beside foundation, whose springs are what they are",
                          "a history of what is prescribed or loaded", "remove the history")
        if not isinstance(value, dict):
            return
        given = [key for key in Foundation.model_fields if value.get(key) is not None]
        if given not in (["normal"], ["normal", "tangential"], ["stiffness"]):
            yield Problem(path, " and ".join(given) or "nothing",
                          "normal, with tangential or without, or stiffness alone",
                          "write {normal: 1.0e4}, or {stiffness: [0, 0, 1.0e4]}")
        elif isinstance(stiffness := value.get("stiffness"), list) and not any(stiffness):
            yield Problem((*path, "stiffness"), "no stiffness along any direction",
                          "one above 0 at least", "leave the entry out")

    @classmethod
    def turned(cls, value: Any) -> bool:
        return isinstance(value, dict) and value.get("stiffness") is not None

    @classmethod
    def made(cls, value: Foundation, where: FacePlace) -> Springs:
        across = value.tangential or 0.0
        stiffness = np.array(value.stiffness or [value.normal, across, across])
        where.check_frame(np.ones(3))
        return Springs(stiffness, np.zeros((len(where.factors), 3)), where.frame,
                       value.stiffness is None)


class Coupling(Part):
    """A point that the surface follows: each of its six motions is prescribed, or null and
    loaded.
    """

    kind: Literal["rigid", "distributed"] = Field("rigid", description=(
        "rigid: the surface moves as a rigid body; distributed: so in the mean, weighted by area, "
        "and free to deform"))
    about: Vector | None = Field(None,
                                 description="the point, on the surface or not; none: the "
                                 "surface's centre")
    displacement: PartlyFree = Field([None, None, None],
                                     description="of the point; null where it is loaded, by "
                                                 "`force`")
    rotation: PartlyFree = Field([None, None, None],
                                 description="degrees about x, y and z, small; null where loaded, "
                                 "by `moment`")
    force: Vector = Field([0.0, 0.0, 0.0],
                          description="at the point, in components that are not prescribed")
    moment: Vector = Field([0.0, 0.0, 0.0],
                           description="about the point, in components that are not prescribed")


@dataclass(frozen=True)
class Followed(Ground):
    """The point: what is prescribed of its motions or loads it, times factors (steps,)."""

    coupling: Coupling
    factors: np.ndarray

    whole = True

    def laws(self, points: np.ndarray, triangles: np.ndarray) -> list[Any]:
        c = self.coupling
        area = areas(points, triangles)
        about = area @ points[triangles[:, :3]].mean(
            axis=1) / area.sum() if c.about is None else np.array(c.about)
        motions = np.ascontiguousarray(motions_about(points, about, 1.0).transpose(2, 1, 0))
        amounts = [*c.displacement, *(None if x is None else np.radians(x) for x in c.rotation)]
        # forces of tractions that vary linearly, ∫ φ R over the faces
        each = np.einsum("k,ab,jckb->kajc", area, TRIANGLE_MOMENTS[triangles.shape[1]],
                         motions[:, :, triangles[:, :3]])
        forces = np.ascontiguousarray(summed(
            triangles, each.reshape(*triangles.shape, -1), len(points)).T).reshape(motions.shape)
        prescribed = np.array([x is not None for x in amounts])
        given = np.where(prescribed, [x or 0.0 for x in amounts], [*c.force, *c.moment])
        return [GROUND["coupling"](motions, prescribed, factor * given, c.kind == "rigid",
                                   forces)
                for factor in self.factors]


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
                              "one of the two: what is prescribed is not loaded",
                              f"write null for it in {held}, or 0 in {load}")
        if value.get("kind",
                     "rigid") != "rigid" and not any(x is not None for pair in pairs
                                                     for x in pair[2]) and \
                not any(f for pair in pairs for f in pair[3]):
            yield Problem(path, "nothing prescribed and nothing loaded",
                          "a displacement, rotation, force or moment",
                          "leave the entry out; kind: rigid alone keeps a surface rigid")

    @classmethod
    def made(cls, value: Coupling, where: FacePlace) -> Followed:
        return Followed(value, where.factors)
