"""Faces in contact: what they carry of what friction can hold.

With p the pressure, t the friction traction and A the area of a point, r its arm about the centre
of Σ μ p A, n the plane's normal,

    N = Σ p A,   F = |Σ t A|,   C = Σ μ p A,   M = |Σ n·(r × t) A|,   D = Σ μ p A |r|,
    used = √((F/C)² + (M/D)²)

(1 on the ellipsoid between the force alone and the moment alone that make the whole face slide:
Howe & Cutkosky, Int. J. Robotics Res. 15, 1996). On a round face F is along the axis and M about
it. A face slips where nearly nothing of what could hold still sticks and ``used`` is near 1: a face
that only spreads under its pressure slips everywhere, too, and goes nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.laws.points import Hold, table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.model import Scene

# Normals whose cosine with their mean is below 1 by more than that are of no plane, and those that
# look along an axis by more than
# that of no cylinder about it; planes this far apart, of the scene's size, are two; axes, found
# from facets, so many times that.
PLANE, ROUND, APART, TURNED = 1e-6, 0.05, 1e-4, 50
# What varies of the room about a shank, over what would on a plane beside it: in a hole less, on
# another cylinder from outside more.
HOLLOW = 0.5
# A face slips where less than the first share of what friction can carry still sticks, and more
# than the second is used.
STICKS, USED = 0.01, 0.9
# Arms of friction, over the extent of a face and over where it is, that are what iterations and
# rounding leave.
PIVOT, ROUNDING = 1e-6, 1e-12
# Interfaces beyond which faces are not told.
MOST = 500


@dataclass
class Face:
    """A face that two bodies touch with: pieces of one plane or of one round face.

    bodies : their names; kind : plane, head (a bolt's plane across its axis), bore (round, with
        room), round, face (neither)
    axis : (3,) normal of the plane or axis; through : (3,) a point of it; friction : coefficient
    pieces : which of the scene's interfaces that are not perfect
    carries : name → (T,) normal force, what bears, friction carried, capacity, used, what still
        sticks, whether it slips
    """

    bodies: tuple[str, str]
    kind: str
    axis: np.ndarray
    through: np.ndarray
    friction: float
    pieces: list[int]
    carries: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The face's name in the results."""
        return " | ".join(self.bodies) + (f" ({self.kind})" if self.kind not in ("plane", "face")
                                          else "")

    @property
    def flat(self) -> bool:
        """Whether it is a piece of a plane."""
        return self.kind in ("plane", "head")

    def goes_on(self, other: Face, apart: float) -> bool:
        """Whether another one is a piece of the same face: planes and axes no farther apart than a
        length.
        """
        if (self.bodies, self.kind, self.friction) != (other.bodies, other.kind, other.friction):
            return False
        arm, along = other.through - self.through, float(abs(self.axis @ other.axis))
        off = abs(arm @ self.axis) if self.flat else float(np.linalg.norm(np.cross(arm, self.axis)))
        return self.kind == "face" or (along > 1 - (PLANE if self.flat else ROUND**2)
                                       and off <= (1 if self.flat else TURNED) * apart)


def contact_faces(scene: Scene, fields: InterfaceFields) -> list[Face]:
    """Each face with Coulomb's friction, and what it carries; none where there are more than
    ``MOST``, grains say, of which nobody reads one by one.
    """
    if sum(i.law.slips for i in scene.interfaces) > MOST:
        return []
    slips = [s for s in table(i.law for i in scene.interfaces)
             if (s.normal, s.tangential) == (Hold.PRESSED, Hold.NEVER)]
    found = _faces(scene, fields)
    carry(found, fields, slips)
    return found


def _faces(scene: Scene, fields: InterfaceFields) -> list[Face]:
    """Faces of the interfaces whose law slips for a price, pieces put together."""
    found: list[Face] = []
    bolts, apart = {bolt.name: bolt.axis for bolt in scene.bolts}, APART * 2 * scene.length
    for interface, (index, at) in zip(scene.opening, fields.each()):
        if not interface.law.slips or at.start == at.stop:
            continue
        bodies = tuple(sorted(scene.subdomains[e].body for e in interface.subdomains))
        kind, axis, through = shape(fields.points[0, at], fields.normal[at], fields.initial_gap[at],
                                    [bolts[body] for body in bodies if body in bolts])
        face = Face(bodies, kind, axis, through, float(interface.law.friction), [index])
        same = next((other for other in found if other.goes_on(face, apart)), None)
        if same is None:
            found.append(face)
        else:
            same.pieces += face.pieces
    return found


