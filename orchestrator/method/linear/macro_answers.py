"""What the macro problem's columns tell of the answers of subdomains without soles, for no back-substitution.

With S the Schur complement of a subdomain and k its soles, (S + k) V = NᵀG holds for its columns of V: S V = NᵀG − k V is
known. Of all that its own columns span,

    x = V (VᵀS V)⁻¹ Vᵀh

is nearest to S⁺h in the energy norm. Here every subdomain takes its columns by itself, whatever its neighbours do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator.method.linear.macro_blocks import Blocks

# Of the largest entry of VᵀS V, added to its diagonal: rigid motions cost nothing. Forces are in balance to 1e-7, so that what these
# do in them is next to nothing; and columns softer than that are left to whoever goes on from here.
LEAST = 1e-8


class MacroAnswers:
    """Approximate answers S⁺h of all subdomains, from their columns.

    Parameters
    ----------
    blocks : of the macro problem, solved
    soles : k on the boundary dofs of subdomains, at least of the first that has each array of the blocks
    starts : first boundary dof → subdomain
    """

    def __init__(self, blocks: Sequence[Blocks], soles: Mapping[int, sp.csr_array], starts: Mapping[int, int]):
        self.blocks, self.inverse = blocks, []
        for block in blocks:
            energy = np.stack([v @ (f - (soles[starts[int(at)]] @ v.T).T).T
                               for v, f, at in zip(block.answers, block.forces, block.columns[:, 0])])
            energy = (energy + energy.transpose(0, 2, 1)) / 2
            size = np.abs(energy).max(axis=(1, 2), initial=0.0)[:, None, None]
            self.inverse.append(np.linalg.inv(energy + (LEAST * size + np.finfo(float).tiny) * np.eye(energy.shape[1])))

    def __call__(self, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x (T, B), and (S + k) x, for boundary forces h (T, B)."""
        x, robin = np.zeros((2, *h.shape))
        for block, inverse in zip(self.blocks, self.inverse):
            weights = (h[:, block.columns].transpose(1, 0, 2) @ block.answers.transpose(0, 2, 1)) @ inverse
            x[:, block.columns] = (weights @ block.answers).transpose(1, 0, 2)
            robin[:, block.columns] = (weights @ block.forces).transpose(1, 0, 2)
        return x, robin
