"""Rows of the transfer operators of one interface, on the trace dofs of all."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar

# Forces of points are read from mass matrices that condition well: their solutions' far entries fade below this.
FADED = 1e-14


def picks(dofs: np.ndarray, size: int) -> sp.csr_array:
    return sp.csr_array((np.ones(len(dofs)), dofs, np.arange(len(dofs) + 1)), shape=(len(dofs), size))


def _placed(G: sp.csr_array, dofs: np.ndarray, size: int) -> sp.csr_array:
    """An operator on a side's components, on its trace dofs."""
    G = sp.csr_array(G)
    return sp.csr_array((G.data, dofs[G.indices], G.indptr), shape=(G.shape[0], size))


def of_mortar(mortar: Mortar, one: np.ndarray, two: np.ndarray, size: int) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """Rows of G₁, G₂ and E."""
    return _placed(mortar.first, one, size), _placed(mortar.second, two, size), _placed(_reads(mortar), one, size)


def _reads(mortar: Mortar) -> sp.csr_array:
    """(3p, 3n₁) sparse: own⁻ᵀ hatsᵀ; empty rows where a point carries nothing now."""
    own = mortar.own
    if mortar.diagonal:
        share = own.diagonal()
        return sp.csr_array(sp.diags_array(np.divide(1, share, out=np.zeros_like(share), where=share > 0)) @ mortar.hats.T)
    inverse = np.linalg.inv(own[::3, ::3].toarray()).T  # the same for every component
    inverse[np.abs(inverse) < FADED * np.abs(inverse).max()] = 0.0
    return sp.csr_array(sp.kron(inverse, sp.eye_array(3), format="csr") @ mortar.hats.T)
