"""What is one and the same over several ranks: classes of things, each called by the lowest of their names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.faces import components


def classes(names: np.ndarray, one: np.ndarray, two: np.ndarray, across: Mapping[int, np.ndarray], team: Team) -> np.ndarray:
    """(n,) int, the lowest name in the class of each of this rank's things; all ranks ask together.

    A class goes from rank to rank by way of its neighbours, a round of messages for each that lies between: on meshes a few.

    names : (n,) int below 2⁵³, no two alike on all ranks
    one, two : (k,) int, things of this rank that are one
    across : rank → (m,) int, things of this rank that are one with that rank's, which has its own in the same order; −1: none is
    """
    count, label = components(one, two, len(names))
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, label, names)
    changed = team.size > 1
    while changed:
        outgoing = {rank: np.where(at >= 0, lowest[label[at]], np.inf) if len(label) else np.full(len(at), np.inf)
                    for rank, at in across.items()}
        arrived, before = team.exchange(outgoing, {rank: np.empty(len(at)) for rank, at in across.items()}), lowest.copy()
        for rank, at in across.items():
            np.minimum.at(lowest, label[at[at >= 0]], arrived[rank][at >= 0])
        changed = bool(team.max(float((lowest < before).any()))[0])
    return lowest[label].astype(int)
