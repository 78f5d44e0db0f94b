"""What a rank's part of the interface unknowns is in the whole scene's numbering, and what it exchanges with others."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from orchestrator.parallel.numbering import runs
from orchestrator.parallel.team import ALONE, Team


@dataclass
class Link:
    """What a rank's part exchanges with others."""

    number: np.ndarray  # (D,) and (B,) int, its trace dofs and boundary dofs in the numbering of the whole scene
    boundary_number: np.ndarray
    total: int  # trace dofs and subdomains of the whole scene
    subdomain_count: int
    sends: dict[int, np.ndarray] = field(default_factory=dict)  # per neighbouring rank, trace dofs to send and ghosts to receive
    receives: dict[int, np.ndarray] = field(default_factory=dict)
    team: Team = ALONE

    @classmethod
    def of(cls, mine: np.ndarray, traces: np.ndarray, boundaries: np.ndarray, count: int, team: Team) -> Link:
        """To nobody yet. All ranks ask together.

        mine : (own,) int, ascending, this rank's of ``count`` subdomains
        traces, boundaries : (own,) int, how many trace dofs and boundary dofs each has
        """
        counts = np.zeros((2, count))
        counts[:, mine] = traces, boundaries
        counts = team.sum(counts)[0].astype(int)
        number, boundary_number = (runs((np.cumsum(each) - each)[mine], each[mine]) for each in counts)
        return cls(number, boundary_number, int(counts[0].sum()), count, team=team)
