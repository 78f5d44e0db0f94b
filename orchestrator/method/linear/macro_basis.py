"""Macro basis W: the few displacement fields per interface that the macro problem handles.

After Saint-Venant's principle, the force distributions orthogonal to the rigid motions and the
mean strains of an interface fade within its own size (paper, section 4.1.1, figure 4).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.scene.interfaces.mortar.operators import Mortar

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
    return independent(macro_fields(points, kind)[free])


def macro_fields(points: np.ndarray, kind: str) -> np.ndarray:
    """(n, 3, m) the fields at points (n, 3), parameters as of ``interface_basis``."""
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
    return np.stack(fields, axis=-1)


def independent(basis: np.ndarray) -> np.ndarray:
    """(d, m') orthonormal columns that span those of (d, m)."""
    if not basis.size:
        return np.zeros((basis.shape[0], 0))
    left, singular, _ = np.linalg.svd(basis, full_matrices=False)
    return left[:, singular > DROP * singular[0]]


def jump_free_basis(mortar: Mortar, points: tuple[np.ndarray, np.ndarray], free: np.ndarray, kind: str) -> np.ndarray:
    """Orthonormal macro basis of an interface whose nodes do not match: both sides together, without any jump.

    The fields are those of ``interface_basis`` on the master and on slave nodes that are no points; points follow, so that
    G₁ W₁ = G₂ W₂ also beside what is prescribed. Fields that are cut there on each side by themselves open the interface
    a little, and the iterations never get beyond that.

    Parameters
    ----------
    points : (n₁, 3), (n₂, 3) nodes of either side; free : (n₁, 3) bool, of the slave
    kind : as there

    Returns
    -------
    (3 n₁ + 3 n₂, m) float
    """
    fields, slave = macro_fields(np.vstack(points), kind), 3 * len(points[0])
    everything = np.concatenate([free.ravel(), mortar.free.ravel()])
    fields = np.where(everything[:, None], fields.reshape(len(everything), -1), 0.0)
    fields[mortar.dofs] = 0.0
    jump = mortar.second @ fields[slave:] - mortar.first @ fields[:slave]
    fields[mortar.dofs] = jump / mortar.own.diagonal()[:, None] if mortar.diagonal else \
        sla.splu(sp.csc_array(mortar.own)).solve(jump)
    return independent(fields)
