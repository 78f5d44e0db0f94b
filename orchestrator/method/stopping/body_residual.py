"""How well forces in equilibrium obey the laws at each body, beside the forces on that body.

Of all bodies together the largest forces decide: a joint that carries a thousandth of another one
may be off by all it carries. Here what the stages differ by at the interfaces of some bodies is
compared with what they carry there,

    max_g ‖f − f̂‖_g / ‖f‖_g,     in the norm of (k⁺)⁻¹, over all load steps,

where forces that displacements of ``Lengths.of_rest`` are worth count as none. What supports hold,
with all that is joined to it, is judged for itself; what contact alone holds together with the
loose bodies that it touches: what one grain among others carries may be as little as it likes, and
then tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak, ratio, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.local_stage import LocalState
from orchestrator.method.stopping.bodies import JoinedBodies
from orchestrator.method.stopping.law_residuals import Lengths
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.interface import ends_of
from orchestrator.scene.model import Scene


def judged_together(scene: Scene, bodies: JoinedBodies) -> np.ndarray:
    """(subdomains,) int, the group of each."""
    ends = bodies.body[ends_of(scene.interfaces)]
    touching = ends[bodies.loose.any(axis=(1, 2))[ends].all(axis=1)]
    return components(*touching.T, bodies.count)[1][bodies.body]


def body_residual(parts: Sequence[tuple[Pairs, np.ndarray, np.ndarray, LocalState, History]],
                  lengths: Lengths, space: TraceSpace,
                  groups: np.ndarray) -> float:
    """The largest of all groups.

    parts : as for ``law_residuals``
    groups : (subdomains,) int, of ``judged_together``
    """
    squares = np.zeros((3, space.size))
    for pairs, _, f, local, _ in parts:
        C = pairs.nodes.compliance[: space.size, : space.size]
        missing, force = (f - pairs.transfer.opposed(local.force))[:, : space.size], f[
            :, : space.size]
        softness = C.diagonal()
        stiffness = ratio(1 / 3, softness)  # as in the mean direction of a node
        squares += (missing * times(C, missing)).sum(axis=0), (force * times(C, force)).sum(
            axis=0), stiffness / len(parts)
    sums = np.zeros((3, int(groups.max(initial=-1)) + 1))
    for group, part in zip(groups[space.subdomains], space.parts):
        sums[:, group] += squares[:, part].sum(axis=1)
    off, carried, stiff = space.team.sum(sums)[0]
    scale = np.maximum(carried, stiff * lengths.of_rest**2)
    return float(np.sqrt(peak(ratio(off, scale))))
