"""Rules that concern several keys at once.

They read the raw data, not the validated model, so that a user sees them together with the
errors of single keys. Each is a function ``data → problems`` that skips what has no sensible
shape (reported elsewhere) and is listed in ``RULES``.
"""

from __future__ import annotations

from typing import Any

from orchestrator.config.rules.combinations import acceleration_fits, belongs_to, exactly_one, following, heeded, magnitudes, one_element, sole_ratio
from orchestrator.config.rules.conditions import acting, directions, load_steps, places, what_histories_multiply
from orchestrator.config.rules.structure import a_mesh, foreign_parts, parts_fit, probes_fit
from orchestrator.errors import Problem

RULES = [following, magnitudes, exactly_one, belongs_to, places, acting, sole_ratio, load_steps, what_histories_multiply,
         acceleration_fits, heeded, one_element, a_mesh, parts_fit, foreign_parts, directions, probes_fit]


def broken_rules(data: Any) -> list[Problem]:
    """Problems of all rules."""
    return [problem for rule in RULES for problem in rule(data)]
