"""What a load step leaves to the next one: the jumps of the pairs, and the laws' own variables, such as a damage.

The local stage forms it step after step (``LocalState.left``); the coarse contact problem sweeps through the same steps with
it, the measures look back at it, and the next load steps begin with it. Nothing else is handed on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class History:
    """The state of all pairs at the end of a load step.

    jump : (3, P) u₂ − u₁
    own : name → (P,) value of a law's own variable; 0 at pairs of other laws
    """

    jump: np.ndarray
    own: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def none(cls, count: int) -> History:
        """Of pairs that nothing has happened to: an empty ``own`` stands for zeros."""
        return cls(np.zeros((3, count)))

    def take(self, chosen: slice | np.ndarray) -> History:
        """Of some of the pairs."""
        if isinstance(chosen, slice):
            return History(self.jump[:, chosen], {name: x[chosen] for name, x in self.own.items()})
        return History(self.jump.take(chosen, axis=1), {name: x.take(chosen) for name, x in self.own.items()})

    def among(self, count: int) -> History:
        """Of more pairs, the first of which are these; nothing has happened to the others."""
        rest = count - self.jump.shape[1]
        return History(np.pad(self.jump, ((0, 0), (0, rest))), {name: np.pad(x, (0, rest)) for name, x in self.own.items()})
