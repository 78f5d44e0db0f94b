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

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.lengths import RIGID, LengthScale

SEEN = 5  # iterations: single ones may stand still, and a digit takes seven to ten
BENT = 2.0  # what affine fields move by, as bodies bend as well: measured 0.5 … 1.5 times as far in all
ARRAYS = ("common/places.rigid", "common/places.moves", "common/places.open")


class Places:
    """Follows the places of the bodies of one batch of load steps.

    Attributes
    ----------
    rigid : (bodies, T, 6) as ``Lengths`` has it, of the last iteration
    moves : how far bodies went in the last iterations, (bodies, T) each
    open : (bodies, T) how far places are open, once iterations have ended
    """

    def __init__(self) -> None:
        self.rigid: np.ndarray | None = None
        self.moves: deque[np.ndarray] = deque(maxlen=SEEN)
        self.open: np.ndarray | None = None

    def __call__(self, rigid: np.ndarray) -> None:
        """Take in the rigid motions (bodies, T, 6) of an iteration."""
        if self.rigid is not None:
            self.moves.append(_size(rigid - self.rigid))
        self.rigid, self.open = rigid, None

    def end(self, d: Decomposition, lengths: LengthScale, fields: Admissible, local: LocalState) -> None:
        """Estimate how far places are open; all ranks have to ask."""
        let_go = lengths(d.coarse.let_go(fields, local.jump)).rigid
        self.open = BENT * _size(let_go - lengths(fields.u).rigid) + sum(self.moves)

    @property
    def told(self) -> dict[str, np.ndarray]:
        """For the ``Memory`` of an iteration."""
        bodies, steps, _ = self.rigid.shape
        told = (self.rigid.reshape(bodies, -1), np.array(self.moves).reshape(-1, steps), self.open)
        return {name: array for name, array in zip(ARRAYS, told) if array is not None}

    def recall(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Take back what was told."""
        rigid, moves, self.open = map(arrays.get, ARRAYS)
        self.rigid = rigid.reshape(len(rigid), -1, RIGID)
        self.moves = deque(moves.reshape(-1, *self.rigid.shape[:2]), maxlen=SEEN)


def _size(rigid: np.ndarray) -> np.ndarray:
    """(bodies, T) how far a point of a body may move in rigid motions (bodies, T, 6)."""
    return np.linalg.norm(rigid[..., :3], axis=2) + np.linalg.norm(rigid[..., 3:], axis=2)
