"""Subdomains whose matter is nonlinear: what they truly do, beside what their elastic stiffness says.

The linear stage, the macro problem and the coarse contact problem are set up once, with the elastic M. What is truly done
by a subdomain under the same forces is asked of its code at every stage, one load step at a time,

    u = advance(f_ext + Nᵀs),      δ = u − M⁻¹(f_d + Nᵀs)

and δ is added to what the stage finds: the elastic problems then extrapolate from the true answer. At the fixed point they
correct nothing (α = 0, y = 0), so that what is found is the true answer's.

At the end of a load step it is committed, with the forces that it ended with. Its pseudo-loads

    p = K u − r(u)      (on all dofs; r: the forces that u needs; zero where matter and soles are elastic)

make the elastic problem answer u: M u_free = f_d + Nᵀs + p. As loads of the scene they serve all that is delivered:
fields, reactions, balance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.loading import Loading
from orchestrator.scene.model import Subdomain


class Nonlinear:
    """The nonlinear subdomains of one decomposition.

    own : the subdomains in the order of ``space.subdomains``; some remember load steps
    traces : per subdomain (t,) its boundary dofs in local numbering
    dofs : per subdomain, dofs of its extended mesh
    reload : the loading, from the subdomains' loads as they are
    """

    def __init__(self, blackbox: BlackBox, space: TraceSpace, own: Sequence[Subdomain], traces: Sequence[np.ndarray],
                 dofs: Sequence[int], reload: Callable[[], Loading]):
        self.blackbox, self.space, self.own, self.traces, self.dofs, self.reload = blackbox, space, own, traces, dofs, reload
        self.members = [e for e, s in enumerate(own) if s.remembers]
        self.external = {e: own[e].loads.copy() for e in self.members}  # without pseudo-loads

    def put(self, step: int, u: np.ndarray, robin: np.ndarray, commit: bool = False) -> None:
        """Put true answers at a load step into boundary displacements (1, B), given the boundary forces (1, B) behind them.

        commit : the step ends with them, and pseudo-loads are added to the subdomains' loads
        """
        given = {}
        for e in self.members:
            s, forces = self.own[e], np.zeros(self.dofs[e])
            forces[: 3 * len(s.nodes)] = np.where(s.fixed, s.prescribed[step], self.external[e][step]).ravel()
            forces[self.traces[e]] += robin[0, self.space.boundary[e]]
            given[e] = forces
        for e, answer in self.blackbox.advance(given, commit).items():
            u[0, self.space.boundary[e]] = answer[0, self.traces[e]]
            if commit:
                s = self.own[e]
                s.loads[step] = self.external[e][step] + answer[1, : s.loads[step].size].reshape(-1, 3)

    def foresee(self, step: int) -> None:
        """Give a load step the pseudo-loads of the one before: what has flown stays."""
        for e in self.members:
            before = self.own[e].loads[step - 1] - self.external[e][step - 1] if step else 0.0
            self.own[e].loads[step] = self.external[e][step] + before
