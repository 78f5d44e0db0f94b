"""All interfaces that are not perfect, as rank 0 tells of them: a row for each, and what nodes add up to, which stay with their ranks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.delivery.balance import Resultants, bolt_forces
from orchestrator.method.delivery.faces import Face, contact_faces
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.loose import held_bodies
from orchestrator.method.delivery.resolution import unresolved
from orchestrator.method.delivery.slid import slides
from orchestrator.parallel.team import Team
from orchestrator.scene.model import Scene


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
    def of(cls, scene: Scene, own: InterfaceFields | None, resultants: Resultants, team: Team) -> Met | None:
        """On rank 0; None elsewhere, and where all interfaces are perfect. All ranks ask together.

        own : fields of the interfaces whose first side is this rank's, with its part's numbers of nodes
        """
        if own is None:
            return None
        told = team.gather((own.index, _rows(scene, own), own.counts))
        of_all = *held_bodies(scene, own, team), bolt_forces(scene, own, resultants, team), contact_faces(scene, own, team), unresolved(
            scene, own, team)
        if told is None:
            return None
        order = np.argsort(np.concatenate([index for index, *_ in told]))
        rows = {name: np.concatenate([each[name] for _, each, _ in told])[order] for name in told[0][1]}
        counts = {name: np.sum([each[name] for *_, each in told], axis=0).tolist() for name in told[0][2]}
        return cls([i.name for i in scene.opening], *rows.values(), counts, *of_all)

    @property
    def slides(self) -> dict[str, float]:
        """Interface → how far its sides have slid, in elements, where they hold; of those whose pairs stay as they are."""
        return {name: far for name, far in zip(self.names, self.slid.tolist()) if far == far}


def _rows(scene: Scene, own: InterfaceFields) -> dict[str, np.ndarray]:
    """Of each interface of a rank, as of ``Met``."""
    opening = scene.opening
    interfaces = [opening[k] for k in own.index]
    taken, lost = work(own, np.array([i.law.has_history for i in interfaces], dtype=bool))
    far, amiss = slides(scene, own, interfaces)
    return {"resultant": own.resultant.swapaxes(0, 1), "pressure": np.maximum.reduceat(own.pressure, own.offsets[:-1], axis=1).T,
            "work": taken.T, "dissipation": lost.T, "slid": far, "amiss": amiss,
            "within": np.array([_within(scene.mesh.volume[i.cells]) for i in interfaces], dtype=int),
            "common": np.array([np.array_equal(own.nodes[at], own.others[at]) for _, at in own.each()], dtype=bool)}


def _within(sides: np.ndarray) -> int:
    """The volume that is on both of the sides (k, 2) int of a face; −1: none is."""
    same = sides[sides[:, 0] == sides[:, 1], 0]
    return int(same[0]) if len(same) else -1


def work(interfaces: InterfaceFields, rubs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, I) W and D of the interfaces that are not perfect; ``rubs``: (I,) bool, whether what acts along the interface is friction."""
    i = interfaces
    push, opening = i.pressure * i.areas, i.gap - i.initial_gap
    drag = i.friction_traction * i.areas[:, :, None]
    before = [np.concatenate([np.zeros_like(x[:1]), x[:-1]]) for x in (push, opening, drag, i.slip)]
    there = i.areas > 0
    there[1:] &= there[:-1]
    moved, slid = np.where(there, opening - before[1], 0.0), i.slip - before[3]
    taken = -0.5 * (push + before[0]) * moved + 0.5 * np.einsum("tni,tni->tn", drag + before[2], slid)
    lost = np.einsum("tni,tni->tn", drag, slid)
    each = [np.add.reduceat(x, i.offsets[:-1], axis=1).cumsum(axis=0) for x in (taken, lost)]
    return each[0], each[1] * rubs
