"""How far the places of loose bodies are still open when iterations end.

Laws may hold to a tolerance while a body that next to nothing holds is hundreds of tolerances from its place. Two things
would move it yet:

- more iterations: it is taken to go as far as it went in the last ``SEEN``, added up;
- the springs of stabilisation, which hold back what laws would let go. They are set to carry nothing where pairs stand
  now, and the coarse contact problem is solved once more, without back-substitutions: what bodies move by then. That
  knows their affine, or rigid, fields alone. How they bend answers too, and is taken to do as much again.

    open by 2 ‖x_let_go − x‖ + Σ ‖x_i − x_{i−1}‖,    ‖x‖ = |shift of the centre| + |turn| · half the size

no point of a body moves by more than ‖x‖ as the body does. It is an estimate and no bound: beside runs to a hundredth of the
tolerance, 10, 15 and 27 grains to 1e-4 … 1e-6, the body that is farthest off is off by a fifth to nine tenths of the largest.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.monitors.ending import DIVERGED
from orchestrator.method.stopping.bodies import RIGID
from orchestrator.method.stopping.law_residuals import LengthScale

SEEN = 5  # iterations: single ones may stand still, and a digit takes seven to ten
BENT = 2.0  # what affine fields move by, as bodies bend as well: measured 0.5 … 1.5 times as far in all
ARRAYS = ("common/rigid", "common/moves", "common/open")


class Places(Monitor):
    """Follows the places of loose bodies, and estimates in the last iteration how far they are open.

    rigid : (bodies, T, 6) as ``Lengths`` has it, of the last iteration
    moves : how far bodies went in the last iterations, (bodies, T) each
    open : (bodies, T) how far places are open, once iterations have ended
    """

    name = "places"

    def __init__(self, lengths: LengthScale):
        self.lengths = lengths
        self.rigid: np.ndarray | None = None
        self.moves: deque[np.ndarray] = deque(maxlen=SEEN)
        self.open: np.ndarray | None = None

    @classmethod
    def of(cls, case: Case) -> Places | None:
        problem = case.problem
        if problem.coarse is None or problem.local.pairs.stabilisation is None:
            return None
        return cls(case.lengths)

    def judge(self, now: Evaluation) -> Verdict:
        self.take(now.verdict.lengths.rigid)
        if now.verdict.reason not in ("", DIVERGED):
            let_go = self.lengths(now.problem.coarse.let_go(now.best, now.local.jump)).rigid
            self.open = BENT * _size(let_go - self.lengths(now.best.u).rigid) + sum(self.moves)
        return Verdict()

    def found(self, problem: Decomposition) -> list[np.ndarray]:
        return [] if self.open is None else [self.open]

    def take(self, rigid: np.ndarray) -> None:
        """Take in the rigid motions (bodies, T, 6) of an iteration."""
        if self.rigid is not None:
            self.moves.append(_size(rigid - self.rigid))
        self.rigid, self.open = rigid, None

    def state(self) -> dict[str, Any]:
        bodies, steps, _ = self.rigid.shape
        told = (self.rigid.reshape(bodies, -1), np.array(self.moves).reshape(-1, steps), self.open)
        return {name: array for name, array in zip(ARRAYS, told) if array is not None}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        rigid, moves, self.open = map(state.get, ARRAYS)
        self.rigid = rigid.reshape(len(rigid), -1, RIGID)
        self.moves = deque(moves.reshape(-1, *self.rigid.shape[:2]), maxlen=SEEN)
        return problem


def _size(rigid: np.ndarray) -> np.ndarray:
    """(bodies, T) how far a point of a body may move in rigid motions (bodies, T, 6)."""
    return np.linalg.norm(rigid[..., :3], axis=2) + np.linalg.norm(rigid[..., 3:], axis=2)
