"""Walls of bricks, no two of which are joined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.problems.cases import STEEL

LENGTH, HEIGHT, DEPTH = 2.0, 1.0, 1.0  # of a brick
CELLS = (4, 2, 2)  # elements along it


def wall(rows: int, bricks: int, friction: float, path: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Bricks in running bond: every other row is half a brick off, and ends in half bricks. The bottom is clamped.

    Parameters
    ----------
    bricks : in a row without halves
    path : motion of the top, a vector per load step
    """
    parts = []
    for row in range(rows):
        half = row % 2
        ends = [0.0] * half + [LENGTH * (k + half / 2) for k in range(bricks + 1 - half)] + [LENGTH * bricks] * half
        for k, (start, end) in enumerate(zip(ends, ends[1:])):
            cells = [round(CELLS[0] * (end - start) / LENGTH), *CELLS[1:]]
            parts.append({"name": f"brick_{row}_{k}", "mesh": {"box": {"size": [end - start, DEPTH, HEIGHT], "cells": cells}},
                          "move": {"translate": [start, 0, row * HEIGHT]}})
    return {
        "name": f"wall-{rows}-{bricks}",
        "parts": parts,
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": rows * HEIGHT}, "displacement": list(map(list, path))}],
        "interfaces": [{"between": "auto", "law": "contact", "friction": friction}],
    }
