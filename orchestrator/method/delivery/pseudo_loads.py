"""What iterations have ended with where matter is nonlinear, seen as the elastic problem under pseudo-loads."""

from __future__ import annotations

from dataclasses import replace

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.delivered_bound import bound_of


def with_pseudo_loads(d: Decomposition, iterated: Iterated) -> Iterated:
    """The same with energies of the loads that are in the decomposition by now.

    Parameters
    ----------
    d : ``reloaded``, for all load steps
    """
    return replace(iterated, bound=bound_of(d, iterated.fields))
