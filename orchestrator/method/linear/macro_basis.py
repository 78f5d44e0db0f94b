"""Macro basis W: the few displacement fields per interface that the macro problem handles.

After Saint-Venant's principle, the force distributions orthogonal to the rigid motions and the
mean strains of an interface fade within its own size (paper, section 4.1.1, figure 4).
"""

from __future__ import annotations

import numpy as np

DROP = 1e-8  # singular values below this fraction of the largest are dependent fields


def interface_basis(points: np.ndarray, free: np.ndarray, kind: str) -> np.ndarray:
    """Orthonormal macro basis of one interface.

    Parameters
    ----------
    points : (n, 3) float, nodes of the interface
    free : (n, 3) bool, components that are not prescribed; the others leave the basis
    kind : ``translations`` (3 fields), ``rigid`` (6), ``affine`` (12: rotations, extensions and
        shears included; 9 remain on a plane) or ``quadratic`` (30; 18 on a plane)

    Returns
    -------
    (d, m) float, d free dofs, m ≤ number of fields: what is dependent has been dropped
    """
    centred = points - points.mean(axis=0)
    x, y, z = (centred / max(np.abs(centred).max(), np.finfo(float).tiny)).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    if kind == "rigid":
        spins = [np.stack(f, 1) for f in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
        fields = [one[:, None] * e for e in np.eye(3)] + spins
    else:
        monomials = {
            "translations": [one],
            "affine": [one, x, y, z],
            "quadratic": [one, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x],
        }[kind]
        fields = [m[:, None] * e for m in monomials for e in np.eye(3)]
    basis = np.stack(fields, axis=-1)[free]
    if not basis.size:
        return np.zeros((basis.shape[0], 0))
    left, singular, _ = np.linalg.svd(basis, full_matrices=False)
    return left[:, singular > DROP * singular[0]]
