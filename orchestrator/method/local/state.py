"""Result of a local stage, whatever the laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.method.history import History
from orchestrator.method.interface.point_traces import PointTraces


@dataclass
class LocalState:
    """What a local stage hands on: an element of the set ℒ, eq. 9."""

    s: np.ndarray  # (T, D) next state f̂ + k⁻ŵ
    hats: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # ŵ, f̂ and k⁻ŵ, (T, D) each, where they were formed
    force: np.ndarray | None = None  # (T, 3, P) f̂ on side 1 of each pair that is not perfect
    lawful: np.ndarray | None = None  # (T, 3, P) what its law alone asks for; f̂ itself but for the stabilisation
    jump: np.ndarray | None = None  # (T, 3, P) its jump d
    status: np.ndarray | None = None  # (T, P) int, what its law says it does
    own: dict[str, np.ndarray] = field(default_factory=dict)  # name → (T, P) the laws' own variables at the end of each load step
    at: PointTraces | None = field(default=None, repr=False)  # the fields that it was made of at these pairs, for who measures it next

    def left(self, step: int = -1) -> History:
        """What one of these load steps, the last one, leaves to the next."""
        return History(self.jump[step], {name: x[step] for name, x in self.own.items()})

    def steps(self, chosen: slice) -> LocalState:
        """Of some of the load steps, where interfaces are not perfect."""
        return LocalState(self.s[chosen], tuple(x[chosen] for x in self.hats),
                          *(x[chosen] for x in (self.force, self.lawful, self.jump, self.status)),
                          own={name: x[chosen] for name, x in self.own.items()})

    @classmethod
    def joined(cls, batches: Sequence[LocalState]) -> LocalState:
        """The state of all load steps from those of batches of them, in order, where interfaces are not perfect."""
        return cls(np.vstack([b.s for b in batches]), tuple(np.vstack(hats) for hats in zip(*(b.hats for b in batches))),
                   *(np.concatenate(parts) for parts in zip(*((b.force, b.lawful, b.jump, b.status) for b in batches))),
                   own={name: np.concatenate([b.own[name] for b in batches]) for name in batches[0].own})
