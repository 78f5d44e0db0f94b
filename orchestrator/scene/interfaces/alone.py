"""Parts that no interface connects to any other, where the pairs of parts are found rather than named."""

from __future__ import annotations

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.pairing import Body, nearest
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.partition.partition import Partition
from orchestrator.wording import some


def report_alone(mesh: Mesh, bodies: list[Body], piece: np.ndarray, links: list[np.ndarray], told: set[tuple[int, int]],
                 partition: Partition, laws: Laws, problems: Problems) -> None:
    """Adds a problem for each piece without any pair, with the nearest other part and its distance.

    Parameters
    ----------
    bodies : the outer faces, by subdomain and volume
    piece : (m,) int, the piece of each tet, pieces being what shares faces
    links : (k, 2) int each, cells on both sides of the interfaces
    told : pairs of volumes that have been complained of already
    """
    index = next((i for i, entry in enumerate(laws.entries) if entry.found), -1)
    if index < 0:
        return
    paired = np.unique(piece[np.concatenate(links)]) if links else np.empty(0, dtype=int)
    known = {v for pair in told for v in pair}
    first = np.unique(piece, return_index=True)[1]
    for number in np.setdiff1d(np.arange(len(first)), paired):
        own = [int(v) for v in np.unique(mesh.volume[piece == number])]
        mine = [b for b in bodies if b.volume in own]
        others = [(b, c) for b in mine for c in bodies if c.volume not in own
                  and not laws.excluded(*((partition.names[x.subdomain], mesh.volumes[x.volume]) for x in (b, c)))]
        if not others or known & set(own):
            continue
        (distance, where, size), other = min(((nearest(b, c), c) for b, c in others), key=lambda found: found[0][0])
        names, beside = some([mesh.volumes[v] for v in own]), mesh.volumes[other.volume]
        problems.add(("interfaces", index), f"{names} has no pair: the nearest other part is {beside!r}, {distance:.3g} from node "
                     f"to node, at {format_point(where)}, where elements measure {size:.3g}", "parts that lie on some other one",
                     f"move it, raise tolerance, or say that it is meant to be alone: exclude: [[{mesh.volumes[own[0]]}, '*']]")
