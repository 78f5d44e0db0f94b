"""Load steps that need no solution of their own, because they follow from others.

Where all interfaces are perfect the problem is linear. The load vectors of all steps (prescribed displacements and nodal forces)
are combinations of a few of them, and so are the solutions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated
from orchestrator.method.local.state import LocalState
from orchestrator.parallel.team import Team
from orchestrator.scene.model import Scene

SAME = 1e-12  # part of a load vector that the others leave unexplained, relative to it


@dataclass(frozen=True)
class LoadCases:
    """The load steps that are solved, and how all follow from them.

    chosen : (r,) int, ascending
    weights : (r, T) step t = Σᵢ weights[i, t] × step chosen[i]
    switch : of ``method.skip``, that allows to leave steps out
    """

    chosen: np.ndarray
    weights: np.ndarray
    switch: str = ""

    @property
    def left_out(self) -> int:
        """Number of steps that are not solved."""
        return self.weights.shape[1] - len(self.chosen)

    def all_steps(self, values: np.ndarray) -> np.ndarray:
        """(T, …) of what is linear in the load, given (r, …)."""
        return np.tensordot(self.weights.T, values, axes=1) if self.left_out else values

    def part_of(self, d: Decomposition) -> Decomposition:
        """The decomposition for the chosen steps, with a bound that holds for all of them."""
        if not self.left_out:
            return d
        part = d.batch(self.chosen)
        return replace(part, bound=part.bound and part.bound.for_cases(self.weights))


def load_cases(scene: Scene, skip) -> LoadCases:
    """The steps to solve.

    skip : ``method.skip`` of the configuration
    """
    if skip.superposition and scene.steps > 1 and all(i.law.perfect for i in scene.interfaces) and not any(
            s.remembers for s in scene.subdomains):
        return _independent(_load_vectors(scene))
    return LoadCases(np.arange(scene.steps), np.eye(scene.steps))


def common_load_cases(scene: Scene | None, method, team: Team) -> LoadCases:
    """The same for all ranks: rank 0 decides, which has the scene.

    method : ``method`` of the configuration
    """
    return team.share(None if team.rank else load_cases(scene, method.skip))


def _load_vectors(scene: Scene) -> np.ndarray:
    """(n, T) prescribed displacements and forces, each relative to the largest; without entries that are always zero."""
    parts = []
    for name in ("prescribed", "loads"):
        values = np.hstack([getattr(s, name).reshape(scene.steps, -1) for s in scene.subdomains]).T
        values = values[values.any(axis=1)]
        parts.append(values / np.abs(values).max(initial=np.finfo(float).tiny))
    return np.vstack(parts)


def _independent(loads: np.ndarray) -> LoadCases:
    """Linear: a rank-revealing QR picks the steps, the largest first."""
    if not loads.any():
        return LoadCases(np.array([0]), np.ones((1, loads.shape[1])), "superposition")
    _, triangle, order = la.qr(loads, mode="economic", pivoting=True)
    # what a column has below row r is what r steps leave unexplained of it; largest columns come first
    left = np.sqrt(np.cumsum(triangle[::-1] ** 2, axis=0)[::-1])
    size = left[0]
    rank = next((r for r in range(1, len(left)) if (left[r] <= SAME * size).all()), len(left))
    weights = np.zeros((rank, loads.shape[1]))
    weights[:, order] = la.solve_triangular(triangle[:rank, :rank], triangle[:rank])
    ascending = np.argsort(order[:rank])
    return LoadCases(order[:rank][ascending], weights[ascending], "superposition")


def expanded(d: Decomposition, iterated: Iterated, cases: LoadCases) -> Iterated:
    """What the iterations ended with for all load steps, from that for the solved ones.

    d : the decomposition with all load steps

    The bound that ended the iterations already held for all steps, see ``ErrorBound.for_cases``; energies and
    the correction to u_D are evaluated again.
    """
    if not cases.left_out:
        return iterated
    fields = iterated.fields.combined(cases.weights)
    bound = replace(d.bound.first(fields)[0], relative=iterated.bound.relative)
    return replace(iterated, fields=fields, local=LocalState(cases.weights.T @ iterated.local.s), bound=bound)
