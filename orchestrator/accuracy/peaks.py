"""Whether the largest stress has a limit, from what meshes have found of it that are finer and finer where it is.

At a re-entrant edge, where a support, a contact or another matter ends, stresses are of r^−a, 0 < a ≤ ½, so that a mesh of size h there finds
some h^−a: no mesh is fine enough. Where stresses have a limit a mesh misses it by some h. Two meshes tell of either what a third will find,

    σ₃ = σ₂ (h₂/h₃)^a,  a = ln(σ₂/σ₁) / ln(h₁/h₂),        σ₃ = σ₂ + (σ₂ − σ₁)(h₂ − h₃)/(h₁ − h₂),

and the nearer of both is believed.

M. L. Williams, Stress singularities resulting from various boundary conditions in angular corners of plates in extension, J. Appl. Mech. 19,
1952, 526–528.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orchestrator.results.solution import Solution
from orchestrator.scene.mesh.size_map import edge_lengths

CLEAR = 0.8  # of the size before: meshes that are hardly finer there tell nothing

Peak = tuple[float, float]  # the largest von Mises stress, and the mean size of the elements at that place


def peak_of(solution: Solution) -> Peak | None:
    """Of one mesh; None where no stress is known, or none is there."""
    found, mesh = solution.summary["peak_stress"], solution.scene.mesh
    if not found or not found["value"] > 0:
        return None
    node = np.square(mesh.nodes - found["at"]).sum(axis=1).argmin()
    return found["value"], float(edge_lengths(mesh.nodes, mesh.cells[(mesh.cells == node).any(axis=1), :4]).mean())


def growth(peaks: Sequence[Peak | None]) -> float | None:
    """a of stresses that grow as h^−a, from the last mesh and two before it that are coarser there; None where they do not grow so, or
    there are no such meshes.

    peaks : mesh by mesh
    """
    clear: list[Peak] = []
    for peak in reversed([one for one in peaks if one]):
        if not clear or clear[-1][1] <= CLEAR * peak[1]:
            clear.append(peak)
    if len(clear) < 3:
        return None
    (third, h3), (second, h2), (first, h1) = clear[:3]
    if not third > second > first:
        return None
    endless = second * (h2 / h3) ** (math.log(second / first) / math.log(h1 / h2))
    limited = second + (second - first) * (h2 - h3) / (h1 - h2)
    return math.log(third / second) / math.log(h2 / h3) if third > (endless + limited) / 2 else None
