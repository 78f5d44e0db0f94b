"""Work that interfaces take from the bodies, and the share of it that friction turns into heat.

With f the force on side 1 and d the jump from side 1 to side 2 at the end of load step n,

    W_n = W_{n−1} + Σ ½ (f_n + f_{n−1}) · (d_n − d_{n−1}),      D_n = D_{n−1} + Σ f_t,n · (d_t,n − d_t,n−1)

over the nodes; W is what springs store, D is friction's alone, whose law holds at the end of every step. Nodes that the other
side does not reach at either end of a step have no opening to work along.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.delivery.interface_fields import InterfaceFields


def work(interfaces: InterfaceFields, rubs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, I) W and D of the interfaces that are not perfect.

    Parameters
    ----------
    rubs : (I,) bool, whether what acts along the interface is friction
    """
    i = interfaces
    push, opening = i.pressure * i.areas, i.gap - i.initial_gap
    drag = i.friction_traction * i.areas[:, :, None]
    before = [np.concatenate([np.zeros_like(x[:1]), x[:-1]]) for x in (push, opening, drag, i.slip)]
    there = i.areas > 0
    there[1:] &= there[:-1]
    moved, slid = np.where(there, opening - before[1], 0.0), i.slip - before[3]
    taken = -0.5 * (push + before[0]) * moved + 0.5 * np.einsum("tni,tni->tn", drag + before[2], slid)
    lost = np.einsum("tni,tni->tn", drag, slid)
    each = [np.add.reduceat(x, i.offsets[:-1], axis=1).cumsum(axis=0) for x in (taken, lost)]
    return each[0], each[1] * rubs
