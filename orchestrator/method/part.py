"""What a rank needs of a scene to take part in its solution: made by rank 0, which holds all of it, rank after rank."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.models.extended import boundary_dofs, sides_by_subdomain
from orchestrator.method.interface.ties import make_ties
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.loading import Carried
from orchestrator.parallel.team import Team
from orchestrator.scene.model import Scene
from orchestrator.scene.part import overview, part_of


@dataclass
class Part:
    """A rank's part of a scene; all of it where there is one.

    scene : own subdomains, their interfaces, and of their neighbours what meets these
    space : numbering of its traces
    carried : rigid motions that go with what is prescribed, of the whole scene
    """

    scene: Scene
    space: TraceSpace
    carried: Carried

    @classmethod
    def of_all(cls, scene: Scene) -> Part:
        """The scene in one part."""
        sides = sides_by_subdomain(scene)
        space = TraceSpace.of(scene, sides, [boundary_dofs(scene, s, sides[s.index]) for s in scene.subdomains])
        return cls(scene, space, Carried.of(scene))

    @classmethod
    def handed_out(cls, scene: Scene | None, rank_of: np.ndarray, team: Team) -> Part:
        """The rank's own part.

        scene : the whole one, on rank 0
        rank_of : (subdomains,) int, the rank of each
        """
        if team.size == 1:
            return cls.of_all(scene)
        whole, known = (None, None) if team.rank else (cls.of_all(scene), overview(scene))

        def made(rank: int) -> Part:
            piece = part_of(scene, np.flatnonzero(rank_of == rank), known)
            return Part(piece, whole.space.part(rank_of, rank, piece.number), whole.carried)

        part = team.hand_out(made)
        part.space.link.team, part.space.ties = team, make_ties(part.scene, part.space.transfer)
        return part
