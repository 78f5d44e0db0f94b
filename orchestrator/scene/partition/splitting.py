"""Volumes that are much larger than the others, cut further: small subdomains need not wait for them.

The pieces are connected; METIS makes them. They are joined by perfect interfaces whatever the laws between bodies are.
"""

from __future__ import annotations

import numpy as np

from orchestrator.cost import EXPONENT, predicted_cost
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import unique_names
from orchestrator.scene.partition.metis import cut
from orchestrator.scene.partition.numbering import split_numbering

# Under ``auto`` a piece may cost this many times what the volumes cost on average.
UNEVEN = 2.0


def split(mesh: Mesh, faces: Faces, names: list[str], above: int | str) -> tuple[np.ndarray, list[str], list[str]]:
    """Cuts large volumes in pieces.

    Parameters
    ----------
    names : of the volumes; each is connected
    above : dofs, three per node, that no piece of several tets exceeds; "auto": as many as are predicted
        to cost ``UNEVEN`` times the mean of the volumes

    Returns
    -------
    subdomain : (m,) int per tet; the pieces of a volume follow one another
    names : of the subdomains: the volume's, or with a number from 1 for each piece, ``grain_3.1``
    bodies : names of the volumes they are pieces of
    """
    sizes = np.bincount(mesh.volume)
    part, shares = mesh.volume, np.ones(len(names), dtype=np.int64)
    dofs = _dofs(mesh, part, len(shares))
    limit = (UNEVEN * predicted_cost(dofs).mean()) ** (1 / EXPONENT) if above == "auto" else above
    while True:
        largest = np.maximum.reduceat(dofs, np.cumsum(shares) - shares)
        more = (largest > limit) & (shares < sizes)
        if not more.any():
            break
        # nodes on the cuts count twice: the pieces' dofs decide, not the number of pieces
        wanted = np.maximum(np.ceil(shares * largest / limit).astype(np.int64), shares + 1)
        shares = np.where(more, np.minimum(wanted, sizes), shares)
        part = cut(faces, mesh.volume, shares)
        dofs = _dofs(mesh, part, shares.sum())
    body = np.repeat(np.arange(len(names)), shares)[dofs > 0]  # METIS may leave parts empty
    part = np.unique(part, return_inverse=True)[1]
    shares = np.bincount(body)
    numbered = [[name] if share == 1 else [f"{name}.{i}" for i in range(1, share + 1)]
                for name, share in zip(names, shares)]
    return part, unique_names([name for own in numbered for name in own]), np.repeat(names, shares).tolist()


def _dofs(mesh: Mesh, part: np.ndarray, count: int) -> np.ndarray:
    """(count,) dofs of each part, three per node."""
    found = 3 * np.diff(split_numbering(mesh.cells, part, len(mesh.nodes)).offsets)
    return np.r_[found, np.zeros(count - len(found), dtype=np.int64)]
