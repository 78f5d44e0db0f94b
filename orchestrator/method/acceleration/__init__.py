"""Accelerations, one file each: they find the fixed point s = F(s), one evaluation after the
other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.registry import ACCELERATIONS


class Acceleration(ABC):
    """Base of accelerations; a line in ``registry`` gives it its name in the YAML.

    title : of the algorithm, for people
    depth : of how many of the last evaluations it makes the next state; None: all. A resumed run
        begins a new one, which takes in as many once more: where all is bonded as they were,
        elsewhere s and its image alone
    """

    title: str
    depth: int | None = 1

    @classmethod
    def suiting(cls, all_perfect: bool) -> type[Acceleration]:
        """The class that does what is meant where the fixed point is affine, as where all is
        bonded, or where it is not.
        """
        return cls

    @classmethod
    @abstractmethod
    def of(cls, d: Decomposition, method) -> Acceleration:
        """The acceleration for a decomposition and ``method`` of the configuration, in the norm of
        the inverse search direction.
        """

    @abstractmethod
    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation; return F(s) − s at the best point known so far.

        evaluated : the linear stage at s
        image : F(s), what the local stage has made of it
        """

    def best(self, evaluated: Admissible) -> Admissible:
        """The linear stage at the best point known so far, once an evaluation has been taken in."""
        return evaluated

    @abstractmethod
    def next(self) -> np.ndarray:
        """State to evaluate next; the caller's to change."""


def algorithm(name: str, all_perfect: bool) -> type[Acceleration]:
    """The algorithm that ``method.acceleration`` names: where all is bonded, ``anderson`` minimises
    residuals, as ``gmres`` does.
    """
    return ACCELERATIONS[name].suiting(all_perfect)


def make_acceleration(d: Decomposition, method) -> Acceleration:
    """The acceleration that a configuration asks for."""
    return algorithm(method.acceleration, d.all_perfect).of(d, method)
