"""Macro problem of scenes that are solved by nodes: the fields Φ of coarse nodes, eq. 17 on nodes.

    Φᵀ Σ f = 0   ⇒   Σ_E F_Eᵀ (Φ_E − V_E) α = Φᵀ Σ f₁,     F_E = k_E Φ_E,   V_E = M_E⁻¹ F_E
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.sparse.symmetric import regularised
from orchestrator.method.interface.rows import digest, peak, times
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.linear.coarse_nodes import coarse_fields
from orchestrator.method.linear.macro import assembled, joined, Macro
from orchestrator.parallel.numbering import Borders
from orchestrator.scene.conditions.rigid import RIGID
from orchestrator.scene.model import Scene


class NodeMacro(Macro):
    """The macro problem of coarse nodes; some fields may depend on others.

    scene : with the direction's subdomains
    direction : search direction k⁻
    """

    def __init__(self, scene: Scene, direction: SearchDirection):
        self.space, self.direction = direction.space, direction
        self.strategy, team = "equilibrium", self.space.team
        self.fields, node, count = coarse_fields(scene, self.space)
        self.size, self._back = len(node), sp.csr_array(self.fields.T)
        self.number = RIGID * node + np.arange(len(node)) % RIGID
        had = np.zeros(count)
        had[node] = 1
        self.shared = team.sum(had)[0][node] > 1
        self._borders = Borders(self.number[self.shared, None], np.flatnonzero(self.shared), team)
        # per subdomain, the unknowns (s,) that it sees, Φ and k Φ (s, t); equal ones are the same
        self._asked, known = ([], [], []), {}
        parts = self.space.boundary
        for part, k in zip(parts, direction.robin_blocks(range(len(parts)))):
            own = self.fields[part]
            seen = np.unique(own.indices)
            dense = np.ascontiguousarray(own[:, seen].toarray())
            key = digest(dense, k.indptr, k.indices, k.data)
            if key not in known:
                known[key] = dense.T, np.ascontiguousarray((k @ dense).T)
            for one, each in zip(self._asked, (seen, *known[key])):
                one.append(each)

    def solve(self, blackbox: BlackBox) -> float:
        """As of the base class."""
        space, parts, (sees, fields, forces) = self.space, self.space.boundary, self._asked
        del self._asked
        answers = blackbox.traces({e: force for e, force in enumerate(forces) if force.size})
        self.blocks = joined(sees, parts, forces, answers)
        own = joined(sees, parts, forces, {e: fields[e] for e in answers})
        lower = assembled(own, self.size) - assembled(self.blocks, self.size)
        self._solve = self._solver(sp.csr_array(sp.tril(regularised(lower))))
        solved, = space.team.sum(sum(map(len, sees)))
        return float(solved) / space.link.subdomain_count

    def multiplier(self, w: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(T, size) α from the traces (T, B) of the uncorrected stage."""
        return self._solve(times(self._back, f))

    def imbalance(self, f: np.ndarray) -> tuple[float, float]:
        """Largest entry of |Φᵀ Σ f|, and largest sum of its terms' magnitudes; all ranks ask."""
        f = f[:, : self.space.size]
        terms = (self._back, f), (abs(self._back), np.abs(f))
        return tuple(peak(self._borders(times(fields, x))) for fields, x in terms)

    def force(self, alpha: np.ndarray) -> np.ndarray:
        """(T, B) k Φ α."""
        return self._summed(alpha, "forces")
