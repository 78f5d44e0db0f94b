"""Points at which bodies carry each other: the forces that laws allow there, and their jumps in
rigid motions of the bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from orchestrator.laws.points import Carries
from orchestrator.scene.conditions.rigid import RIGID
from orchestrator.linalg import svd

ALIKE = 9  # digits to which normals on a plane are the same
DEPENDENT = 1e-10  # singular value over the largest, below which a row follows from others
# arrays that run along points on their first axis, others on their last
FIRST = "J", "ends", "group"


@dataclass
class Reach(Carries):
    """Forces that P points of bodies may carry.

    J : (P, 3, 12) jumps in the motions of the body on side 1, then of that on side 2; zero columns
        where it is held. For ``unresisted`` (P, 3, 13): the last one goes with what supports
        prescribe
    ends : (P, 2) int, which bodies these are
    group : (P,) int, the interface that each is on
    normal : (3, P)
    the others as ``Carries`` has them
    """

    J: np.ndarray
    ends: np.ndarray
    group: np.ndarray
    normal: np.ndarray

    @classmethod
    def of(cls, J: np.ndarray, ends: np.ndarray, group: np.ndarray, normal: np.ndarray,
           carries: Carries) -> Reach:
        """Motions are padded to six."""
        more = RIGID - len(carries.motions)
        return cls(carries.directions, carries.side, carries.limit, carries.friction,
                   np.pad(carries.motions, ((0, more), (0, 0), (0, 0))),
                   np.pad(carries.works, ((0, more), (0, 0))),
                   carries.apart, J, ends, group, normal)

    @classmethod
    def joined(cls, parts: Sequence[Reach]) -> Reach:
        """All points of several."""
        return cls(
            **{f.name: np.concatenate([getattr(part, f.name) for part in parts],
                                      axis=0 if f.name in FIRST else -1) for f in fields(cls)})

    def some(self, chosen: np.ndarray) -> Reach:
        """Some of the points."""
        return Reach(**{f.name: x[chosen] if f.name in FIRST else x[..., chosen]
                        for f in fields(self) for x in [getattr(self, f.name)]})

    def extremes(self) -> Reach:
        """The same without points that carry no more than others.

        On a plane, with one normal and one friction, forces at points within the convex hull are
        sums of forces at its corners, with their moments.
        """
        from scipy.spatial import ConvexHull  # for this alone

        cone, kept = (self.side != 0) & (self.limit == 0), np.ones(len(self.J), dtype=bool)
        key = np.round(np.column_stack([self.group, self.side, self.friction, self.normal.T]),
                       ALIKE)
        _, alike = np.unique(key[cone], axis=0, return_inverse=True)
        for each in np.split(np.flatnonzero(cone)[np.argsort(alike, kind="stable")],
                             np.cumsum(np.bincount(alike))[:-1]):
            if len(each) <= 4:
                continue
            moved = self.J[each].reshape(len(each), -1)
            place, size, _ = svd(moved - moved.mean(axis=0), full_matrices=False)
            # J is linear in the points' places
            if (size > DEPENDENT * np.linalg.norm(moved)).sum() == 2:
                kept[each] = False
                kept[each[ConvexHull(place[:, :2] * size[:2]).vertices]] = True
        return self.some(kept)

    def at_pressures(self, push: np.ndarray, opened: np.ndarray, way: np.ndarray) -> Reach:
        """Return the same with the friction that forces push (P,) ≥ 0 along the normals allow,
        whatever pushes beyond them.

        opened, way : (P,) how far sides are apart now, and how far bodies may move. A gap within
            that may close: it is taken for closed, one beyond it carries nothing. Where nothing of
            an interface touches yet, pressures are still to come, and friction with them.
        """
        touching = np.isin(self.group, self.group[push > 0])
        friction = np.where(touching, 0.0, self.friction)
        near = (push > 0) | (opened <= way) | (self.side == 0)
        limit = self.limit + np.where(touching, self.friction * push, 0.0)
        return replace(self, limit=limit, friction=friction).some(near)
