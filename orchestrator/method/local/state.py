"""Result of a local stage, whatever the laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import OPEN, SLIP, STICK


@dataclass
class LocalState:
    """What a local stage hands on.

    Parameters
    ----------
    s : (D, T) next state f̂ + k⁻ŵ
    hats : ŵ, f̂ and k⁻ŵ, (D, T) each, where they were formed
    force : (T, 3, P) f̂ on side 1 of each pair that is not perfect
    jump : (T, 3, P) its jump d
    status : (T, P) OPEN, STICK, SLIP, BONDED
    mine : (P,) bool, pairs that this rank counts; those on interfaces between ranks are on both
    """

    s: np.ndarray
    hats: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    force: np.ndarray | None = None
    jump: np.ndarray | None = None
    status: np.ndarray | None = None
    mine: np.ndarray | None = None

    @classmethod
    def joined(cls, batches: Sequence[LocalState]) -> LocalState:
        """The state of all load steps from those of batches of them, in order, where interfaces are not perfect."""
        return cls(np.hstack([b.s for b in batches]), tuple(np.hstack(hats) for hats in zip(*(b.hats for b in batches))),
                   *(np.concatenate([getattr(b, name) for b in batches]) for name in ("force", "jump", "status")),
                   batches[0].mine)

    @property
    def counts(self) -> tuple[int, int, int]:
        """This rank's pairs that are open, stick and slip, summed over the steps."""
        if self.status is None:
            return 0, 0, 0
        return tuple(int((self.status == kind)[:, self.mine].sum()) for kind in (OPEN, STICK, SLIP))
