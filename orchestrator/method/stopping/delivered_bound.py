"""What is known of the fields that are delivered: energy, continuity, and the error bound where all interfaces are perfect."""

from __future__ import annotations

import math

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.continuity import Continuity


def bound_of(d: Decomposition, fields: Admissible, known: Bound | None = None) -> Bound:
    """Both parts of the bound; where laws are not perfect energy and continuity alone, and no bound.

    Parameters
    ----------
    known : what judging has found already, if anything: it costs no back-substitutions then
    """
    if known is not None and (not d.all_perfect or np.isfinite(known.relative)):
        return known
    if d.all_perfect:
        return d.bound(fields)
    space = d.space
    delta = Continuity(space, np.ones(len(space.global_dof)))(fields.u, d.stage.known)
    energy, = space.team.sum(d.loading.energy_of(space.loads(d.stage.robin_of(fields)), fields.u, space.loads(fields.f)))
    return Bound(math.nan, math.nan, energy, np.zeros((len(fields.u), sum(m.shape[1] for m in d.modes))), delta)
