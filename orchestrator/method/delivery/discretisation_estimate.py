"""The estimated discretisation error of displacements that are, or would be, delivered; among all ranks."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.recovery import of_all, recover
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.load_cases import LoadCases
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.discretisation import Estimate, Estimator
from orchestrator.scene.model import Scene


class DiscretisationEstimate:
    """Rank 0 brings the displacements together and estimates; it begins to prepare that when first asked.

    Parameters
    ----------
    scene : the whole one, of four-node or ten-node tets; on rank 0
    cases : how all load steps follow from those that are solved
    """

    def __init__(self, scene: Scene | None, cases: LoadCases):
        self.scene, self.cases = scene, cases

    @cached_property
    def estimator(self) -> Estimator:
        """On rank 0 alone."""
        return Estimator.of(self.scene)

    def __call__(self, d: Decomposition, fields: Admissible, bound: Bound) -> float:
        """Relative, energy norm, if these fields were delivered; shared with all ranks.

        It costs one back-substitution per subdomain and load step.

        Parameters
        ----------
        d : for the load steps of the fields
        """
        parts = of_all(d, recover(d, fields, bound)[0])
        if d.space.team.rank:
            return d.space.team.share(None)
        if d.all_perfect:  # with contact, the steps left out are smaller than those they follow from
            parts = [self.cases.all_steps(u) for u in parts]
        return d.space.team.share(self.estimator(parts, None if d.all_perfect else d.local.pairs.numbers).relative)

    def of_delivered(self, continuous: list[np.ndarray]) -> Estimate:
        """Of delivered displacements, per subdomain, on rank 0."""
        return self.estimator(continuous)
