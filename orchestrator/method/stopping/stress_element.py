"""Stresses in a tet whose tractions are linear on its faces: the element of Johnson and Mercier.

Lines from its centroid divide a tet into four, one behind each face. Stresses that are symmetric, linear in each of the four, and whose
tractions are continuous between these, have 42 unknowns: nine of the traction on every face, and the mean stress. Their divergence is
constant in each of the four and, against linear displacements v of the whole tet, what the traction t and the mean stress say of it,

    ∫ div σ · v = ∫_∂ t · v − ∫ σ : ε(v),

which determines it. So where tractions balance a constant body force b, and the mean stress is theirs, div σ + b = 0 holds everywhere.

C. Johnson, B. Mercier, Some equilibrium finite element methods for two-dimensional elasticity problems, Numer. Math. 30, 1978, 103–116;
M. Křížek, An equilibrium finite element method in three-dimensional elasticity, Aplikace matematiky 27, 1982, 46–75.
"""

from __future__ import annotations

import numpy as np

FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # corners of the face opposite to each corner
TENSOR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # which of a stress's six components stand where in the tensor
ROW, COLUMN = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])
CHUNK = 4_000  # tets at once: some 6 kB each


def _reference() -> np.ndarray:
    """(96, 36) stresses of the unit tet, at the corners of its four, from moments ∫ t λ of tractions at the corners of its faces."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    points, parts = np.vstack([corners, corners.mean(axis=0)]), np.hstack([FACES, np.full((4, 1), 4)])
    stress, moment = np.arange(96).reshape(4, 4, 6), np.eye(36).reshape(4, 3, 3, 36)
    rows, given = [], []

    def traction(part: int, corner: int, normal: np.ndarray) -> np.ndarray:
        row = np.zeros((3, 96))
        row[np.arange(3)[:, None], stress[part, corner][TENSOR]] = normal
        return row

    for one in range(4):
        for other in range(one):
            shared = [p for p in parts[one] if p in parts[other]]
            a, b, c = points[shared]
            for p in shared:
                sides = (traction(part, int(np.argmax(parts[part] == p)), np.cross(b - a, c - a)) for part in (one, other))
                rows.append(next(sides) - next(sides))
                given.append(np.zeros((3, 36)))
    mean = np.zeros((6, 36))
    for face in range(4):
        a, b, c = corners[FACES[face]]
        area = np.cross(b - a, c - a) / 2
        area *= np.sign(area @ (a - corners[face]))
        for k in range(3):  # linear functions and their moments: the mass matrix of a triangle, inverted
            rows.append(traction(face, k, area))
            given.append(12 * moment[face, k] - 3 * moment[face].sum(axis=0))
            arm = corners[FACES[face, k]] - points[4]
            mean += 3 * (arm[COLUMN, None] * moment[face, k][ROW] + arm[ROW, None] * moment[face, k][COLUMN])  # over a volume of 1/6
    rows.append(np.tile(np.eye(6), 16) / 16)
    given.append(mean)
    return np.linalg.solve(np.vstack(rows), np.vstack(given))


def _traces(stresses: np.ndarray) -> np.ndarray:
    """(4, 6·6, 3·3) Σ over the corners of a face of means of products of stresses' components, of moments in two directions there."""
    own = stresses.reshape(4, 4, 6, 4, 3, 3)
    both = own + own.sum(axis=1, keepdims=True)
    return np.einsum("pkafcx,pkbfcy->fabxy", own, both / 80, optimize=True).reshape(4, 36, 9)


_STRESSES = _reference()
_TRACES = _traces(_STRESSES)


class StressElements:
    """The stresses of m tets from moments of their tractions, (m, 4, 3, 3): of every face, its corners as in ``FACES``, and component.

    gradients : (m, 4, 3) of the linear functions; volumes : (m,); lame : (m, 2)
    """

    def __init__(self, gradients: np.ndarray, volumes: np.ndarray, lame: np.ndarray):
        self.slopes, self.volumes = gradients[:, 1:], volumes
        edges = np.linalg.inv(self.slopes)  # (m, 3, 3), columns from the first corner to the others
        self.along = edges / np.sqrt(6 * volumes)[:, None, None]  # a stress s of the unit tet becomes a sᵀa
        metric, (first, second) = self.along.swapaxes(1, 2) @ self.along, lame.T
        self.compliance = _compliance(metric, first / (3 * first + 2 * second)) * (volumes / (2 * second))[:, None, None]

    def weights(self) -> np.ndarray:
        """(m, 4) sums of the energies of a face's nine unit moments."""
        metric = self.slopes @ self.slopes.swapaxes(1, 2)
        return np.einsum("ma,fab,mb->mf", self.compliance.reshape(-1, 36), _TRACES, metric.reshape(-1, 9), optimize=True)

    def stresses(self, moments: np.ndarray) -> np.ndarray:
        """(m, 4, 4, 6) at the corners of the four parts of every tet, behind face after face; the centroid is the last of the corners."""
        turned = np.einsum("mia,mpkab,mjb->mpkij", self.along, self._unit(slice(None), moments)[..., TENSOR], self.along)
        return turned[..., ROW, COLUMN]

    def products(self, moments: np.ndarray, near: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Half the slope of ∫ (σ − s) : C⁻¹ (σ − s) in the moments, as these, and (m,) the integrals.

        near : (m, 4, 6) s at the corners of the tets, linear between; None: there is none
        """
        result, energies = np.empty_like(moments), np.empty(len(moments))
        for start in range(0, len(moments), CHUNK):
            part = slice(start, start + CHUNK)
            unit = self._unit(part, moments[part])
            if near is not None:
                unit -= self._given(part, near[part])
            forced = ((unit + unit.sum(axis=2, keepdims=True)) / 80).reshape(-1, 16, 6) @ self.compliance[part]  # means of products
            energies[part] = np.einsum("mpa,mpa->m", unit.reshape(-1, 16, 6), forced)
            back = (forced.reshape(-1, 96) @ _STRESSES).reshape(-1, 12, 3)
            result[part] = (back @ self.slopes[part]).reshape(-1, 4, 3, 3)
        return result, energies

    def _given(self, part: slice, near: np.ndarray) -> np.ndarray:
        """(m, 4, 4, 6) of the unit tet, from stresses (m, 4, 6) at corners."""
        back = self.slopes[part] * np.sqrt(6 * self.volumes[part])[:, None, None]
        unit = (back[:, None] @ near[..., TENSOR] @ back[:, None].swapaxes(2, 3))[..., ROW, COLUMN]
        centre = np.broadcast_to(unit.mean(axis=1)[:, None, None], (len(unit), 4, 1, 6))
        return np.concatenate([unit[:, FACES], centre], axis=2)

    def _unit(self, part: slice, moments: np.ndarray) -> np.ndarray:
        """(m, 4, 4, 6) stresses of the unit tet."""
        turned = moments.reshape(-1, 12, 3) @ self.slopes[part].swapaxes(1, 2)
        return (turned.reshape(-1, 36) @ _STRESSES.T).reshape(-1, 4, 4, 6)


def _compliance(metric: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(m, 6, 6) of 2μ σ : C⁻¹σ = tr σσ − share (tr σ)² for stresses of the unit tet."""
    units = np.zeros((6, 3, 3))
    units[np.arange(6), ROW, COLUMN] = units[np.arange(6), COLUMN, ROW] = 1.0
    turned = metric[:, None] @ units
    traces = np.einsum("mxx->m", turned.reshape(-1, 3, 3)).reshape(-1, 6)
    return np.einsum("maij,mbji->mab", turned, turned) - share[:, None, None] * traces[:, :, None] * traces[:, None]
