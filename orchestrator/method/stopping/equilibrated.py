"""Stress fields in balance with body forces and tractions, everywhere, and near to a given stress that is not.

Every tet is a stress element (``stress_element``), so that a stress is its tractions t on all faces, linear on each, and nine numbers x
each: moments with the linear functions. It is in balance where forces and moments of every tet are:

    R x + r = 0, six equations a tet,      R W⁻¹ Rᵀ y = R x₀ + r,      x = x₀ − W⁻¹ Rᵀ y

brings tractions x₀ into balance, with what each costs about, W. From there conjugate gradients, projected in the same way, lower the
complementary energy ‖σ − σ_h‖² of the distance from the given stress; every iterate is in balance.

Meshes too large for one factor of R W⁻¹Rᵀ are divided. Tractions between parts are made to balance these first, and then within each;
the energy is lowered within the parts of one division, and then of others that are cut elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import semidefinite_solver
from orchestrator.method.stopping.stress_element import FACES, TENSOR, StressElements
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import skew

LARGEST = 10_000  # tets of a part: from there work and memory grow no faster than the mesh
DIVISIONS = 3
GAIN = 0.005  # of the energy, below which another iteration is not worth while
MOST = 60  # iterations
REFINEMENTS = 4


@dataclass(frozen=True)
class Balanced:
    """A stress σ in balance.

    energies : (m,) ‖σ − σ_h‖² of every tet, with C⁻¹
    unbalanced : what is left of forces and moments of a tet, over the largest force on a face
    moments : (m, 4, 3, 3) of its tractions, see ``StressElements``; faces : (f, 3, 3) the same of faces, along their axes
    """

    energies: np.ndarray
    unbalanced: float
    moments: np.ndarray
    faces: np.ndarray


class Equilibration:
    """Stress fields on one mesh.

    points : (n, 3); cells : (m, 4) int; labels : (n,) int, equal where nodes are one
    lame : (m, 2)
    gradients, volumes : of the cells' linear functions

    turn : (m, 4) int, the corners of every cell in the order of their labels
    face : (m, 4) int, the face opposite to each of these; halves : (f, 2) int, where a face is among them, −1 where nothing is behind it
    """

    def __init__(self, points: np.ndarray, cells: np.ndarray, labels: np.ndarray, lame: np.ndarray, gradients: np.ndarray,
                 volumes: np.ndarray):
        self.turn = np.argsort(labels[cells], axis=1, kind="stable")
        cells = np.take_along_axis(cells, self.turn, 1)
        gradients, volumes = np.take_along_axis(gradients, self.turn[:, :, None], 1), np.abs(volumes)
        self.elements = StressElements(gradients, volumes, lame)
        corners = labels[cells][:, FACES].reshape(-1, 3)
        _, first, face = np.unique(corners, axis=0, return_index=True, return_inverse=True)
        self.face, self.halves = face.reshape(-1, 4), np.stack([first, np.full(len(first), -1)], axis=1)
        others = np.flatnonzero(first[face.ravel()] != np.arange(face.size))
        self.halves[face.ravel()[others], 1] = others
        self.outer = self.halves[:, 1] < 0
        self.sign = np.where(first[self.face] == np.arange(face.size).reshape(-1, 4), 1.0, -1.0)
        self.axes: np.ndarray | None = None
        self.normals = -3 * volumes[:, None, None] * gradients  # as long as the face's area
        self.weight = self._onto(self.elements.weights())
        self.points = points[cells]
        self.centre, self.length = self.points.mean(axis=1), np.cbrt(volumes)
        self.volumes, self.forces = volumes, self._forces()

    def turn_to(self, faces: np.ndarray, axes: np.ndarray) -> None:
        """Have tractions on some faces (k,) told along axes (k, 3, 3) of their own, a row each; the others' are x, y and z."""
        self.axes = np.tile(np.eye(3), (len(self.outer), 1, 1))
        self.axes[faces] = axes
        blocks = np.repeat(self.axes.swapaxes(1, 2), 3, axis=0)
        self.forces = sp.csr_array(self.forces @ sp.bsr_array((blocks, np.arange(len(blocks)), np.arange(len(blocks) + 1))))

    def __call__(self, sigma: np.ndarray, body_force: np.ndarray | None, known: np.ndarray, given: np.ndarray) -> Balanced:
        """The stress in balance.

        sigma : (m, 4, 6) stress σ_h that it is to be near to, at the corners of the cells as ``turn`` has them, linear between
        body_force : (m, 3) in each cell, None where there is none
        known : (f, 3) bool, components of tractions on faces that are given; given : (f, 3, 3) moments of these
        """
        corners = (sigma[..., TENSOR][:, FACES] @ self.normals[:, :, None, :, None])[..., 0]
        moments = (corners + corners.sum(axis=2, keepdims=True)) / 12  # of the tractions of the given stress
        x = np.where(known[:, None], given, self._sum(moments) / self._onto(np.ones_like(self.sign))[:, None, None])
        loads = np.zeros((len(sigma), 6))
        if body_force is not None:
            loads[:, :3] = self.volumes[:, None] * body_force
        inverse = np.where(known, 0.0, 1 / self.weight[:, None])
        for number, part in enumerate(self._divisions()):
            if number == 0:
                x = self._between(x, loads, part, inverse)
            cut = np.zeros(len(self.outer), dtype=bool)
            cut[self.face[part[self._beside] != part[:, None]]] = True
            within = _Within(self.forces, np.where(cut[:, None], 0.0, inverse))
            if number == 0:
                x = within.balanced(x, loads.ravel())
            x = within.balanced(self._lowered(x, sigma, within), loads.ravel())
        left = np.abs(self.forces @ x.ravel() + loads.ravel()).max() / max(np.abs(x).max(), np.finfo(float).tiny)
        moments = self._of_cells(x)
        return Balanced(self.elements.products(moments, sigma)[1], float(left), moments, x)

    def _lowered(self, x: np.ndarray, sigma: np.ndarray, within: _Within) -> np.ndarray:
        """Tractions x with less energy, in as good a balance."""
        slope, energies = self.elements.products(self._of_cells(x), sigma)
        energy, towards, before = energies.sum(), None, 0.0
        for _ in range(MOST):
            left = self._sum(slope)
            step = within.projected(left)
            size = np.vdot(left, step)
            if size <= 0:
                break
            towards = step if towards is None else step + size / before * towards
            product, curved = self.elements.products(self._of_cells(towards))
            far, before = size / curved.sum(), size
            x, slope = x - far * towards, slope - far * product
            energy -= far * size
            if far * size <= GAIN * energy:
                break
        return x

    def _between(self, x: np.ndarray, loads: np.ndarray, part: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Tractions that balance every part as a whole."""
        count = int(part.max()) + 1
        if count == 1:
            return x
        centre = np.stack([np.bincount(part, c) for c in self.centre.T], axis=1) / np.bincount(part)[:, None]
        size = np.cbrt(np.bincount(part, self.volumes))
        moved = np.tile(np.eye(6), (len(part), 1, 1))  # of a cell's six to those of its part
        arm = skew(self.centre - centre[part])
        moved[:, 3:, :3], moved[:, 3:, 3:] = arm, self.length[:, None, None] * np.eye(3)
        moved[:, 3:] /= size[part][:, None, None]
        row = np.repeat(6 * part[:, None] + np.arange(6), 6, axis=1).ravel()
        column = np.tile(np.arange(6 * len(part)).reshape(-1, 6), (1, 6)).ravel()
        whole = sp.csr_array((moved.ravel(), (row, column)), shape=(6 * count, 6 * len(part)))
        return _Within(sp.csr_array(whole @ self.forces), inverse).balanced(x, whole @ loads.ravel())

    def _divisions(self) -> Iterator[np.ndarray]:
        """(m,) int, the part of every cell, division after division; parts hang together by faces."""
        count = -(-len(self.face) // LARGEST)
        for number in range(DIVISIONS if count > 1 else 1):
            coordinates = self.centre @ np.linalg.qr(_TURNS[number])[0]
            bisected, beside = _bisected(coordinates, count), self._beside
            inner = (beside != np.arange(len(bisected))[:, None]) & (bisected[beside] == bisected[:, None])
            cell = np.broadcast_to(np.arange(len(bisected))[:, None], inner.shape)
            yield components(cell[inner], beside[inner], len(bisected))[1]

    @cached_property
    def _beside(self) -> np.ndarray:
        """(m, 4) int, the cell behind every face, the own one where there is none."""
        own = np.arange(self.face.size).reshape(-1, 4)
        both = self.halves[self.face]
        other = np.where(both[..., 0] == own, both[..., 1], both[..., 0])
        return np.where(other < 0, own, other) // 4

    def _forces(self) -> sp.csr_array:
        """(6 m, 9 f) R: forces on every cell, and moments about its centre over its length."""
        count, corner = len(self.face), np.arange(3)
        turned = skew(self.points[:, FACES] - self.centre[:, None, None]) / self.length[:, None, None, None, None]
        values = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=3) * self.sign[:, :, None, None, None]
        row = np.broadcast_to(6 * np.arange(count)[:, None, None, None, None] + np.arange(6)[:, None], values.shape)
        column = np.broadcast_to((9 * self.face[:, :, None] + 3 * corner)[:, :, :, None, None] + corner, values.shape)
        there = values != 0
        return sp.csr_array((values[there], (row[there], column[there])), shape=(6 * count, 9 * len(self.outer)))

    def _of_cells(self, x: np.ndarray) -> np.ndarray:
        """(m, 4, 3, 3) tractions of the cells from those of faces (f, 3, 3)."""
        x = x if self.axes is None else x @ self.axes
        return self.sign[:, :, None, None] * x[self.face]

    def _sum(self, moments: np.ndarray) -> np.ndarray:
        """(f, 3, 3) the transpose of that."""
        signed = (self.sign[:, :, None, None] * moments).reshape(-1, 9)
        result = np.stack([np.bincount(self.face.ravel(), one, len(self.outer)) for one in signed.T], axis=1).reshape(-1, 3, 3)
        return result if self.axes is None else result @ self.axes.swapaxes(1, 2)

    def _onto(self, values: np.ndarray) -> np.ndarray:
        """(f,) sums of (m, 4)."""
        return np.bincount(self.face.ravel(), values.ravel(), len(self.outer))


class _Within:
    """Projection onto tractions in balance, in the norm of W.

    forces : R or sums of its rows; inverse : (f, 3) diagonal of W⁻¹, zero where a traction stays
    """

    def __init__(self, forces: sp.csr_array, inverse: np.ndarray):
        self.forces, self.inverse = forces, np.repeat(inverse[:, None], 3, axis=1)
        self.solve: Callable = semidefinite_solver(forces @ sp.diags_array(self.inverse.ravel()) @ forces.T)

    def projected(self, left: np.ndarray) -> np.ndarray:
        """W⁻¹ of forces (f, 3, 3) but for what unbalances."""
        pushed = self.solve((self.forces @ (self.inverse * left).ravel())[None])[0]
        return self.inverse * (left - (self.forces.T @ pushed).reshape(left.shape))

    def balanced(self, x: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Tractions nearest to x that balance loads."""
        for _ in range(REFINEMENTS):
            pushed = self.solve((self.forces @ x.ravel() + loads)[None])[0]
            x = x - self.inverse * (self.forces.T @ pushed).reshape(x.shape)
        return x


# three frames across each other, from fixed rows made orthogonal
_TURNS = (np.eye(3), np.array([[1.0, 1, 0], [-1, 1, 1], [1, -1, 2]]), np.array([[1.0, -2, 1], [2, 1, 1], [-1, 1, 3]]))


def _bisected(points: np.ndarray, count: int) -> np.ndarray:
    """(n,) int, parts of points (n, 3) of about equal numbers, by halving across the longest direction again and again."""
    part = np.zeros(len(points), dtype=int)
    todo = [(np.arange(len(points)), count, 0)]
    while todo:
        own, pieces, first = todo.pop()
        part[own] = first
        if pieces > 1:
            axis = np.ptp(points[own], axis=0).argmax()
            order, half = own[np.argsort(points[own, axis], kind="stable")], pieces // 2
            at = len(own) * half // pieces
            todo += [(order[:at], half, first), (order[at:], pieces - half, first + half)]
    return part
