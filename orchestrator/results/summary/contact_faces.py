"""Faces in contact: what they carry of what friction can hold, and from which load on they slip.

With p the pressure, t the friction traction and A the area of a point, r its arm about the centre of Σ μ p A, n the plane's normal,

    N = Σ p A,   F = |Σ t A|,   C = Σ μ p A,   M = |Σ n·(r × t) A|,   D = Σ μ p A |r|,   used = √((F/C)² + (M/D)²)

(1 on the ellipsoid between the force alone and the moment alone that make the whole face slide: Howe & Cutkosky, Int. J. Robotics Res.
15, 1996). On a round face F is along the axis and M about it. A face slips where nearly nothing of what could hold still sticks and
``used`` is near 1: a face that only spreads under its pressure slips everywhere, too, and goes nowhere. The load at which it slips is
between those of two steps; where two steps before it tell how ``used`` grows with the load, a straight line through them tells where.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.laws.points import Hold, table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.model import Scene

# Normals whose cosine with their mean is below 1 by more than that are of no plane, and those that look along an axis by more than
# that of no cylinder about it; planes this far apart, of the scene's size, are two; axes, found from facets, so many times that.
PLANE, ROUND, APART, TURNED = 1e-6, 0.05, 1e-4, 50
# A face slips where less than the first share of what friction can carry still sticks, and more than the second is used.
STICKS, USED = 0.01, 0.9
# Arms of friction, over the extent of a face and over where it is, that are what iterations and rounding leave.
PIVOT, ROUNDING = 1e-6, 1e-12
# Interfaces beyond which faces are not told.
MOST = 500
# A load has changed by more than this share of its largest.
CHANGED = 1e-9


@dataclass
class Face:
    """A face that two bodies touch with: pieces of one plane or of one round face.

    bodies : their names; kind : plane, head (a bolt's plane across its axis), bore (round, with room), round, face (neither)
    axis : (3,) normal of the plane or axis; through : (3,) a point of it; friction : coefficient
    points : (k,) where its pieces are among the N points of all interfaces; interfaces : their names
    """

    bodies: tuple[str, str]
    kind: str
    axis: np.ndarray
    through: np.ndarray
    friction: float
    points: np.ndarray
    interfaces: list[str]

    @property
    def name(self) -> str:
        """The face's name in the results."""
        return " | ".join(self.bodies) + (f" ({self.kind})" if self.kind not in ("plane", "face") else "")

    def goes_on(self, other: Face, apart: float) -> bool:
        """Whether another one is a piece of the same face: planes and axes no farther apart than a length."""
        if (self.bodies, self.kind, self.friction) != (other.bodies, other.kind, other.friction):
            return False
        arm, along, flat = other.through - self.through, float(abs(self.axis @ other.axis)), self.kind in ("plane", "head")
        off = abs(arm @ self.axis) if flat else float(np.linalg.norm(np.cross(arm, self.axis)))
        return self.kind == "face" or (along > 1 - (PLANE if flat else ROUND**2) and off <= (1 if flat else TURNED) * apart)


def contact_faces(scene: Scene, fields: InterfaceFields, names: Sequence[str], reactions: np.ndarray) -> list[dict[str, Any]]:
    """For each face with Coulomb's friction its names, lists over the load steps, and where it slips, see ``slip_load``; none where there
    are more than ``MOST``, grains say, of which nobody reads one by one.

    names, reactions : (E,), (E, T, …) of the entries of ``boundary``, forces first
    """
    if sum(i.law.slips for i in scene.interfaces) > MOST:
        return []
    slips = [s for s in table(i.law for i in scene.interfaces) if (s.normal, s.tangential) == (Hold.PRESSED, Hold.NEVER)]
    return [_told(scene, fields, face, slips, names, reactions) for face in _faces(scene, fields)]


def _faces(scene: Scene, fields: InterfaceFields) -> list[Face]:
    """Faces of the interfaces whose law slips for a price, pieces put together."""
    found: list[Face] = []
    apart = APART * 2 * scene.length
    opening, bolts = [i for i in scene.interfaces if not i.law.perfect], {bolt.name: bolt.axis for bolt in scene.bolts}
    for interface, (_, own) in zip(opening, fields.each()):
        if not interface.law.slips or own.start == own.stop:
            continue
        bodies = tuple(sorted(scene.subdomains[e].body for e in interface.subdomains))
        points, normal = fields.points[0, own], fields.normal[own]
        room = bool((fields.initial_gap[own] > 0).any())
        kind, axis, through = shape(points, normal, room, [bolts[body] for body in bodies if body in bolts])
        face = Face(bodies, kind, axis, through, float(interface.law.friction), np.arange(own.start, own.stop), [interface.name])
        same = next((other for other in found if other.goes_on(face, apart)), None)
        if same is None:
            found.append(face)
        else:
            same.points, same.interfaces = np.concatenate([same.points, face.points]), [*same.interfaces, interface.name]
    return found


def shape(points: np.ndarray, normal: np.ndarray, room: bool, bolts: Sequence[np.ndarray]) -> tuple[str, np.ndarray, np.ndarray]:
    """Kind, axis and a point of it.

    points, normal : (n, 3); room : whether sides are apart before anything is loaded; bolts : axes (3,) of bodies that are bolts
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
    through = np.linalg.lstsq(across @ away.sum(axis=0) @ across, across @ np.einsum("nij,nj->i", away, points), rcond=None)[0]
    return ("bore" if room else "round"), axis, through


def _told(scene: Scene, fields: InterfaceFields, face: Face, slips: Sequence[int], names: Sequence[str],
          reactions: np.ndarray) -> dict[str, Any]:
    own, points = face.points, fields.points[0, face.points]
    push = np.maximum(fields.pressure[:, own], 0.0) * fields.areas[:, own]
    drag, could = fields.friction_traction[:, own] * fields.areas[:, own, None], face.friction * push
    normal, capacity = push.sum(axis=1), could.sum(axis=1)
    bears = np.linalg.norm(np.einsum("tn,ni->ti", push, fields.normal[own]), axis=1)
    least = np.where(capacity > 0, capacity, np.inf)
    whole, carried, used = drag.sum(axis=1), np.zeros(len(push)), np.zeros(len(push))
    flat = face.kind in ("plane", "head")
    if flat or face.kind == "round":
        centre = np.einsum("tn,ni->ti", could, points) / least[:, None] if flat else np.tile(face.through, (len(push), 1))
        arm = points - centre[:, None]
        arm = arm - (arm @ face.axis)[:, :, None] * face.axis
        along = np.einsum("ti,i->t", whole, face.axis)
        carried = np.linalg.norm(whole, axis=1) if flat else np.abs(along)
        moment = np.abs(np.cross(arm, drag).sum(axis=1) @ face.axis)
        most = (could * np.linalg.norm(arm, axis=2)).sum(axis=1)
        pivot = capacity * (PIVOT * np.ptp(points, axis=0).max() + ROUNDING * np.abs(points).max())  # a point that bears all resists no turn
        used = np.hypot(carried / least, moment / np.where(most > pivot, most, np.inf))
    sticking = np.where(np.isin(fields.status[:, own], slips), 0.0, could).sum(axis=1) / least
    slipping = (capacity > 0) & (sticking < STICKS) & (used > USED)
    steps = {"normal": normal, "bears": bears, "carried": carried, "capacity": capacity, "used": used, "sticking": sticking,
             "slipping": slipping}
    return {"name": face.name, "bodies": list(face.bodies), "kind": face.kind, "interfaces": face.interfaces, "friction": face.friction,
            **{key: values.tolist() for key, values in steps.items()},
            "slips": slip_load(scene, slipping, used, flat * face.axis, names, reactions) if slipping.any() else None}


def slip_load(scene: Scene, slipping: np.ndarray, used: np.ndarray, normal: np.ndarray, names: Sequence[str],
              reactions: np.ndarray) -> dict[str, Any]:
    """Load step (from 1) from which on a face slips; the load at that step and the one before, and where between, as far as that is known.

    The load is the force, or the sum of the forces, of the entries of ``boundary`` that change then, in the direction in which it
    changes along the face; of supports that move, if no load does. It is null where none changes, ``at`` also where no two steps
    before that one tell how ``used`` grows.

    slipping, used : (T,) of the face; normal : (3,) of its plane, 0 where it is none; names, reactions : as for ``contact_faces``
    """
    step = int(np.argmax(slipping))
    result = {"step": step + 1, "on": None, "before": None, "load": None, "at": None}
    if step == 0:
        return result
    force = np.asarray(reactions)[:, :, :3]
    change = np.linalg.norm(force[:, step] - force[:, step - 1], axis=1) > CHANGED * np.abs(force).max(initial=0.0)
    loads = change & np.array([bool(entry.forces) for entry in scene.boundary])
    moved = change & np.array([entry.prescribed is not None and bool(np.ptp(entry.prescribed.amounts)) for entry in scene.boundary])
    chosen = np.flatnonzero(loads if loads.any() else moved)
    if not len(chosen):
        return result
    whole = force[chosen].sum(axis=0)
    way = whole[step] - whole[step - 1]
    along = way - (way @ normal) * normal  # what only presses the face does not slide it
    way = along if np.linalg.norm(along) > CHANGED * np.linalg.norm(way) else way
    load = whole @ (way / np.linalg.norm(way))
    result |= {"on": " and ".join(names[e] for e in chosen), "before": float(load[step - 1]), "load": float(load[step])}
    growth = (used[step - 1] - used[step - 2]) / (load[step - 1] - load[step - 2]) if step > 1 and load[step - 1] != load[step - 2] else 0.0
    if growth > 0:
        at = load[step - 1] + (1 - used[step - 1]) / growth
        result["at"] = float(np.clip(at, *sorted((load[step - 1], load[step]))))
    return result
