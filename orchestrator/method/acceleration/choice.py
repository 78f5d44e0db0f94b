"""The acceleration that a configuration asks for, in the norm of the inverse search direction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from orchestrator.method.acceleration.anderson import FORGET, Anderson
from orchestrator.method.acceleration.carried import Carried
from orchestrator.method.acceleration.residual_minimisation import Relaxation, ResidualMinimisation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import Memory

CONTACT_MEMORY = 30
# Where matter is nonlinear, residuals of good steps rise and fall by up to three times: a memory dropped at twice the best is
# dropped at every other step (54 iterations in place of 20). From 5 to 100 it makes no difference.
FORGET_FLOWING = 10.0


class Acceleration(Protocol):
    """Finds the fixed point s = F(s), one evaluation after the other.

    Attributes
    ----------
    title : of the algorithm, for people
    """

    title: str

    def ahead(self) -> None:
        """What the next evaluation is not needed for, while its traces are under way."""

    def take(self, evaluated: Admissible, image: np.ndarray, beside: Sequence[np.ndarray] = ()
             ) -> tuple[np.ndarray, list[np.ndarray] | None]:
        """Take in an evaluation.

        Parameters
        ----------
        evaluated : the linear stage at s
        image : F(s), what the local stage has made of it
        beside : what else is to be summed over the ranks, in its own message

        Returns
        -------
        residual : F(s) − s at the best point known so far
        beside : the sums; None where it has no message to send
        """

    def best(self, evaluated: Admissible) -> Admissible:
        """The linear stage at the best point known so far, once an evaluation has been taken in; ``next`` does not wait for it."""

    def next(self) -> np.ndarray:
        """State to evaluate next; the caller's to change."""

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, Any], int]:
        """Arrays and notes for the ``Memory`` of an iteration: what the last evaluation has added.

        Parameters
        ----------
        whole : tell also what no later evaluation tells again; so every ``INTERVAL`` iterations

        Returns
        -------
        arrays, notes, and how many iterations, the last one included, have to be known to go on after it
        """

    def recall(self, memories: Sequence[Memory]) -> None:
        """Take back what was told of at least that many iterations, in order; ``next`` then gives what it would have."""


def algorithm(acceleration: str, all_perfect: bool) -> type[Acceleration]:
    """What stands behind the word in the YAML: where all is bonded, ``anderson`` minimises residuals, as ``gmres`` does."""
    if acceleration == "none":
        return Relaxation
    return ResidualMinimisation if all_perfect else Anderson


def make_acceleration(d: Decomposition, method) -> Acceleration:
    """The acceleration for a decomposition and ``method`` of the configuration.

    ``relaxation: auto`` is 1 where the residual is minimised over affine maps and 0.8 with contact. Where
    it is not minimised at all it is 0.8 (the paper's), or less if the two search directions differ much.
    """
    weight, auto = 1 / d.stage.direction.diagonal, method.relaxation == "auto"
    memory = None if method.memory == "auto" else method.memory
    kind = algorithm(method.acceleration, d.all_perfect)
    if kind is Relaxation:
        return Relaxation(_stable_relaxation(d) if auto else method.relaxation)
    if kind is ResidualMinimisation:
        return ResidualMinimisation(d.stage.complete, weight, None if method.acceleration == "gmres" else memory,
                                    1.0 if auto else method.relaxation, d.space.team,
                                    Carried(d.stage, d.bound) if d.space.team.size > 1 else None)
    return Anderson(weight, memory or CONTACT_MEMORY, 0.8 if auto else method.relaxation, d.space.team,
                    FORGET if d.nonlinear is None else FORGET_FLOWING)


def _stable_relaxation(d: Decomposition) -> float:
    """For the worst eigenvalues of all ranks: k⁻ and k⁺ do not couple interfaces."""
    low, high = d.local.conditioning()
    high, low = d.space.team.max(high, -low)
    return stable_relaxation(-low, high)


def stable_relaxation(low: float, high: float) -> float:
    """0.8, or 0.9 of the limit 2/(1 + max(λ, 1/λ)) where that is less; λ the eigenvalues of (k⁻, k⁺)."""
    worst = max(high, 1 / low if low > 0 else np.inf)
    return max(min(0.8, 0.9 * 2 / (1 + worst)), 0.01)
