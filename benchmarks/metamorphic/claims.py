"""What a run that was soon content guarantees, beside the answer of one that was not: its energy error."""

from __future__ import annotations

import numpy as np

from benchmarks.metamorphic.answers import Answer
from benchmarks.metamorphic.compare import LAWFUL, ROUNDING, distance, size_of


def claims_hold(fine: Answer, rough: Answer) -> tuple[str, str]:
    """Agree where the finer answer is within what the rougher one guarantees; not sayable where that is nothing."""
    summary = rough.solution.summary
    if summary["error_kind"] != "guaranteed":
        return "not sayable", ""
    slack = ROUNDING if np.isfinite(fine.bound) else LAWFUL
    # interfaces that are springs store energy beside the bodies', which the bound is relative to as well
    larger = max(1.0, float(np.sqrt(2 * np.abs(fine.energy).max())) / size_of(fine))
    apart, bound = distance(fine, rough).displacement, larger * summary["error_bound"]
    return "disagree" if apart > 1.001 * bound + slack else "agree", f"error {apart:.2e}, guaranteed {bound:.2e}"
