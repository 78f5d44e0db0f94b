"""What iterations have ended with where matter is nonlinear, seen as the elastic problem under pseudo-loads."""

from __future__ import annotations

from dataclasses import replace

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.criteria import LawCriterion


def with_pseudo_loads(d: Decomposition, iterated: Iterated, tolerance) -> Iterated:
    """The same with energies of the loads that are in the decomposition by now.

    Parameters
    ----------
    d : ``reloaded``, for all load steps
    tolerance : ``method.tolerance`` of the configuration
    """
    return replace(iterated, bound=LawCriterion(d, tolerance).final(iterated.fields, None)[0])
