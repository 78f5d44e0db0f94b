"""Anderson's acceleration of the nonlinear fixed point s = F(s), load step by load step.

Type II with a window of m differences around the latest evaluation: the combination of least
residual r = F(s) − s, in the norm of (k⁺)⁻¹, then a step along its residual,

    s ← s + β r − Σ γ_i (Δs_i + β Δr_i),     γ = argmin ‖r − Σ γ_i Δr_i‖

Each load step has a γ of its own, of least residual in it and in those before, whose history it
has. A body that snaps in one load step has the largest residual by far: with one γ for all of them
those before would wait for it.

What no combination takes away of a residual moves the state by β of it. Where that stays as it is
from one evaluation to the next, a body creeps to a place, or friction has folded away the branch
that the state comes from: there each step is twice as long as the one before, until it changes.

The window is dropped when the residual has grown far beyond the best one: the statuses that it
speaks of are gone.

Differences are kept in double precision: single moves a state by 6e-8 of its last changes, and a
body that stabilisation alone holds by that over ε. Ten grains at 1e-10 then stagnate at 6e-10.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.acceleration import Acceleration
from orchestrator.method.acceleration.residual_minimisation import ResidualMinimisation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import dots
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

REGULARISATION = 1e-10  # of scaled Gram matrices: five digits of what differences tell
FORGET = 2.0  # times the best residual
# Where matter is nonlinear, residuals of good steps rise and fall by up to three times: a window
# dropped at twice the best is
# dropped at every other step (54 iterations in place of 20). From 5 to 100 it makes no difference.
FORGET_FLOWING = 10.0
MEMORY, RELAXATION = 30, 0.8  # of auto
# What is left stays as it is: cosine with the one before, length over that of it, and over ‖r‖.
SAME, LASTS, MOST_OF = 0.95, 0.8, 0.5


class Anderson(Acceleration):
    """Acceleration for laws with history.

    weight : (D,) float, squared weights of the norm
    memory : differences kept
    relaxation : β, the step along the residual
    team : the ranks that share the state
    forget : times the best residual, above which the window is dropped
    """

    title = "Anderson's acceleration, type II"

    def __init__(self, weight: np.ndarray, memory: int, relaxation: float, team: Team = ALONE,
                 forget: float = FORGET):
        self.root, self.memory, self.relaxation = np.sqrt(weight), memory, relaxation
        self.team, self.forget = team, forget
        self.place = 0  # where the next difference goes; the oldest is overwritten
        self.latest: tuple[np.ndarray, np.ndarray] | None = None  # s and r
        self.kept, self.smallest = 0, np.inf  # differences in the window, least ‖r‖
        # (T,) or one for all, longest steps along what is left, over β: a quarter of those after
        # which the window was dropped
        self.most: np.ndarray | float = np.inf

    @classmethod
    def suiting(cls, all_perfect: bool) -> type[Acceleration]:
        """The variant for affine maps, which minimises the residual."""
        return ResidualMinimisation if all_perfect else cls

    @classmethod
    def of(cls, d: Decomposition, method) -> Anderson:
        """``relaxation: auto`` is 0.8."""
        return cls(1 / d.stage.direction.diagonal,
                   MEMORY if method.memory == "auto" else method.memory,
                   RELAXATION if method.relaxation == "auto" else method.relaxation, d.space.team,
                   FORGET if d.nonlinear is None else FORGET_FLOWING)

    @property
    def depth(self) -> int:
        return 1 + self.kept

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation; among ranks one message."""
        s, residual = evaluated.s, image - evaluated.s
        weighted = self.root * residual
        if self.latest is None:
            self._begin(*s.shape)
        else:
            self._remember(s, residual)
        # (T, D, 3): the latest difference, r, and what was left of the one before
        three = np.stack([self.differences[:, self.place - 1], weighted, self.left], axis=2)
        square, common, products = self.team.sum(
            dots(weighted, weighted), dots(weighted, self.left), self.differences @ three)
        self.gram[:, self.place - 1] = self.gram[:, :, self.place - 1] = products[..., 0]
        self.right = products[..., 1]
        size = np.sqrt(square.sum())
        if size > self.forget * self.smallest:
            self.most = np.where(self.stride > 1, self.stride / 4, self.most)
            self._begin(*s.shape)
            self.smallest, common, products = size, 0 * common, 0 * products
        self.smallest = min(self.smallest, size)
        self.latest = s, residual
        self._combine(weighted, square, common, products[..., 2])
        return residual

    def _combine(self, weighted: np.ndarray, square: np.ndarray, common: np.ndarray,
                 along: np.ndarray) -> None:
        """Choose γ, and how far to go along what it leaves; of root r (T, D), ‖r‖² (T,), and
        products of r (T,) and of differences (T, m) with what was left before.
        """
        gram, right = self.gram.cumsum(axis=0), self.right.cumsum(axis=0)
        size = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
        size[size == 0] = 1.0
        scaled = gram / (size[:, :, None] * size[:, None, :])
        scaled += REGULARISATION * np.eye(self.memory)
        self.gamma = np.linalg.solve(scaled, (right / size)[..., None])[..., 0] / size
        now = square + dots(self.gamma, (self.gram @ self.gamma[..., None])[..., 0]
                            - 2 * self.right)
        common, before, self.lasting = common - dots(self.gamma, along), self.lasting, now
        stays = (common > SAME * np.sqrt(np.maximum(now * before, 0.0))) \
            & (now > LASTS**2 * before) & (now > MOST_OF**2 * square)
        self.stride = np.where(stays, np.maximum(np.minimum(2 * self.stride, self.most), 1.0), 1.0)
        self.left = weighted - (self.gamma[:, None, :] @ self.differences)[:, 0]

    def _begin(self, steps: int, columns: int) -> None:
        """Begin with an empty window; the system gives memory to what is written."""
        self.kept = 0
        # (T, m, m) Δr_i·Δr_j, and (T, m) Δr_i·r of the latest r
        self.gram = np.zeros((steps, self.memory, self.memory))
        self.right = np.zeros((steps, self.memory))
        # (T, m, D) Δs + β Δr, and root Δr
        self.changes, self.differences = np.zeros((2, steps, self.memory, columns))
        # what no combination takes away of r, weighted, its square, and steps along it over β (T,)
        self.left, self.lasting, self.stride = np.zeros((steps, columns)), 0.0, np.ones(steps)

    def _remember(self, s: np.ndarray, residual: np.ndarray) -> None:
        """Keep the latest differences, root Δr (T, D) among them."""
        s_before, r_before = self.latest
        change, difference = self.changes[:, self.place], self.differences[:, self.place]
        difference[:] = residual - r_before
        change[:] = s - s_before + self.relaxation * difference
        difference *= self.root
        self.place = (self.place + 1) % self.memory
        self.kept = min(self.kept + 1, self.memory)

    def next(self) -> np.ndarray:
        s, residual = self.latest
        further = self.relaxation * (self.stride - 1)[:, None] * self.left / self.root
        return (s + self.relaxation * residual + further
                - (self.gamma[:, None, :] @ self.changes)[:, 0])
