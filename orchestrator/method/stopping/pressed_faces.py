"""Faces between bodies that touch without friction: tractions that a stress in balance may have there.

Nothing but a pressure p ≥ 0, linear on every face and the same on both sides, on faces that displacements v have closed; nothing on others.
With gaps g(v) ≥ 0 the error's square has 2 ∫ p g(v) beside its other terms, as in ``certificate``. Where the nearest stress would
pull, its traction is cut off at zero, and what is left of the stress found again.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.stopping.equilibrated import Balanced, Equilibration
from orchestrator.method.stopping.stress_element import FACES
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene

CLOSED = 1e-6  # of the largest displacement, a gap that counts as none; what p does in it is in the error
INSIDE = 1e-11  # of the same, what rounding leaves of sides inside each other
PULLS = 1e-12  # of the largest pressure, the same of sides that pull
PARALLEL = 1e-9  # of an area, how far the two sides of a face may turn away from each other


def alike(scene: Scene, interface: Interface) -> bool:
    """Whether the faces on both sides of an interface are the same, but for where they are."""
    one, two = _sides(scene, interface)
    return bool((np.abs(one - two).max(axis=1, initial=0.0) <= PARALLEL * np.linalg.norm(one, axis=1)).all())


def flat(scene: Scene, interface: Interface) -> bool:
    """Whether an interface is a plane, and its normals that plane's."""
    one, _ = _sides(scene, interface)
    if not len(one):
        return True
    normal = one.sum(axis=0) / np.linalg.norm(one.sum(axis=0))
    turned = [one / np.linalg.norm(one, axis=1, keepdims=True) - normal]
    if interface.normals is not None:
        turned.append(interface.normals - normal)
    if interface.given is not None:
        turned.append(np.nan_to_num(np.abs(interface.given @ normal) - 1))
    return all(np.abs(x).max(initial=0.0) <= PARALLEL for x in turned)


def _sides(scene: Scene, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """(k, 3) area vectors of the faces on both sides, from side 1 to side 2."""
    one, two = (area_vectors(scene.side_points(interface, side), interface.triangles) for side in (0, 1))
    return one, two


class PressedFaces:
    """The faces of one scene.

    joined : (n,) int, nodes' labels, equal where bonds make them one
    places : of an interface, its faces in ``balance`` and which of its triangles' corners theirs are

    faces : (k,) int, all faces between bodies that are not bonded, whatever is between them
    """

    def __init__(self, scene: Scene, balance: Equilibration, joined: np.ndarray, places: dict[int, tuple[np.ndarray, np.ndarray]]):
        """joined : (m, 4) labels of the cells' corners, as ``balance.turn`` has them."""
        self.scene, self.balance, self.places = scene, balance, places
        corners = joined[:, FACES].reshape(-1, 3)
        inner = np.flatnonzero(~balance.outer)
        between = np.zeros(len(balance.outer), dtype=bool)
        between[inner] = (corners[balance.halves[inner, 0]] != corners[balance.halves[inner, 1]]).any(axis=1)
        for face, _ in places.values():  # a rim may be bonded all round
            between[face] = True
        self.faces = np.flatnonzero(between)
        normals = balance.normals.reshape(-1, 3)[balance.halves[self.faces, 0]]
        self.areas = np.linalg.norm(normals, axis=1)
        self.at = np.full(len(balance.outer), -1)
        self.at[self.faces] = np.arange(len(self.faces))
        axes = np.linalg.svd(normals[:, None])[2]  # the first row along the normal, of either sign
        axes[:, 0] = normals / self.areas[:, None]
        if len(self.faces):
            balance.turn_to(self.faces, axes)

    def gaps(self, displacement: np.ndarray, step: int) -> np.ndarray:
        """(k, 3) g(v) at the faces' corners, infinite where there is no contact; displacement (n, 3) of all subdomains' nodes."""
        result, offsets = np.full((len(self.faces), 3), np.inf), np.cumsum([0, *(len(s.nodes) for s in self.scene.subdomains)])
        for index, (face, corner) in self.places.items():
            i = self.scene.interfaces[index]
            normal = area_vectors(self.scene.side_points(i, 0), i.triangles)
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            one, two = (displacement[offsets[e] + nodes] for e, nodes in zip(i.subdomains, i.nodes))
            gap = i.distances(self.scene.steps)[step][i.triangles] + np.einsum("kc,kpc->kp", normal, (two - one)[i.triangles])
            result[self.at[face]] = np.take_along_axis(gap, corner, 1)
        return result

    def pulling(self, found: Balanced, closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) bool, closed faces that are pulled, and (k, 3) moments of pressures, those of pulled ones cut off."""
        moments = -found.faces[self.faces, :, 0]
        pressure = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / self.areas[:, None]
        pulled = closed & (pressure.min(axis=1, initial=0.0) < -PULLS * np.abs(pressure).max(initial=0.0))
        positive = np.maximum(pressure, 0.0)
        cut = (positive + positive.sum(axis=1, keepdims=True)) * self.areas[:, None] / 12
        return pulled, np.where(pulled[:, None], cut, moments)
