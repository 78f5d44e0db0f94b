"""Rigid tools in the summary, and sentences on those whose contact is not that with their surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from orchestrator.errors import some
from orchestrator.method.delivery.tools import Placed
from orchestrator.scene.mesh.geometry import format_point

# Shares of gaps' worth of pressure, and of forces that point elsewhere, from which they are told.
AMISS, TURNED = 0.1, 0.01


def tools_moved(placed: Sequence[Placed]) -> list[dict[str, Any]]:
    """Every tool's displacement of its point and rotation in degrees, per load step."""
    return [{"name": one.tool.name, "about": one.tool.driven.about.tolist(), "displacement": one.moved[:, :3].tolist(),
             "rotation": np.degrees(one.moved[:, 3:]).tolist()} for one in placed]


def tool_cautions(placed: Sequence[Placed]) -> Iterator[str]:
    """A sentence on each tool whose contact is not that with its surface, or that faces without contact have passed through."""
    for one in placed:
        told = [f"gaps are off by up to {one.apart:.0%} of what presses"] * (one.apart > AMISS) + \
            [f"forces point {one.turned:.1%} of their size elsewhere"] * (one.turned > TURNED)
        if told:
            yield f"{one.tool.name} has moved along its curved surface: {' and '.join(told)}; smaller motions are told right"
        if one.passed is not None:
            depth, step, where = one.passed
            yield (f"{some(one.parts)} passes through {one.tool.name} by {depth:.3g} at load step {step + 1}, at {format_point(where)}, where "
                   "no faces were sought that it may touch: write within: with a larger length, or angle: for faces that look aside")
