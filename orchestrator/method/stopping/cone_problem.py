"""Limit load: whether forces that the laws allow can balance the loads on bodies, and the rigid
motion that proves that none can.

With y the rigid motions of all bodies that supports leave, L what the loads do in them, d = B R y
the jumps, and λ = q s n + x, |x| ≤ c + μ q, q ≥ 0 the forces that a law allows
(``laws.points.Carries``), balance asks for

    Σ λ·d = L·y    for all y.

It is a second-order cone problem. There are no such forces if and only if (Farkas) there is a
motion with

    s n·d + μ |d_x| ≤ 0 at every point,    L·y > Σ c |d_x| :

loads do more work in it than anything resists, whatever the pressures. Both are found at once,
always well-posed, by

    max  L·y − Σ c |d_x|    with    |y_b| ≤ 1 for every body,

whose value is the least force that balance lacks. Gaps count as closed and pressures as large as
one likes, so that the forces are more than the laws allow: where there are none the scene has no
solution, in small displacements; where there are, elasticity may not bring them about.
``Reach.at_pressures`` asks for less: friction is what pressures that are known allow.

How far the loads may go from L₀ to L is the least Σ c |d_x| − L₀·y of all such motions with (L −
L₀)·y = 1, if the loads are balanced there: they are not where L₀ is not, and L takes back what L₀
was too large by.

What supports prescribe is no load, and always goes on. It moves bodies *freely* where a motion of
theirs goes with it, d = a d₀ + B R y, a > 0, that no pressure resists: then no forces that the laws
allow do work in it, and what follows it carries nothing. A pile that flows away from under a plate
is such a case (``unresisted``).

Reference: Kanno, Nonsmooth Mechanics and Convex Optimization, CRC Press (2011), chapters on limit
analysis and on contact. Solver: Clarabel, an interior-point method (Goulart & Chen, arXiv
2405.12762).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from orchestrator.method.stopping.carrying_points import DEPENDENT, Reach
from orchestrator.optional import Late
from orchestrator.scene.conditions.rigid import RIGID
from orchestrator.linalg import svd
from orchestrator.method.interface.rows import peak

clarabel = Late("clarabel")
# of the largest load on a body that touches these, what counts as unbalanced: coordinates have six
# digits
LEAST = 1e-6
TOLERANCE = 1e-9  # of the interior-point method, on a problem whose loads are of order one


@dataclass(frozen=True)
class Motion:
    """A rigid motion in which loads do more work than any force resists.

    y : (bodies, 6) of bodies, the largest of length 1
    lacking : force that balance lacks, over the largest load on a body, or on a point that a
        surface follows
    factor : share, 0 to 1, of what the loads have grown by that is balanced; nan where what was
        there before is not balanced either, and where that is not known
    """

    y: np.ndarray
    lacking: float
    factor: float = np.nan


def failing(reach: Reach, loads: np.ndarray, before: np.ndarray,
            noise: np.ndarray) -> Motion | None:
    """The motion that shows that loads are too large; None where forces balance them, or where the
    solver finds neither.

    reach : of all points; ``Reach.extremes`` of them are enough
    loads, before : (bodies, 6) forces, and moments over sizes, in the motions of J; those that are
        balanced at the most before
    noise : (bodies,) force that rounding leaves
    """
    moves = np.stack([np.abs(reach.J[:, :, RIGID * k: RIGID * (k + 1)]).any(axis=(1, 2))
                      for k in range(2)], axis=1)
    floats = loads.any(axis=1)
    floats[reach.ends[moves]] = True
    acts = (reach.side != 0) | (reach.limit > 0)
    touching = reach.ends[moves.all(axis=1) & acts]  # what is held connects nobody
    graph = sp.coo_array((np.ones(len(touching)), touching.T), shape=(len(loads), len(loads)))
    _, part = connected_components(graph, directed=False)
    acting, worst = reach.some(moves.any(axis=1) & acts), None
    pushed = loads.any(axis=1)
    pushed[reach.ends[reach.works.any(axis=0)]] = True
    for p in np.unique(part[pushed & floats]):
        own = np.flatnonzero(floats & (part == p))
        found = _of_part(acting.some(np.isin(acting.ends, own).any(axis=1)), own, loads, before,
                         noise)
        if found is not None and (worst is None or found.lacking > worst.lacking):
            worst = found
    return worst


def unresisted(reach: Reach, bodies: int) -> np.ndarray | None:
    """(bodies, 6) how bodies move, the farthest by 1, with what supports prescribe; None where some
    force resists that, or where the
    solver finds neither. Where points carry something of their own, glue or a bolt's force, they
    resist. ``reach`` as for ``failing``."""
    largest = peak(reach.J[..., -1])
    if not largest or reach.works.any() or (np.isfinite(reach.limit) & (reach.limit > 0)).any():
        return None
    reach.J[..., -1] /= largest
    reach = reach.some(reach.J.any(axis=(1, 2)) & ((reach.side != 0) | (reach.limit > 0)))
    own = np.unique(
        np.concatenate([reach.ends[reach.J[..., RIGID * k: RIGID * (k + 1)].any(axis=(1, 2)), k]
                        for k in range(2)]))
    if not len(own):
        return None
    value, y = _Cones(reach, own, 1.0).least(np.eye(RIGID * len(own) + 1)[-1])
    if y is None or value <= LEAST or not y.any():
        return None
    result = np.zeros((bodies, RIGID))
    result[own] = y.reshape(-1, RIGID)
    return result / np.linalg.norm(result, axis=1).max()


def _of_part(reach: Reach, own: np.ndarray, loads: np.ndarray, before: np.ndarray,
             noise: np.ndarray) -> Motion | None:
    """The same for the bodies ``own``, which touch each other and nobody else who is free."""
    scale = max(np.linalg.norm(loads[own], axis=1).max(), peak(reach.works))
    if scale <= noise[own].max():
        return None
    cones, (L, L0) = _Cones(reach, own, scale), (x[own].ravel() / scale for x in (loads, before))
    value, y = cones.least(L)
    if y is None or value <= max(LEAST, noise[own].sum() / scale):
        return None
    factor, at_limit = cones.carried(L0, L - L0)
    result = np.zeros_like(loads)
    result[own] = (y if at_limit is None else at_limit).reshape(-1, RIGID)
    return Motion(result / np.linalg.norm(result, axis=1).max(), value, factor)


class _Cones:
    """The motions that nothing resists too much: unknowns are y of the bodies ``own``, the share of
    what supports prescribe if J has it,
    amounts of free motions, |d_x| where it costs.

    scale : of forces
    rows, cones : of the constraints ``rows`` x ∈ ``cones``
    cost : of the unknowns
    """

    def __init__(self, reach: Reach, own: np.ndarray, scale: float):
        place = np.full(max(own.max(), reach.ends.max(initial=0)) + 1, -1)
        place[own] = np.arange(len(own))
        at = np.repeat(place[reach.ends], RIGID, axis=1)  # (P, 12); −1: held
        self.columns, self.there = np.where(at >= 0, RIGID * at + np.tile(np.arange(RIGID), 2),
                                            0), at >= 0
        self.bodies, self.shared = RIGID * len(own), reach.J.shape[2] - 2 * RIGID
        self.columns = np.pad(self.columns, ((0, 0), (0, self.shared)), constant_values=self.bodies)
        self.there = np.pad(self.there, ((0, 0), (0, self.shared)), constant_values=True)
        self.moving = self.bodies + self.shared
        along = np.einsum("cp,pcj->pj", reach.normal, reach.J)
        across = np.einsum("icp,pcj->pij", reach.directions, reach.J)
        given = np.flatnonzero(np.isfinite(reach.limit) & (reach.limit > 0))
        bonds, works = self._bonds(reach, across)
        self.cost = np.r_[np.zeros(self.moving), works / scale, reach.limit[given] / scale]
        self.rows, self.cones = [], []
        if bonds:
            for b in bonds:
                b.resize(b.shape[0], len(self.cost))
            self._add(sp.vstack(bonds), [clarabel.ZeroConeT(sum(b.shape[0] for b in bonds))])
        one_sided, pushes = -reach.side[:, None] * along, reach.side != 0
        smooth = np.flatnonzero(pushes & (reach.friction == 0))
        self._add(self._matrix(one_sided[smooth], smooth),
                  [clarabel.NonnegativeConeT(len(smooth))] if len(smooth) else [])
        rough, count = np.flatnonzero(pushes & (reach.friction > 0)), np.arange(len(given))
        rubbed = reach.friction[rough, None, None] * across[rough]
        self._add(self._stacked(one_sided[rough], rubbed, rough),
                  [clarabel.SecondOrderConeT(4)] * len(rough))
        size = sp.csr_array((np.ones(len(given)), (4 * count, self.moving + len(works) + count)),
                            shape=(4 * len(given), len(self.cost)))
        limited = self._stacked(np.zeros((len(given), self.columns.shape[1])), across[given], given)
        self._add(limited + size, [clarabel.SecondOrderConeT(4)] * len(given))

    def _bonds(self, reach: Reach, across: np.ndarray) -> tuple[list[sp.csr_array], np.ndarray]:
        """Return what vanishes where forces are not limited, interface by interface, as few rows as
        say
        the same; and what acts in the motions
        that are free there, one unknown each."""
        found, works, bound = [], [], np.isinf(reach.limit)
        for g in np.unique(reach.group[bound]):
            chosen = np.flatnonzero(bound & (reach.group == g))
            moves = np.flatnonzero(reach.motions[:, :, chosen].any(axis=(1, 2)))
            given = -np.einsum("icp,mcp->pim", reach.directions[:, :, chosen],
                               reach.motions[moves][:, :, chosen])
            own = (across[chosen] * self.there[chosen, None]).reshape(-1, self.columns.shape[1])
            _, size, turned = svd(np.linalg.qr(np.hstack([own, given.reshape(len(own), -1)]),
                                               mode="r"))
            turned = turned[: len(size)][size > DEPENDENT * peak(size)]
            columns = np.r_[self.columns[chosen[0]],
                            self.moving + len(works) + np.arange(len(moves))]
            works += reach.works[moves, chosen[0]].tolist()
            rows = np.repeat(np.arange(len(turned)), len(columns))
            found.append(sp.csr_array((turned.ravel(), (rows, np.tile(columns, len(turned)))),
                                      shape=(len(turned), columns.max() + 1)))
        return found, np.array(works)

    def _add(self, rows: sp.csr_array, cones: list) -> None:
        self.rows.append(rows)
        self.cones += cones

    def _matrix(self, values: np.ndarray, points: np.ndarray) -> sp.csr_array:
        """Rows (n, 12), or (n, 13), of points (n,)."""
        rows = np.repeat(np.arange(len(values)), self.columns.shape[1])
        values = np.where(self.there[points], values, 0.0)
        return sp.csr_array((values.ravel(), (rows, self.columns[points].ravel())),
                            shape=(len(values), len(self.cost)))

    def _stacked(self, head: np.ndarray, rest: np.ndarray, points: np.ndarray) -> sp.csr_array:
        """Of every point its head (n, 12), then its other rows (n, w, 12)."""
        every = np.concatenate([head[:, None], rest], axis=1)
        return self._matrix(every.reshape(-1, self.columns.shape[1]),
                            np.repeat(points, every.shape[1]))

    def least(self, L: np.ndarray) -> tuple[float, np.ndarray | None]:
        """The largest L·y less what resists, among |y_b| ≤ 1, and y; None where the solver fails.
        Of the share of what supports prescribe
        at most all counts."""
        count = self.bodies // RIGID
        rows = np.arange(self.bodies) + np.arange(self.bodies) // RIGID + 1
        ball = sp.csr_array((np.ones(self.bodies), (rows, np.arange(self.bodies))),
                            shape=(self.bodies + count, len(self.cost)))
        radius = np.zeros(self.bodies + count)
        radius[:: RIGID + 1] = 1.0
        share = sp.csr_array(np.ones((self.shared, 1)) * (np.arange(len(self.cost)) == self.bodies))
        most = [clarabel.NonnegativeConeT(self.shared)] if self.shared else []
        x = self._solved(self.cost - np.pad(L, (0, len(self.cost) - len(L))),
                         sp.vstack([-share, ball]),
                         np.r_[np.ones(self.shared), radius],
                         most + [clarabel.SecondOrderConeT(RIGID + 1)] * count)
        return (0.0, None) if x is None else (float(L @ x[: len(L)] - self.cost @ x),
                                              x[: self.bodies])

    def carried(self, L0: np.ndarray, more: np.ndarray) -> tuple[float, np.ndarray | None]:
        """Return the largest α in [0, 1] for which L₀ + α ``more`` is balanced, and the motion
        there; nan and None where no α is,
        as where L₀ is not balanced either: of loads that are too large all the while no share is
        carried."""
        factor, motion = self.farthest(L0, more)
        if not factor <= 1:
            return np.nan, None
        share = max(factor, 0.0)
        lacking, y = self.least(L0 + share * more)
        return (np.nan, None) if y is None or lacking > LEAST else (share, motion)

    def farthest(self, L0: np.ndarray, more: np.ndarray) -> tuple[float, np.ndarray | None]:
        """The largest α for which L₀ + α ``more`` is balanced, and the motion there; nan where
        there is none.
        """
        rest = len(self.cost) - len(L0)
        x = self._solved(self.cost - np.pad(L0, (0, rest)),
                         sp.csr_array(np.pad(more, (0, rest))[None]), -np.ones(1),
                         [clarabel.ZeroConeT(1)])
        return (np.nan, None) if x is None else (float(self.cost @ x - L0 @ x[: self.bodies]),
                                                 x[: self.bodies])

    def _solved(self, cost: np.ndarray, more: sp.csr_array, right: np.ndarray,
                cones: list) -> np.ndarray | None:
        """The least cost·x with rows x in their cones and ``right`` + ``more`` x in theirs."""
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
        A = sp.csc_array(-sp.vstack([*self.rows, more]))
        A = sp.csc_matrix((A.data, A.indices.astype(np.int64), A.indptr.astype(np.int64)),
                          shape=A.shape)
        b = np.r_[np.zeros(A.shape[0] - len(right)), right]
        found = clarabel.DefaultSolver(sp.csc_matrix((len(cost),) * 2), cost, A, b,
                                       [*self.cones, *cones], settings).solve()
        return np.array(found.x) if str(found.status) in ("Solved", "AlmostSolved") else None