def shape(points: np.ndarray, normal: np.ndarray, gap: np.ndarray,
          bolts: Sequence[np.ndarray]) -> tuple[str, np.ndarray, np.ndarray]:
    """Kind, axis and a point of it.

    points, normal : (n, 3); gap : (n,) how far sides are apart before anything is loaded; bolts :
        axes (3,) of bodies that are bolts
    """
    mean = normal.sum(axis=0)
    mean = mean / max(float(np.linalg.norm(mean)), 1e-300)
    if (normal @ mean > 1 - PLANE).all():
        across = any(abs(mean @ axis) > 1 - ROUND**2 for axis in bolts)
        return ("head" if across else "plane"), mean, points.mean(axis=0)
    axis = np.linalg.eigh(normal.T @ normal)[1][:, 0]
    if np.abs(normal @ axis).max() > ROUND:
        return "face", axis, points.mean(axis=0)
    across = np.eye(3) - np.outer(axis, axis)  # the axis is nearest to all lines along the normals
    away = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    through = np.linalg.lstsq(across @ away.sum(axis=0) @ across,
                              across @ np.einsum("nij,nj->i", away, points), rcond=None)[0]
    radius, nearest = np.linalg.norm((points - through) @ across,
                                     axis=1).mean(), normal[gap.argmin()]
    if np.ptp(gap) > HOLLOW * radius * (1 - normal @ nearest).max():
        return "face", axis, points.mean(axis=0)
    return ("bore" if (gap > 0).any() else "round"), axis, through


class _Points:
    """The points of a face: what presses on each (T, n), the friction there (T, n, 3), and how much
    there could be.
    """

    def __init__(self, face: Face, fields: InterfaceFields, own: np.ndarray):
        self.face, self.at, self.normal = face, fields.points[0, own], fields.normal[own]
        self.status, area = fields.status[:, own], fields.areas[:, own]
        self.push = np.maximum(fields.pressure[:, own], 0.0) * area
        self.drag, self.could = fields.friction_traction[:, own] * area[
            ..., None], face.friction * self.push
        self.capacity = self.could.sum(axis=1)

    def carries(self, slips: Sequence[int], nothing: float) -> dict[str, np.ndarray]:
        """Return ``Face.carries``.

        slips : statuses of points that do
        nothing : a capacity that is none
        """
        face, drag = self.face, self.drag.sum(axis=1)
        capacity, (carried, used) = np.where(self.capacity > nothing, self.capacity,
                                             0.0), np.zeros((2, len(drag)))
        least = np.where(capacity > 0, capacity, np.inf)
        if face.flat or face.kind == "round":
            carried = np.linalg.norm(drag, axis=1) if face.flat else np.abs(drag @ face.axis)
            moment, most = self._turning((self.could @ self.at / least[:, None])[:, None]
                                         if face.flat else face.through)
            # a point that bears all resists no turn
            pivot = capacity * (PIVOT * np.ptp(self.at, axis=0).max()
                                + ROUNDING * np.abs(self.at).max())
            used = np.hypot(carried / least, np.abs(moment)
                            / np.where((most > pivot) & (pivot > 0), most, np.inf))
        sticking = np.where(np.isin(self.status, slips), 0.0, self.could).sum(axis=1) / least
        return {"normal": self.push.sum(axis=1),
                "bears": np.linalg.norm(self.push @ self.normal, axis=1), "carried": carried,
                "capacity": capacity, "used": used, "sticking": sticking,
                "slipping": (capacity > 0) & (sticking < STICKS) & (used > USED)}

    def _turning(self, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T,) moment about the face's axis through points (T, 1, 3) or (3,), and (T,) the most
        that friction resists.
        """
        arm = self.at - centre + np.zeros_like(self.drag)
        arm = arm - (arm @ self.face.axis)[:, :, None] * self.face.axis
        return (np.cross(arm, self.drag).sum(axis=1) @ self.face.axis,
                (self.could * np.linalg.norm(arm, axis=2)).sum(axis=1))


def carry(faces: Sequence[Face], fields: InterfaceFields, slips: Sequence[int]) -> None:
    """Enter what faces carry; ``slips``: statuses of points that do."""
    of = {piece: number for number, face in enumerate(faces) for piece in face.pieces}
    number = np.array([of.get(index, -1) for index, _ in fields.each()],
                      dtype=int)[fields.interface_of_node]
    own = [_Points(face, fields, np.flatnonzero(number == k)) for k, face in enumerate(faces)]
    # what rounding leaves of an open face holds nothing
    nothing = ROUNDING * max((points.capacity.max() for points in own), default=0.0)
    for face, points in zip(faces, own):
        face.carries = points.carries(slips, nothing)
