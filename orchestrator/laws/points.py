"""The node pairs a law works on, and what it answers.

Vectors are rows of components, (3, P): numpy is several times faster along long rows than across short ones.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Points:
    """Node pairs that share a law. n points from side 1 to side 2.

    Parameters
    ----------
    normal : (3, P) unit normals
    stiff_n, stiff_t : (P,) keq = k₁k₂/(k₁ + k₂) of the search direction, along n and across it
    area : (P,) share of the interface's area
    own : name → (…, P), the law's parameters
    """

    normal: np.ndarray
    stiff_n: np.ndarray
    stiff_t: np.ndarray
    area: np.ndarray
    own: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.area)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.own[name]

    def some(self, part: slice | np.ndarray) -> Points:
        """Some of the points."""
        return Points(np.ascontiguousarray(self.normal[:, part]), self.stiff_n[part], self.stiff_t[part], self.area[part],
                      {name: values[..., part] for name, values in self.own.items()})

    @property
    def search(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normals and stiffness along and across them, as loops take them."""
        return self.normal, self.stiff_n, self.stiff_t

    def along(self, x: np.ndarray) -> np.ndarray:
        """(…, P) normal components of (…, 3, P)."""
        return dot(x, self.normal)

    def across(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) tangential parts."""
        return x - self.along(x)[..., None, :] * self.normal

    def stiffness(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) keq x."""
        return self.stiff_t * x + ((self.stiff_n - self.stiff_t) * self.along(x))[..., None, :] * self.normal

    def compliance(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) x / keq."""
        return x / self.stiff_t + ((1 / self.stiff_n - 1 / self.stiff_t) * self.along(x))[..., None, :] * self.normal


@dataclass
class Answer:
    """What a law says.

    Parameters
    ----------
    force : (3, P) f̂ on side 1
    status : (P,) int, one of the law's statuses
    active : (Q,) pairs whose force changes with F, only if the derivative is asked for
    derivative : (3, 3, Q) ∂f̂/∂F at these
    """

    force: np.ndarray
    status: np.ndarray
    active: np.ndarray | None = None
    derivative: np.ndarray | None = None


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(…, P) products of vectors (…, 3, P)."""
    return a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :]
