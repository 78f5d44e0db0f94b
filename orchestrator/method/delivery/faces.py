"""Faces in contact: what they carry of what friction can hold; their points are on whichever rank.

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
from orchestrator.parallel.team import Team
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


def contact_faces(scene: Scene, fields: InterfaceFields, team: Team) -> list[Face]:
    """Each face with Coulomb's friction, and what it carries, of all ranks' interfaces, which ask
    together; none where there are more
    than ``MOST``, grains say, of which nobody reads one by one."""
    if sum(i.law.slips for i in scene.interfaces) > MOST:
        return []
    slips = [s for s in table(i.law for i in scene.interfaces)
             if (s.normal, s.tangential) == (Hold.PRESSED, Hold.NEVER)]
    found = _faces(scene, fields, team)
    carry(found, fields, slips, team)
    return found


def _faces(scene: Scene, fields: InterfaceFields, team: Team) -> list[Face]:
    """Faces of the interfaces whose law slips for a price, pieces put together."""
    own, bolts = [], {bolt.name: bolt.axis for bolt in scene.bolts}
    opening = scene.opening
    for index, (_, at) in zip(fields.index.tolist(), fields.each()):
        interface = opening[index]
        if not interface.law.slips or at.start == at.stop:
            continue
        bodies = tuple(sorted(scene.subdomains[e].body for e in interface.subdomains))
        kind, axis, through = shape(fields.points[0, at], fields.normal[at], fields.initial_gap[at],
                                    [bolts[body] for body in bodies if body in bolts])
        own.append(Face(bodies, kind, axis, through, float(interface.law.friction), [index]))
    found: list[Face] = []
    apart = APART * 2 * scene.length
    for face in sorted((face for told in team.all_gather(own) for face in told),
                       key=lambda face: face.pieces):
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
    """A rank's points of a face: what presses on each (T, n), the friction there (T, n, 3), and how
    much there could be.
    """

    def __init__(self, face: Face, fields: InterfaceFields, own: np.ndarray):
        self.face, self.at, self.normal, self.status = face, fields.points[0, own], fields.normal[
            own], fields.status[:, own]
        self.push = np.maximum(fields.pressure[:, own], 0.0) * fields.areas[:, own]
        self.drag, self.could = fields.friction_traction[:,
                                                         own] * fields.areas[:, own,
                                                                             None], face.friction * self.push

    def sums(self, slips: Sequence[int]) -> np.ndarray:
        """(T, 12) of the normal force, of that as a vector, of friction, of what it could be, and
        there as places, and of what sticks.
        """
        sticking = np.where(np.isin(self.status, slips), 0.0, self.could).sum(axis=1)
        return np.column_stack([self.push.sum(axis=1), self.push @ self.normal,
                                self.drag.sum(axis=1), self.could.sum(axis=1),
                                self.could @ self.at, sticking])

    def ends(self) -> np.ndarray:
        """(6,) the largest coordinates, and the smallest, with their signs turned."""
        return np.concatenate([self.at.max(axis=0, initial=-np.inf),
                               (-self.at).max(axis=0, initial=-np.inf)])

    def turning(self, centre: np.ndarray) -> np.ndarray:
        """(T, 2) moment about the face's axis through points (T, 3), and the most that friction
        resists.
        """
        arm = self.at - centre[:, None]
        arm = arm - (arm @ self.face.axis)[:, :, None] * self.face.axis
        return np.column_stack([np.cross(arm, self.drag).sum(axis=1) @ self.face.axis,
                                (self.could * np.linalg.norm(arm, axis=2)).sum(axis=1)])


def carry(faces: Sequence[Face], fields: InterfaceFields, slips: Sequence[int], team: Team) -> None:
    """Enter what faces carry, of all ranks; ``slips``: statuses of points that do."""
    of = {piece: number for number, face in enumerate(faces) for piece in face.pieces}
    number = np.array([of.get(index, -1) for index in fields.index.tolist()],
                      dtype=int)[fields.interface_of_node]
    own, shape_of = [_Points(face, fields, np.flatnonzero(number == k))
                     for k, face in enumerate(faces)], (len(faces), fields.steps)
    (sums,), ends = team.both([np.reshape([points.sums(slips) for points in own], (*shape_of, 12))],
                              np.ravel([p.ends() for p in own]))
    normal, capacity, sticks = (sums[..., of] for of in (0, 7, 11))
    bears, whole, places = sums[..., 1:4], sums[..., 4:7], sums[..., 8:11]
    # what rounding leaves of an open face holds nothing
    capacity = np.where(capacity > ROUNDING * capacity.max(initial=0.0), capacity, 0.0)
    least = np.where(capacity > 0, capacity, np.inf)
    centres = [at if face.flat else np.tile(face.through, (fields.steps, 1))
               for face, at in zip(faces, places / least[..., None])]
    turning, = team.sum(np.reshape([points.turning(centre) for points, centre in zip(own, centres)],
                                   (*shape_of, 2)))
    for k, (face, (high, low)) in enumerate(zip(faces, np.reshape(ends, (-1, 2, 3)))):
        carried, used = np.zeros((2, fields.steps))
        if face.flat or face.kind == "round":
            carried = np.linalg.norm(whole[k],
                                     axis=1) if face.flat else np.abs(whole[k] @ face.axis)
            # a point that bears all resists no turn
            pivot = capacity[k] * (PIVOT * (high + low).max() + ROUNDING
                                   * np.abs([high, low]).max())
            moment, most = np.abs(turning[k, :, 0]), turning[k, :, 1]
            used = np.hypot(carried / least[k], moment
                            / np.where((most > pivot) & (pivot > 0), most, np.inf))
        sticking = sticks[k] / least[k]
        face.carries = {"normal": normal[k], "bears": np.linalg.norm(bears[k], axis=1),
                        "carried": carried,
                        "capacity": capacity[k], "used": used, "sticking": sticking,
                        "slipping": (capacity[k] > 0) & (sticking < STICKS) & (used > USED)}
