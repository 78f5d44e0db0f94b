"""Linear maps of nodes' displacements: values at points, means over faces, forces that matter carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.copies import Copies

Weights = Mapping[int, tuple[np.ndarray, np.ndarray]]  # subdomain → local nodes (n,), and components of what is asked of each (c, n, 3)


@dataclass(frozen=True)
class Measured:
    """A probe as a linear map of displacements: c components.

    weights : of the displacements of nodes; a node may be there several times
    given : (T, c) what it tells where nothing moves, of matter that is heated or loaded
    matter : whether it hangs on the moduli of the matter there
    energy : (c,) of forces, ‖χ‖² of the motions that tell them, see ``flux``; None of others
    """

    weights: Weights
    given: np.ndarray
    matter: bool = False
    energy: np.ndarray | None = None

    @staticmethod
    def at(copies: Copies, chosen: np.ndarray, weight: np.ndarray) -> Weights:
        """Weights (c, n, 3) of copies of nodes (n,) int, by the subdomains that these are of."""
        whose = np.searchsorted(copies.ends, chosen, side="right") - 1
        return {int(e): (chosen[whose == e] - copies.ends[e], weight[:, whose == e]) for e in np.unique(whose)}

    def __len__(self) -> int:
        return self.given.shape[1]

    def of(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(T, c) of displacements, per subdomain (T, n_E, 3)."""
        return self.given + sum(np.einsum("cni,tni->tc", weight, parts[e][:, nodes]) for e, (nodes, weight) in self.weights.items())
