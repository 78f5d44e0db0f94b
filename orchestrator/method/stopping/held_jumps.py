"""Jumps that laws hold while admissible displacements are sought."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

ALONG = 0.5  # cosine to the normal: directions are along it or across


@dataclass(frozen=True)
class HeldJumps:
    """Directions in which laws hold jumps, r of them.

    at : (r,) int, pairs; directions : (r, 3) unit vectors
    goals : (r,) what the jumps there have to be
    soft : (r,) how far they give way under a unit force
    priced : (r,) bool, whether laws charge for what they miss
    """

    at: np.ndarray
    directions: np.ndarray
    goals: np.ndarray
    soft: np.ndarray
    priced: np.ndarray

    def some(self, chosen: np.ndarray) -> HeldJumps:
        """Those that are chosen, (r,) bool or places."""
        return HeldJumps(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def and_then(self, other: HeldJumps) -> HeldJumps:
        """These, and the others behind."""
        return HeldJumps(*(np.concatenate([getattr(held, field.name) for held in (self, other)])
                           for field in fields(self)))

    def of(self, jump: np.ndarray) -> np.ndarray:
        """(r,) jumps (3, P) in these directions."""
        return np.einsum("ri,ir->r", self.directions, jump[:, self.at])

    def along(self, normal: np.ndarray) -> np.ndarray:
        """(r,) bool, directions along the normals (3, P)."""
        return np.abs(self.of(normal)) > ALONG
