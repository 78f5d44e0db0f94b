"""The whole structure in one piece where interfaces join nodes that are no common ones.

    min ½ uᵀK u − fᵀu   where   B u = 0,      B u = G₂ u₂ − G₁ u₁  on every interface,

by augmented Lagrangians (Hestenes, J. Optim. Theory Appl. 4, 1969): with K + γ BᵀB, which is positive definite and is
factorised once,

    u ← (K + γ BᵀB)⁻¹ (f − Bᵀλ),      λ ← λ + γ B u

leaves less of the jump in each round by the softness of the structure beside γ. Constraints that say the same twice, where
interfaces meet, do no harm. Nothing of the decomposed method is used but the operators.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import Factor
from orchestrator.method.refusal import Refusal
from orchestrator.scene.model import Scene

# γ over the bodies' stiffness at the nodes: leaves some 1e-3 of a jump per round, and ten digits of K in K + γ BᵀB.
STIFF = 1e3
# A jump this small beside the displacements is none; rounds that it may take.
CLOSED, ROUNDS = 1e-12, 40


def constraints(scene: Scene) -> sp.csr_array:
    """(q, 3n) B on the nodes of the mesh; no rows where all interfaces join common nodes."""
    blocks = [sp.csr_array((0, 3 * len(scene.mesh.nodes)))]
    for i in scene.interfaces:
        one, two = (scene.side_nodes(i, side) for side in (0, 1))
        if i.mortar is not None:
            pair = i.mortar.first, i.mortar.second
        elif np.array_equal(one, two):
            continue
        else:
            pair = (sp.eye_array(3 * len(one), format="csr"),) * 2
        placed = []
        for matrix, nodes in zip(pair, (one, two)):
            entries = matrix.tocoo()
            row, column = entries.coords
            placed.append(sp.csr_array((entries.data, (row, 3 * nodes[column // 3] + column % 3)),
                                       shape=(matrix.shape[0], blocks[0].shape[1])))
        blocks.append(placed[1] - placed[0])
    return sp.csr_array(sp.vstack(blocks))


def constrained(scene: Scene, stiffness: sp.csr_array, B: sp.csr_array) -> np.ndarray:
    """Displacement (T, n, 3) of all load steps.

    Parameters
    ----------
    stiffness : (3n, 3n) K of the unconnected bodies
    B : (q, 3n) constraints

    Raises
    ------
    Refusal : the sides do not come together: what is prescribed on either contradicts them
    """
    loose = np.flatnonzero(~scene.fixed.ravel())
    lift = np.where(scene.fixed, scene.prescribed, 0.0).reshape(scene.steps, -1)
    right = (scene.loads.reshape(scene.steps, -1) - (stiffness @ lift.T).T)[:, loose]
    gap, inner, free = (B @ lift.T).T, sp.csr_array(stiffness[loose][:, loose]), sp.csr_array(B[:, loose])
    met = np.unique(free.indices)
    gamma = STIFF * float(np.mean(inner.diagonal()[met])) if len(met) else 1.0
    solve = Factor(sp.csr_array(inner + gamma * (free.T @ free)))
    force, u = np.zeros((scene.steps, B.shape[0])), np.zeros((scene.steps, len(loose)))
    for _ in range(ROUNDS):
        rest = right - (inner @ u.T).T - (free.T @ (force + gamma * ((free @ u.T).T + gap)).T).T
        u = u + solve(rest)
        jump = (free @ u.T).T + gap
        force += gamma * jump
        size = max(np.abs(u).max(initial=0.0), np.abs(lift).max(initial=0.0))
        if np.abs(jump).max(initial=0.0) <= CLOSED * size:
            break
    else:
        raise Refusal("bonds that do not close", jump=np.abs(jump).max(), size=size)
    lift[:, loose] += u
    return lift.reshape(scene.steps, -1, 3)
