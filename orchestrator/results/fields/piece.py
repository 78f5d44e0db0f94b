"""A rank's piece of a solution's fields: what is computed of fields is computed by all ranks, each of its own cells.

Rank 0, which has the displacements, hands the pieces out one after the other. Nobody holds stresses of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.method.stopping.discretisation import Estimate, Estimator
from orchestrator.parallel.team import Meeting, Team
from orchestrator.results.answers.extremes import Extremes, extremes
from orchestrator.results.fields.fields import Fields


@dataclass
class Piece:
    """Of one rank. Every rank asks the same of its own, in the same order.

    fields : of its cells, bodies with nodes of their own where interfaces open
    cells : (k,) int, their numbers in the whole
    team : the ranks
    """

    fields: Fields
    cells: np.ndarray
    team: Team

    @classmethod
    def handed_out(cls, fields: Fields | None, rank_of: np.ndarray, team: Team) -> Piece:
        """This rank's own.

        fields : the whole ones, on rank 0
        rank_of : (subdomains,) int, the rank of each
        """
        if team.rank == 0:
            drawn, owner = fields.opened, rank_of[fields.subdomain]
            label = np.arange(len(drawn.nodes)) if drawn.joined is None else drawn.joined
            ranks = np.zeros(int(label.max()) + 1, dtype=np.int16)
            for rank in range(team.size):
                ranks[np.unique(label[drawn.cells[owner == rank]])] += 1

        def made(rank: int) -> tuple:
            chosen = np.flatnonzero(owner == rank)
            own = label[np.unique(drawn.cells[chosen])]
            joined = None if drawn.joined is None else np.unique(own, return_inverse=True)[1].ravel()
            piece = replace(drawn.some(chosen), joined=joined)
            return piece, chosen, own, ranks[own] > 1

        piece, chosen, own, shared = team.hand_out(made)
        return cls(replace(piece, meeting=Meeting(own, shared, team)), chosen, team)

    def estimate(self, wanted: bool) -> Estimate | None:
        """Of the discretisation error, where it is wanted: on rank 0 with the shares of all cells, elsewhere of its own."""
        if not self.team.share(wanted):
            return None
        f = self.fields
        joined = np.arange(len(f.nodes)) if f.joined is None else f.joined
        found = Estimator(f.nodes, f.cells, joined, f.lame, f.thermal, meeting=f.meeting)([f.displacement])
        self._know(discretisation_error=found.cells)
        return self._whole(found)

    def _whole(self, found: Estimate) -> Estimate:
        everyone = self.team.gather((self.cells, found.cells))
        if everyone is None:
            return found
        cells = np.empty((len(found.cells), sum(len(chosen) for chosen, _ in everyone)))
        for chosen, own in everyone:
            cells[:, chosen] = own
        return Estimate(found.relative, cells)

    def extremes(self, believed: np.ndarray | None = None, lost: np.ndarray | None = None) -> Extremes | None:
        """Those of the whole, on rank 0, which knows the parameters.

        believed : (m,) bool, of all cells, as for ``Fields``
        lost : as for ``extremes``
        """
        lost, unsound = self.team.share((lost, None if believed is None else np.flatnonzero(~believed)))
        if unsound is not None:
            self._know(believed=~np.isin(self.cells, unsound))
        everyone = self.team.gather(extremes(self.fields.nodal, lost))
        return None if everyone is None else Extremes.joined(everyone)

    def _know(self, **more: np.ndarray) -> None:
        """What is only known later; what was computed without it goes."""
        self.fields = replace(self.fields, **more)
