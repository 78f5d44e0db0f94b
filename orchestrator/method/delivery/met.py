"""All interfaces that are not perfect, as rank 0 tells of them: a row for each, and what nodes add
up to, which stay with their ranks.

Contact that elements are too large for: places where neither pressures nor the estimated error of
the mesh are to be believed.

Curved sides, or an edge on a face, meet in a place that grows with the force. Where it is hardly
wider than a face, one mean gap keeps sides apart, hardly any stress is there, and no estimate
knows. A closed point i is at the border of its place where a point j beside it is open by shape,
its gap half or more what both differed by before anything was loaded,

    ½ gⱼ ≤ g₀ⱼ − g₀ᵢ

Plane sides that part have g₀ⱼ = g₀ᵢ: what is closed between them is no place of that kind, however
few points it has, and stresses show its border. A place is resolved where a share of its force is
carried within.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.delivery.balance import bolt_forces, Resultants
from orchestrator.method.delivery.faces import contact_faces, Face
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.loose import held_bodies
from orchestrator.method.delivery.moved import slides
from orchestrator.scene.model import Scene


# share of the force that has to be carried within: by a round place some three faces across, by a
# long one two
WITHIN = 0.1
# of the largest force between two bodies, below which a place has no say in the error
CARRIES = 0.01
ALIKE = 1e-9  # of the distance of two points, what rounding makes their first gaps differ by


def unresolved(scene: Scene, fields: InterfaceFields) -> dict[str, tuple[int, int]]:
    """Pairs of bodies whose place of contact is not resolved at some load step → how many points
    carry it at the first such step, from 1, and that step.
    """
    ends, shape = _beside(fields)
    names, number = np.unique([" | ".join(sorted(scene.subdomains[e].body for e in i.subdomains))
                               for i in scene.opening], return_inverse=True)
    pair = number[fields.interface_of_node]
    forces, sums = np.maximum(fields.pressure,
                              0.0) * fields.areas, np.zeros((3, fields.steps, len(names)))
    for t, force in enumerate(forces):
        border = (force[ends[0]] > 0) & (force[ends[1]]
                                         == 0) & (fields.areas[t, ends[1]] > 0) & (
                                             fields.gap[t, ends[1]] <= 2 * shape)
        within = force.copy()
        within[ends[0, border]] = 0.0
        sums[:, t] = [np.bincount(pair, values, len(names))
                      for values in (force, within, force > 0)]
    (whole, carried, count), found = sums, {}
    for t, k in np.argwhere((whole > CARRIES * whole.max(initial=0.0))
                            & (carried < WITHIN * whole)):
        found.setdefault(str(names[k]), (int(count[t, k]), int(t) + 1))
    return found


def _beside(fields: InterfaceFields) -> tuple[np.ndarray, np.ndarray]:
    """(2, e) int, points beside each other, either way; (e,) by how much more the second's sides
    are apart by shape, −1 for no more.
    """
    edges = np.unique(np.sort(fields.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
                      axis=0)
    ends = np.concatenate([edges, edges[:, ::-1]]).T
    (one, two), points = fields.initial_gap[ends], fields.points[0, ends]
    return ends, np.where(two - one > ALIKE * np.linalg.norm(points[1] - points[0], axis=1),
                          two - one, -1.0)


@dataclass(frozen=True)
class Met:
    """I interfaces, in the order of the scene, T load steps.

    names : (I,) theirs
    resultant : (I, T, 3) force of side 2 on side 1, without what prescribed nodes carry
    pressure : (I, T) the largest at a node
    work, dissipation : (I, T) since the unloaded state, see ``work``
    slid, amiss : (I,) as of ``slid.slides``
    within : (I,) int, the volume that has cells on both sides; −1: none has
    common : (I,) bool, whether the sides share their nodes
    counts : name of a status → (T,) nodes
    detached, weakly_held : names of bodies per load step, see ``loose``
    bolts, faces, unresolved : as of ``balance.bolt_forces``, ``faces``, ``resolution``
    """

    names: list[str]
    resultant: np.ndarray
    pressure: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray
    slid: np.ndarray
    amiss: np.ndarray
    within: np.ndarray
    common: np.ndarray
    counts: Mapping[str, Sequence[int]]
    detached: list[list[str]]
    weakly_held: list[list[str]]
    bolts: list[dict[str, object]]
    faces: list[Face]
    unresolved: Mapping[str, tuple[int, int]]

    @classmethod
    def of(cls, scene: Scene, fields: InterfaceFields | None, resultants: Resultants) -> Met | None:
        """Return all of a scene's; None where all interfaces are perfect.

        fields : of the interfaces that are not
        """
        if fields is None:
            return None
        opening = scene.opening
        taken, lost = work(fields, np.array([i.has_history for i in opening], dtype=bool))
        return cls([i.name for i in opening], fields.resultant.swapaxes(0, 1),
                   np.maximum.reduceat(fields.pressure, fields.offsets[:-1], axis=1).T,
                   taken.T, lost.T, *slides(scene, fields),
                   np.array([_within(scene.mesh.volume[i.cells]) for i in opening], dtype=int),
                   np.array([np.array_equal(fields.nodes[at], fields.others[at])
                             for _, at in fields.each()], dtype=bool),
                   fields.counts, *held_bodies(scene, fields),
                   bolt_forces(scene, fields, resultants), contact_faces(scene, fields),
                   unresolved(scene, fields))

    @property
    def slides(self) -> dict[str, float]:
        """Interface → how far its sides have slid, in elements, where they hold; of those whose
        pairs stay as they are.
        """
        return {name: far for name, far in zip(self.names, self.slid.tolist()) if far == far}


def _within(sides: np.ndarray) -> int:
    """The volume that is on both of the sides (k, 2) int of a face; −1: none is."""
    same = sides[sides[:, 0] == sides[:, 1], 0]
    return int(same[0]) if len(same) else -1


def work(interfaces: InterfaceFields, rubs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, I) W and D of the interfaces that are not perfect; ``rubs``: (I,) bool, whether what acts
    along the interface is friction.
    """
    i = interfaces
    push, opening = i.pressure * i.areas, i.gap - i.initial_gap
    drag = i.friction_traction * i.areas[:, :, None]
    before = [np.concatenate([np.zeros_like(x[:1]), x[:-1]]) for x in (push, opening, drag, i.slip)]
    there = i.areas > 0
    there[1:] &= there[:-1]
    moved, slid = np.where(there, opening - before[1], 0.0), i.slip - before[3]
    taken = -0.5 * (push + before[0]) * moved + 0.5 * np.einsum(
        "tni,tni->tn", drag + before[2], slid)
    lost = np.einsum("tni,tni->tn", drag, slid)
    each = [np.add.reduceat(x, i.offsets[:-1], axis=1).cumsum(axis=0) for x in (taken, lost)]
    return each[0], each[1] * rubs
