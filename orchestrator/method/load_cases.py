"""Load steps that need no solution of their own, because they follow from others.

- All interfaces perfect: the problem is linear. The load vectors of all steps (prescribed displacements and
  nodal forces) are combinations of a few of them, and so are the solutions.
- No law has a history: equal loads have equal solutions. Where all laws scale with the load, the problem is also
  positively homogeneous, u(λ load) = λ u(load) for λ ≥ 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.stabilisation import stabilisation
from orchestrator.method.iterated import Iterated
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.bound import Bound
from orchestrator.parallel.team import Team
from orchestrator.scene.model import Scene

SAME = 1e-12  # part of a load vector that the others leave unexplained, relative to it


@dataclass(frozen=True)
class LoadCases:
    """The load steps that are solved, and how all follow from them.

    Parameters
    ----------
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


def load_cases(scene: Scene, skip, anchored: bool = False) -> LoadCases:
    """The steps to solve.

    Parameters
    ----------
    skip : ``method.skip`` of the configuration
    anchored : contacts are stabilised: they remember the load step before, whatever their laws do
    """
    if scene.steps > 1 and not any(s.remembers for s in scene.subdomains):
        laws = [i.law for i in scene.interfaces]
        if all(law.perfect for law in laws):
            if skip.superposition:
                return _independent(_load_vectors(scene))
        elif skip.proportional and not anchored and not any(
                i.law.has_history or i.law_at_steps for i in scene.interfaces):
            return _on_rays(_load_vectors(scene), all(law.homogeneous for law in laws))
    return LoadCases(np.arange(scene.steps), np.eye(scene.steps))


def common_load_cases(scene: Scene | None, method, team: Team) -> LoadCases:
    """The same for all ranks: rank 0 decides, which has the scene.

    Parameters
    ----------
    method : ``method`` of the configuration
    """
    return team.share(None if team.rank else load_cases(scene, method.skip, bool(stabilisation(scene, method).any())))


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


def _on_rays(loads: np.ndarray, homogeneous: bool) -> LoadCases:
    """Without history: of steps that are positive multiples of each other, or else equal, the largest is solved."""
    size = np.linalg.norm(loads, axis=0)
    chosen: list[int] = []
    weights = np.zeros((loads.shape[1], loads.shape[1]))
    for t in np.argsort(-size, kind="stable"):
        for c in chosen:
            factor = size[t] / size[c] if homogeneous and size[c] else 1.0
            if np.linalg.norm(loads[:, t] - factor * loads[:, c]) <= SAME * size[t]:
                weights[c, t] = factor
                break
        else:
            chosen.append(int(t))
            weights[t, t] = 1.0
    chosen.sort()
    return LoadCases(np.array(chosen), weights[chosen], "proportional")


def expanded(d: Decomposition, iterated: Iterated, cases: LoadCases) -> Iterated:
    """What the iterations ended with for all load steps, from that for the solved ones.

    Parameters
    ----------
    d : the decomposition with all load steps

    Notes
    -----
    The bound that ended the iterations already held for all steps, see ``ErrorBound.for_cases``; energies and
    the correction to u_D are evaluated again.
    """
    if not cases.left_out:
        return iterated
    weights, local, bound = cases.weights, iterated.local, iterated.bound
    fields, everything = iterated.fields.combined(weights), LocalState(weights.T @ local.s)
    if d.all_perfect:
        bound = replace(d.bound(fields, complete=False), relative=bound.relative)
    else:
        status = local.status[weights.argmax(axis=0)]  # of the step that each one is a multiple of
        status[~weights.any(axis=0)] = d.local.at_rest  # unloaded
        everything = LocalState(everything.s, tuple(weights.T @ h for h in local.hats),
                                cases.all_steps(local.force), cases.all_steps(local.lawful), cases.all_steps(local.jump), status)
        bound = Bound(bound.relative, bound.a, bound.energy @ weights**2, weights.T @ bound.repositioned,
                      weights.T @ bound.correction)
    return replace(iterated, fields=fields, local=everything, bound=bound)
